//! Areas between levels of probability, as polygons.

use anyhow::Context;
use contour::ContourBuilder;
use geo_types::{LineString, MultiPolygon};

use super::antimeridian::cut_areas;
use super::export::{Export, Quantity};
use crate::success_map::{Cell, Side};

/// An area with a probability between two levels, in degrees. Outer rings run counter-clockwise, holes clockwise.
pub(super) struct Band {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) polygons: MultiPolygon<f64>,
}

/// Returns the non-empty bands of a side, the least probable first.
pub(super) fn bands(export: &Export, side: &Side) -> anyhow::Result<Vec<Band>> {
    let mut limits = vec![0.0];
    limits.extend(export.levels);
    // Probability 1 belongs to the last band, so the upper limit of that band is above 1.
    limits.push(1.0 + 1e-9);
    between(export, &side.values(|cell| cell.probability), &limits)
}

/// Returns the area in which the probability is not known, if there is any.
pub(super) fn not_known(export: &Export, side: &Side) -> anyhow::Result<Option<Band>> {
    Ok(between(export, &side.values(Cell::width), &[export.hatch_width, 1.0 + 1e-9])?.pop())
}

/// Returns the non-empty areas between successive limits of the cells' values.
fn between(export: &Export, values: &[f64], limits: &[f64]) -> anyhow::Result<Vec<Band>> {
    let area = &export.map.area;
    // Rings run between the centres of cells, and half a cell farther out at the edge of the map.
    let builder = ContourBuilder::new(area.columns, area.rows, true)
        .x_origin(area.east.0)
        .y_origin(area.north.0)
        .x_step(area.cell_m)
        .y_step(area.cell_m);
    let found = builder.isobands(values, limits).context("areas of a map")?;
    let mut bands = Vec::new();
    for band in found {
        let (mut polygons, from, to) = band.into_inner();
        for polygon in &mut polygons.0 {
            let mut failed = None;
            polygon.exterior_mut(|ring| failed = turned(export, ring, 1.0).err());
            polygon.interiors_mut(|rings| {
                for ring in rings {
                    failed = failed.take().or(turned(export, ring, -1.0).err());
                }
            });
            failed.map_or(Ok(()), Err)?;
        }
        let polygons = cut_areas(polygons);
        if !polygons.0.is_empty() {
            bands.push(Band { from, to: to.min(1.0), polygons });
        }
    }
    Ok(bands)
}

/// The quantities that have contours, with their names in files.
pub(super) const CONTOURED: [Quantity; 3] =
    [("probability", |cell| cell.probability), ("lower", |cell| cell.lower), ("upper", |cell| cell.upper)];

/// Converts a ring to degrees and orients it: counter-clockwise for a positive sign.
fn turned(export: &Export, ring: &mut LineString<f64>, sign: f64) -> anyhow::Result<()> {
    let pairs = ring.0.windows(2);
    let area: f64 = pairs.map(|pair| pair[0].x * pair[1].y - pair[1].x * pair[0].y).sum();
    if area * sign < 0.0 {
        ring.0.reverse();
    }
    for corner in &mut ring.0 {
        let place = export.degrees(corner.x, corner.y)?;
        (corner.x, corner.y) = (place.longitude_deg, place.latitude_deg);
    }
    Ok(())
}
