//! A map as KML, for Google Earth, chart plotters and geographic information systems.

use kml::types::{
    Coord, Element, Folder, Geometry, LineString, LineStyle, LinearRing, MultiGeometry, Placemark, Point, PolyStyle,
    Polygon, Style,
};
use kml::{Kml, KmlDocument, KmlVersion, KmlWriter};

use super::bands::{Band, bands};
use super::export::Export;
use crate::figure::shade;
use crate::names::name_of;
use crate::tracks::tracks;

/// The same for Google Earth and chart plotters.
pub fn kml(export: &Export) -> anyhow::Result<Vec<u8>> {
    let map = export.map;
    let (mut styles, mut folders) = (Vec::new(), Vec::new());
    for side in &map.sides {
        let seen = name_of(&side.seen);
        let mut elements = Vec::new();
        for (n, band) in bands(export, side)?.into_iter().enumerate() {
            let id = format!("{seen}-{n}");
            styles.push(Kml::Style(filled(&id, (band.from + band.to) / 2.0)));
            elements.push(Kml::Placemark(area(&id, &band)));
        }
        folders.push(folder(format!("Probability of success, seen as {seen}"), elements));
    }
    let coord = |east_m: f64, north_m: f64| -> anyhow::Result<Coord> {
        let place = export.degrees(east_m, north_m)?;
        Ok(Coord::new(place.longitude_deg, place.latitude_deg, None))
    };
    let mut elements = Vec::new();
    for (id, points) in tracks(export.events) {
        let coords =
            points.iter().map(|&(east_m, north_m)| coord(east_m, north_m)).collect::<anyhow::Result<Vec<_>>>()?;
        let geometry = match &coords[..] {
            [place] => Geometry::Point(Point::from(*place)),
            _ => Geometry::LineString(LineString { tessellate: true, ..LineString::from(coords) }),
        };
        elements.push(Kml::Placemark(placemark(id.as_str().to_owned(), geometry)));
    }
    folders.push(folder("Tracks".into(), elements));
    let mut elements = Vec::new();
    for place in &map.at {
        let geometry = Geometry::Point(Point::from(coord(place.east_m, place.north_m)?));
        elements.push(Kml::Placemark(placemark("seen from here".into(), geometry)));
    }
    folders.push(folder("Places".into(), elements));
    let document = Kml::Document { attrs: Default::default(), elements: styles.into_iter().chain(folders).collect() };
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

/// An area in the colour of its probability, through which the chart below is seen. Colours are opacity, blue, green, red.
fn filled(id: &str, probability: f64) -> Style {
    let (red, green, blue) = shade(probability);
    let color = |opacity: u8| format!("{opacity:02x}{blue:02x}{green:02x}{red:02x}");
    Style {
        id: Some(id.to_owned()),
        line: Some(LineStyle { color: color(255), width: 1.0, ..LineStyle::default() }),
        poly: Some(PolyStyle { color: color(150), ..PolyStyle::default() }),
        ..Style::default()
    }
}

fn area(style: &str, band: &Band) -> Placemark {
    let ring = |ring: &geo_types::LineString<f64>| {
        LinearRing::from(ring.coords().map(|at| Coord::new(at.x, at.y, None)).collect::<Vec<_>>())
    };
    let polygon = |polygon: &geo_types::Polygon<f64>| {
        let polygon = Polygon::new(ring(polygon.exterior()), polygon.interiors().iter().map(ring).collect());
        Geometry::Polygon(Polygon { tessellate: true, ..polygon })
    };
    let geometries = band.polygons.iter().map(polygon).collect();
    let geometry = Geometry::MultiGeometry(MultiGeometry { geometries, ..MultiGeometry::default() });
    // KML wants the style before the shape; the crate's own field for it comes behind.
    let style_url = Element { name: "styleUrl".into(), content: Some(format!("#{style}")), ..Element::default() };
    Placemark { children: vec![style_url], ..placemark(format!("{} to {}", band.from, band.to), geometry) }
}
