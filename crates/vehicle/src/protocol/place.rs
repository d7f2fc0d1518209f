//! Places as a host gives them.

use pingmap_agent::VehicleId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A place: metres of the team's chart (`x`, `y`), or degrees (`lat`, `lon`).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Metres east.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub x: Option<f64>,
    /// Metres north.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub y: Option<f64>,
    /// Latitude in degrees north.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lat: Option<f64>,
    /// Longitude in degrees east.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lon: Option<f64>,
    /// Depth in metres below the surface.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub depth: Option<f64>,
    /// Heading in degrees clockwise from north.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub heading: Option<f64>,
}

/// One end of a link in a query: a place, or a member whose latest position counts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum End {
    /// The latest known position of a member, or of the vehicle itself.
    Member(#[schemars(with = "String")] VehicleId),
    /// A place.
    Place(Place),
}

/// A link in a query.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct QueryLink {
    /// The end that transmits.
    pub from: End,
    /// The end that listens.
    pub to: End,
}
