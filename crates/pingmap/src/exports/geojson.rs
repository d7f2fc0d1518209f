//! A map as GeoJSON (RFC 7946): WGS 84, longitude first.

use geo_types::Coord;
use geojson::{Feature, FeatureCollection, Geometry, GeometryValue, JsonObject};
use serde_json::{Value, json};

use super::bands::{CONTOURED, bands, not_known};
use super::export::Export;
use crate::cli_enums::name_of;
use crate::tracks::tracks;

/// Returns areas between levels, the area in which the probability is not known, and contours of the probability and of
/// both ends of its interval. Tracks and the positions that the map is seen from follow.
pub fn geojson(export: &Export) -> anyhow::Result<Vec<u8>> {
    let map = export.map;
    let mut features = Vec::new();
    for side in &map.sides {
        let seen = name_of(&side.seen);
        for band in bands(export, side)? {
            let properties = [
                ("probability_from", json!(band.from)),
                ("probability_to", json!(band.to)),
                ("seen_as", json!(seen)),
                ("as", json!(seen)),
            ];
            features.push(feature("area", properties, GeometryValue::from(&band.polygons)));
        }
        if let Some(band) = not_known(export, side)? {
            let properties = [("interval_wider_than", json!(band.from)), ("seen_as", json!(seen)), ("as", json!(seen))];
            features.push(feature("not_known", properties, GeometryValue::from(&band.polygons)));
        }
        for (by, of) in CONTOURED {
            for &level in export.levels {
                let lines = export.contour(&side.values(of), level)?;
                let coordinates = lines.iter().map(|line| positions(line)).collect();
                let properties =
                    [("probability", json!(level)), ("by", json!(by)), ("seen_as", json!(seen)), ("as", json!(seen))];
                features.push(feature("contour", properties, GeometryValue::MultiLineString { coordinates }));
            }
        }
    }
    for (id, points) in tracks(export.events) {
        let geometry = line_geometry(&export.lines(&points)?);
        features.push(feature("track", [("vehicle", json!(id.as_str()))], geometry));
    }
    for place in &map.at {
        let place = export.degrees(place.east_m, place.north_m)?;
        let coordinates = [place.longitude_deg, place.latitude_deg].into();
        let seen: Vec<String> = map.sides.iter().map(|side| name_of(&side.seen)).collect();
        features.push(feature(
            "place",
            [("seen_from", json!(seen.join(" and "))), ("as", json!(seen.join(" and ")))],
            GeometryValue::Point { coordinates },
        ));
    }
    let collection = collection(features);
    Ok(serde_json::to_vec_pretty(&collection)?)
}

/// Returns the geometry of a line that was cut into pieces. A line of one point is a point.
pub(super) fn line_geometry(pieces: &[Vec<Coord<f64>>]) -> GeometryValue {
    match pieces {
        [piece] => match &positions(piece)[..] {
            [place] => GeometryValue::Point { coordinates: place.clone() },
            coordinates => GeometryValue::LineString { coordinates: coordinates.to_vec() },
        },
        pieces => GeometryValue::MultiLineString { coordinates: pieces.iter().map(|piece| positions(piece)).collect() },
    }
}

fn positions(line: &[Coord<f64>]) -> Vec<geojson::Position> {
    line.iter().map(|point| [point.x, point.y].into()).collect()
}

/// Returns a collection of features that names its generator.
pub(super) fn collection(features: Vec<Feature>) -> FeatureCollection {
    let foreign_members = Some([("generator".to_owned(), json!("pingmap"))].into_iter().collect());
    FeatureCollection { bbox: None, features, foreign_members }
}

/// Returns a shape with its kind and properties.
pub(super) fn feature<'a>(
    kind: &str,
    properties: impl IntoIterator<Item = (&'a str, Value)>,
    geometry: GeometryValue,
) -> Feature {
    let mut object = JsonObject::new();
    object.insert("kind".into(), json!(kind));
    object.extend(properties.into_iter().map(|(name, value)| (name.to_owned(), value)));
    Feature { geometry: Some(Geometry::new(geometry)), properties: Some(object), ..Feature::default() }
}
