//! Lines, areas and positions of a plan as GeoJSON.

use geojson::{GeometryValue, Position};
use pingmap_import::Reference;
use serde_json::Value;

use super::export::degrees;
use super::geojson::{collection, feature};
use crate::grid::Point;

/// A position, a line or an area, with its properties.
pub struct Line {
    /// Kind of the shape.
    pub kind: &'static str,
    pub shape: Shape,
    /// Names and values of the properties.
    pub properties: Vec<(&'static str, Value)>,
}

/// A shape in metres of the log.
pub enum Shape {
    Place(Point),
    Line(Vec<Point>),
    /// The corners in either direction, each once.
    Area(Vec<Point>),
}

/// Returns the closed ring around an area, counter-clockwise.
pub(super) fn ring(corners: &[Point]) -> Vec<Point> {
    let mut ring = corners.to_vec();
    if twice_the_area(&ring) < 0.0 {
        ring.reverse();
    }
    ring.extend(ring.first().copied());
    ring
}

/// Returns all shapes on WGS 84 (RFC 7946).
pub fn geojson_of_lines(reference: &Reference, lines: &[Line]) -> anyhow::Result<Vec<u8>> {
    let position = |&(east_m, north_m): &Point| -> anyhow::Result<Position> {
        let place = degrees(reference, (east_m, north_m))?;
        Ok([place.longitude_deg, place.latitude_deg].into())
    };
    let positions = |points: &[Point]| points.iter().map(position).collect::<anyhow::Result<Vec<_>>>();
    let one = |line: &Line| {
        let geometry = match &line.shape {
            Shape::Place(place) => GeometryValue::Point { coordinates: position(place)? },
            Shape::Line(points) => GeometryValue::LineString { coordinates: positions(points)? },
            Shape::Area(corners) => GeometryValue::Polygon { coordinates: vec![positions(&ring(corners))?] },
        };
        Ok(feature(line.kind, line.properties.iter().cloned(), geometry))
    };
    let features = lines.iter().map(one).collect::<anyhow::Result<Vec<_>>>()?;
    Ok(serde_json::to_vec_pretty(&collection(features))?)
}

/// Returns twice the area, positive for corners that run counter-clockwise.
fn twice_the_area(corners: &[Point]) -> f64 {
    let next = corners.iter().cycle().skip(1);
    corners.iter().zip(next).map(|(a, b)| a.0 * b.1 - b.0 * a.1).sum()
}
