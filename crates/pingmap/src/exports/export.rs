//! The content of an exported map, independent of the file format.

use geo_types::Coord;
use pingmap_agent::{Event, Geographic, ReferenceSystem};
use pingmap_import::Reference;

use super::antimeridian::cut_line;
use crate::cli_enums::name_of;
use crate::grid::Point;
use crate::output::BadInput;
use crate::success_map::{Cell, Side, SuccessMap};

/// Name of a quantity of a cell, and its accessor.
pub(super) type Quantity = (&'static str, fn(&Cell) -> f64);

/// A map with the content of its file.
pub struct Export<'a> {
    pub map: &'a SuccessMap,
    /// Events whose tracks are exported.
    pub events: &'a [Event],
    pub reference: &'a Reference,
    /// Levels between which areas are filled.
    pub levels: &'a [f64],
    /// The probability is not known where its interval is wider than this.
    pub hatch_width: f64,
}

impl Export<'_> {
    /// Converts metres of the log to latitude and longitude.
    pub(super) fn degrees(&self, east_m: f64, north_m: f64) -> anyhow::Result<Geographic> {
        degrees(self.reference, (east_m, north_m))
    }

    /// Converts a line to latitudes and longitudes, and cuts it at the antimeridian.
    pub(super) fn lines(&self, points: &[Point]) -> anyhow::Result<Vec<Vec<Coord<f64>>>> {
        Ok(cut_line(coords(self.reference, points)?))
    }

    /// Returns the contour lines of the cells' values at a level, as [`Export::lines`] does.
    pub(super) fn contour(&self, values: &[f64], level: f64) -> anyhow::Result<Vec<Vec<Coord<f64>>>> {
        let lines = self.map.area.grid(values).contour_lines(level);
        Ok(lines.iter().map(|points| self.lines(points)).collect::<anyhow::Result<Vec<_>>>()?.concat())
    }

    pub(super) fn has_degrees(&self) -> bool {
        self.reference.system() != ReferenceSystem::Unknown
    }

    /// Returns the prefix of the names of a side's values. The prefix is empty if the map has one side.
    pub(super) fn prefix(&self, side: &Side) -> String {
        if self.map.sides.len() == 1 { String::new() } else { format!("{}_", name_of(&side.seen)) }
    }
}

/// Converts metres of a log to latitude and longitude.
pub(super) fn degrees(reference: &Reference, (east_m, north_m): Point) -> anyhow::Result<Geographic> {
    let place = reference.geographic(east_m, north_m);
    place.ok_or_else(|| BadInput(format!("({east_m:.0}, {north_m:.0}) m has no latitude and longitude")).into())
}

/// Converts metres of a log to longitudes (x) and latitudes (y).
pub(super) fn coords(reference: &Reference, points: &[Point]) -> anyhow::Result<Vec<Coord<f64>>> {
    let coord = |&point: &Point| {
        let place = degrees(reference, point)?;
        Ok(Coord { x: place.longitude_deg, y: place.latitude_deg })
    };
    points.iter().map(coord).collect()
}
