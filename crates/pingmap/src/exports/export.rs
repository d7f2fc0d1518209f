//! What goes into a file of a map, whatever its form.

use pingmap_agent::{Event, Geographic, ReferenceSystem};
use pingmap_import::Reference;

use crate::contour::Point;
use crate::names::name_of;
use crate::output::BadInput;
use crate::success_map::{Side, SuccessMap};

/// A map, and all that goes with it into a file.
pub struct Export<'a> {
    pub map: &'a SuccessMap,
    /// Whose tracks are shown.
    pub events: &'a [Event],
    pub reference: &'a Reference,
    /// Probabilities between which areas are filled.
    pub levels: &'a [f64],
}

impl Export<'_> {
    /// Latitude and longitude of metres of the log.
    pub(super) fn degrees(&self, east_m: f64, north_m: f64) -> anyhow::Result<Geographic> {
        degrees(self.reference, (east_m, north_m))
    }

    pub(super) fn has_degrees(&self) -> bool {
        self.reference.system() != ReferenceSystem::Unknown
    }

    /// What stands before the names of numbers of a side: something where there are two.
    pub(super) fn prefix(&self, side: &Side) -> String {
        if self.map.sides.len() == 1 { String::new() } else { format!("{}_", name_of(&side.seen)) }
    }
}

/// Latitude and longitude of metres of a log.
pub(super) fn degrees(reference: &Reference, (east_m, north_m): Point) -> anyhow::Result<Geographic> {
    let place = reference.geographic(east_m, north_m);
    place.ok_or_else(|| BadInput(format!("({east_m:.0}, {north_m:.0}) m is on no map of the Earth")).into())
}
