//! A map as GeoJSON (RFC 7946): WGS 84, longitude first.

use geojson::{Feature, FeatureCollection, Geometry, GeometryValue, JsonObject};
use serde_json::{Value, json};

use super::bands::bands;
use super::export::Export;
use crate::cli_enums::name_of;
use crate::grid::Point;
use crate::tracks::tracks;

/// Returns areas between levels, contours, tracks and the positions that the map is seen from.
pub fn geojson(export: &Export) -> anyhow::Result<Vec<u8>> {
    let map = export.map;
    let position = |(east_m, north_m): Point| -> anyhow::Result<geojson::Position> {
        let place = export.degrees(east_m, north_m)?;
        Ok([place.longitude_deg, place.latitude_deg].into())
    };
    let line = |points: &[Point]| points.iter().map(|&point| position(point)).collect::<anyhow::Result<Vec<_>>>();
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
        let values = side.values(|cell| cell.probability);
        for &level in export.levels {
            let lines = map.area.grid(&values).contour_lines(level);
            let coordinates = lines.iter().map(|points| line(points)).collect::<anyhow::Result<Vec<_>>>()?;
            let properties = [("probability", json!(level)), ("seen_as", json!(seen)), ("as", json!(seen))];
            features.push(feature("contour", properties, GeometryValue::MultiLineString { coordinates }));
        }
    }
    for (id, points) in tracks(export.events) {
        let coordinates = line(&points)?;
        let geometry = match &coordinates[..] {
            [place] => GeometryValue::Point { coordinates: place.clone() },
            _ => GeometryValue::LineString { coordinates },
        };
        features.push(feature("track", [("vehicle", json!(id.as_str()))], geometry));
    }
    for place in &map.at {
        let coordinates = position((place.east_m, place.north_m))?;
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
