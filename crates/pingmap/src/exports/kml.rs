//! Maps and plans as KML, for Google Earth, chart plotters and geographic information systems.

use kml::types::{
    Coord, Element, Folder, Geometry, LineString, LineStyle, LinearRing, MultiGeometry, Placemark, Point, PolyStyle,
    Polygon, Style,
};
use kml::{Kml, KmlDocument, KmlVersion, KmlWriter};
use pingmap_import::Reference;
use serde_json::Value;

use super::antimeridian::{cut_area, cut_line};
use super::bands::{Band, CONTOURED, bands, not_known};
use super::export::{Export, coords};
use super::lines::{Line, Shape, area};
use crate::cli_enums::name_of;
use crate::figure::{Palette, shade};
use crate::tracks::tracks;

/// Returns areas between levels, the area in which the probability is not known, and contours. Tracks and the positions
/// that the map is seen from follow.
pub fn kml(export: &Export) -> anyhow::Result<Vec<u8>> {
    let map = export.map;
    let (mut styles, mut folders) = (vec![Kml::Style(white_over_areas())], Vec::new());
    for side in &map.sides {
        let seen = name_of(&side.seen);
        let mut elements = Vec::new();
        for (n, band) in bands(export, side)?.into_iter().enumerate() {
            let id = format!("{seen}-{n}");
            styles.push(Kml::Style(filled(&id, (band.from + band.to) / 2.0)));
            elements.push(Kml::Placemark(band_area(&id, format!("{} to {}", band.from, band.to), &band)));
        }
        if let Some(band) = not_known(export, side)? {
            let name = format!("not known: interval wider than {}", band.from);
            elements.push(Kml::Placemark(band_area(NOT_KNOWN, name, &band)));
        }
        for (by, of) in CONTOURED {
            for &level in export.levels {
                let lines = export.contour(&side.values(of), level)?;
                if !lines.is_empty() {
                    elements.push(Kml::Placemark(placemark(format!("{level} by {by}"), line_geometry(&lines))));
                }
            }
        }
        folders.push(folder(format!("Probability of success, seen as {seen}"), elements));
    }
    let mut elements = Vec::new();
    for (id, points) in tracks(export.events) {
        let geometry = line_geometry(&export.lines(&points)?);
        elements.push(Kml::Placemark(placemark(id.as_str().to_owned(), geometry)));
    }
    folders.push(folder("Tracks".into(), elements));
    let mut elements = Vec::new();
    for place in &map.at {
        let geometry = line_geometry(&export.lines(&[(place.east_m, place.north_m)])?);
        elements.push(Kml::Placemark(placemark("seen from here".into(), geometry)));
    }
    folders.push(folder("Places".into(), elements));
    document(styles.into_iter().chain(folders).collect())
}

/// Returns positions, lines and areas of a plan, each with its properties.
pub fn kml_of_lines(reference: &Reference, lines: &[Line]) -> anyhow::Result<Vec<u8>> {
    let mut elements = Vec::new();
    for line in lines {
        let geometry = match &line.shape {
            Shape::Place(place) => line_geometry(&[coords(reference, &[*place])?]),
            Shape::Line(points) => line_geometry(&cut_line(coords(reference, points)?)),
            Shape::Area(corners) => area_geometry(&cut_area(area(reference, corners)?)),
        };
        let name = line.properties.iter().find(|(name, _)| *name == "name").and_then(|(_, name)| name.as_str());
        let style_url = Element { name: "styleUrl".into(), content: Some("#plan".into()), ..Element::default() };
        let children = [style_url].into_iter().chain(data(&line.properties)).collect();
        elements
            .push(Kml::Placemark(Placemark { children, ..placemark(name.unwrap_or(line.kind).to_owned(), geometry) }));
    }
    let red = |opacity: u8| format!("{opacity:02x}0000d0");
    let style = Style {
        id: Some("plan".to_owned()),
        line: Some(LineStyle { color: red(255), width: 2.0, ..LineStyle::default() }),
        poly: Some(PolyStyle { color: red(40), ..PolyStyle::default() }),
        ..Style::default()
    };
    document(vec![Kml::Style(style), folder("Plan".into(), elements)])
}

/// Returns the properties of a shape, without its name, as the data that programs show for it.
fn data(properties: &[(&'static str, Value)]) -> Option<Element> {
    let one = |(name, value): &(&'static str, Value)| {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        let value = Element { name: "value".into(), content: Some(text), ..Element::default() };
        let attrs = [("name".to_owned(), (*name).to_owned())].into();
        Element { name: "Data".into(), attrs, children: vec![value], ..Element::default() }
    };
    let children: Vec<Element> = properties.iter().filter(|(name, _)| *name != "name").map(one).collect();
    (!children.is_empty()).then(|| Element { name: "ExtendedData".into(), children, ..Element::default() })
}

/// Returns a document with these elements.
fn document(elements: Vec<Kml>) -> anyhow::Result<Vec<u8>> {
    let document = Kml::Document { attrs: Default::default(), elements };
    let attrs = [("xmlns".to_owned(), "http://www.opengis.net/kml/2.2".to_owned())].into();
    let document = KmlDocument { version: KmlVersion::V22, attrs, elements: vec![document] };
    let mut bytes = HEAD.as_bytes().to_vec();
    KmlWriter::<_, f64>::from_writer(&mut bytes).write(&Kml::KmlDocument(document))?;
    Ok(bytes)
}

const HEAD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<!-- Written by pingmap. -->\n";

fn folder(name: String, elements: Vec<Kml>) -> Kml {
    Kml::Folder(Folder { name: Some(name), elements, ..Folder::default() })
}

fn placemark(name: String, geometry: Geometry) -> Placemark {
    Placemark { name: Some(name), geometry: Some(geometry), ..Placemark::default() }
}

/// Returns the style of an area: the colour of its probability, partly transparent. Colours are opacity, blue, green,
/// red.
fn filled(id: &str, probability: f64) -> Style {
    let (red, green, blue) = shade(probability, Palette::BlueToYellow);
    let color = |opacity: u8| format!("{opacity:02x}{blue:02x}{green:02x}{red:02x}");
    Style {
        id: Some(id.to_owned()),
        line: Some(LineStyle { color: color(255), width: 1.0, ..LineStyle::default() }),
        poly: Some(PolyStyle { color: color(150), ..PolyStyle::default() }),
        ..Style::default()
    }
}

/// Name of the style of areas in which the probability is not known.
const NOT_KNOWN: &str = "not-known";

/// Returns the style of these areas: white, more opaque than the areas below.
fn white_over_areas() -> Style {
    Style {
        id: Some(NOT_KNOWN.to_owned()),
        line: Some(LineStyle { color: "ff000000".into(), width: 1.0, ..LineStyle::default() }),
        poly: Some(PolyStyle { color: "b0ffffff".into(), ..PolyStyle::default() }),
        ..Style::default()
    }
}

fn band_area(style: &str, name: String, band: &Band) -> Placemark {
    let geometry = area_geometry(&band.polygons.0);
    // KML requires the style before the shape, but the crate's own field writes the style after it.
    let style_url = Element { name: "styleUrl".into(), content: Some(format!("#{style}")), ..Element::default() };
    Placemark { children: vec![style_url], ..placemark(name, geometry) }
}

/// Returns the geometry of an area that was cut into parts.
fn area_geometry(parts: &[geo_types::Polygon<f64>]) -> Geometry {
    let ring = |ring: &geo_types::LineString<f64>| LinearRing::from(kml_coords(&ring.0));
    let polygon = |polygon: &geo_types::Polygon<f64>| {
        let polygon = Polygon::new(ring(polygon.exterior()), polygon.interiors().iter().map(ring).collect());
        Geometry::Polygon(Polygon { tessellate: true, ..polygon })
    };
    joined(parts.iter().map(polygon).collect())
}

/// Returns the geometry of a line that was cut into pieces. A line of one point is a point.
fn line_geometry(pieces: &[Vec<geo_types::Coord<f64>>]) -> Geometry {
    let line = |piece: &Vec<geo_types::Coord<f64>>| match &kml_coords(piece)[..] {
        [place] => Geometry::Point(Point::from(*place)),
        coords => Geometry::LineString(LineString { tessellate: true, ..LineString::from(coords.to_vec()) }),
    };
    joined(pieces.iter().map(line).collect())
}

/// Returns a geometry as it is, and several as one.
fn joined(mut geometries: Vec<Geometry>) -> Geometry {
    match geometries.len() {
        1 => geometries.remove(0),
        _ => Geometry::MultiGeometry(MultiGeometry { geometries, ..MultiGeometry::default() }),
    }
}

fn kml_coords(line: &[geo_types::Coord<f64>]) -> Vec<Coord> {
    line.iter().map(|at| Coord::new(at.x, at.y, None)).collect()
}
