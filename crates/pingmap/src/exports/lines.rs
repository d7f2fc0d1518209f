//! Lines, areas and positions of a plan as GeoJSON.

use geo_types::{LineString, MultiPolygon, Polygon};
use geojson::GeometryValue;
use pingmap_import::Reference;
use serde_json::Value;

use super::antimeridian::{cut_area, cut_line};
use super::export::coords;
use super::geojson::{collection, feature, line_geometry};
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
fn ring(corners: &[Point]) -> Vec<Point> {
    let mut ring = corners.to_vec();
    if twice_the_area(&ring) < 0.0 {
        ring.reverse();
    }
    ring.extend(ring.first().copied());
    ring
}

/// Returns an area in longitudes and latitudes.
pub(super) fn area(reference: &Reference, corners: &[Point]) -> anyhow::Result<Polygon<f64>> {
    Ok(Polygon::new(LineString(coords(reference, &ring(corners))?), Vec::new()))
}

fn area_geometry(parts: &[Polygon<f64>]) -> GeometryValue {
    match parts {
        [part] => GeometryValue::from(part),
        parts => GeometryValue::from(&MultiPolygon(parts.to_vec())),
    }
}

/// Returns all shapes on WGS 84 (RFC 7946).
pub fn geojson_of_lines(reference: &Reference, lines: &[Line]) -> anyhow::Result<Vec<u8>> {
    let one = |line: &Line| {
        let geometry = match &line.shape {
            Shape::Place(place) => line_geometry(&[coords(reference, &[*place])?]),
            Shape::Line(points) => line_geometry(&cut_line(coords(reference, points)?)),
            Shape::Area(corners) => area_geometry(&cut_area(area(reference, corners)?)),
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
