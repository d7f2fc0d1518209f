//! What metres of a log mean: by its own word, by that of a model, or by an option; and places as people name them.

use clap::Args;
use pingmap_agent::{Position, ReferenceSystem};
use pingmap_import::{Place, Reference};
use pingmap_trial::EventLog;
use schemars::JsonSchema;
use serde::Serialize;

use crate::output::BadInput;
use crate::values::{crs, origin};

/// Where on Earth a log is.
#[derive(Args)]
#[command(next_help_heading = "Where on Earth")]
pub struct ReferenceOptions {
    /// Latitude and longitude of (0, 0) of the log, where it does not say so itself
    #[arg(long, value_name = "LAT,LON", value_parser = origin, allow_hyphen_values = true)]
    origin: Option<ReferenceSystem>,
    /// Reference system of the log's eastings and northings, such as EPSG:32619, where it does not say so itself
    #[arg(long, value_name = "EPSG:CODE", value_parser = crs, conflicts_with = "origin")]
    crs: Option<ReferenceSystem>,
}

impl ReferenceOptions {
    /// Tells a log what its metres mean.
    ///
    /// # Errors
    /// Where the log says otherwise, or lies so far from its origin that a plane is no map of it.
    pub fn tell(&self, log: &mut EventLog) -> anyhow::Result<()> {
        if let Some(told) = self.origin.or(self.crs) {
            if !log.reference.agrees_with(&told) {
                let known = log.reference;
                return Err(BadInput(format!("metres are those of {known} by the log, and of {told} by option")).into());
            }
            log.reference = told;
        }
        reference(log.reference)?;
        check_near_origin(log)
    }
}

/// How to reckon with a reference system.
pub fn reference(system: ReferenceSystem) -> Result<Reference, BadInput> {
    Reference::of(system).map_err(|error| BadInput(error.to_string()))
}

/// Where a place is that an option names, in metres of a log.
pub fn position(option: &str, place: Place, reference: &Reference) -> Result<Position, BadInput> {
    let metres = reference.metres(place).map(|(east_m, north_m)| Position::new(east_m, north_m));
    let said = match reference.system() {
        ReferenceSystem::Unknown => "nobody said where the log's metres are: expected metres, or --origin or --crs",
        _ => "that is not on the log's map",
    };
    let metres = metres.ok_or_else(|| BadInput(format!("{option}: {said}")))?;
    let distance_m = metres.east_m.hypot(metres.north_m);
    if matches!(reference.system(), ReferenceSystem::About(_)) && distance_m > ORIGIN_DISTANCE_MAX_M {
        let distance_km = distance_m / 1000.0;
        let said =
            format!("that is {distance_km:.0} km from the origin; expected at most 100 km (another hemisphere?)");
        return Err(BadInput(format!("{option}: {said}")));
    }
    Ok(metres)
}

/// The same of several places; as deep as they say, or else as `depth_m`, which nobody has where the log has no depths.
pub fn positions(
    option: &str,
    places: &[(Place, Option<f64>)],
    reference: &Reference,
    depth_m: Option<f64>,
) -> Result<Vec<Position>, BadInput> {
    let of = |&(place, own_m): &(Place, Option<f64>)| {
        if own_m.is_some() && depth_m.is_none() {
            return Err(BadInput(format!("{option}: the log has no depths; expected a place without one")));
        }
        Ok(Position { depth_m: own_m.or(depth_m), ..position(option, place, reference)? })
    };
    places.iter().map(of).collect()
}

/// A place for programs.
#[derive(Serialize, JsonSchema)]
pub struct PlaceJson {
    /// In metres of the log.
    pub easting_m: f64,
    /// In metres of the log.
    pub northing_m: f64,
    /// Below the surface; where depths count.
    pub depth_m: Option<f64>,
    /// Where it is known what metres mean.
    pub latitude_deg: Option<f64>,
    /// Where it is known what metres mean.
    pub longitude_deg: Option<f64>,
}

impl PlaceJson {
    pub fn of(place: &Position, reference: &Reference) -> Self {
        let degrees = reference.geographic(place.east_m, place.north_m);
        Self {
            easting_m: place.east_m,
            northing_m: place.north_m,
            depth_m: place.depth_m,
            latitude_deg: degrees.map(|degrees| degrees.latitude_deg),
            longitude_deg: degrees.map(|degrees| degrees.longitude_deg),
        }
    }
}

/// A plane tangent to the Earth is no map of it farther out than this.
const ORIGIN_DISTANCE_MAX_M: f64 = 1e5;

/// Checks that (0, 0) of a log is near its events, where that is a place.
fn check_near_origin(log: &EventLog) -> anyhow::Result<()> {
    if !matches!(log.reference, ReferenceSystem::About(_)) {
        return Ok(());
    }
    let ends = log.events.iter().flat_map(|event| event.link.ends());
    let farthest_m = ends.map(|end| end.east_m.hypot(end.north_m)).fold(0.0, f64::max);
    if farthest_m > ORIGIN_DISTANCE_MAX_M {
        let farthest_km = farthest_m / 1000.0;
        let message = format!(
            "the origin is the place of (0, 0), but events lie up to {farthest_km:.0} km from there; expected at most 100 km (are \
             these UTM coordinates? --crs EPSG:CODE says so)"
        );
        return Err(BadInput(message).into());
    }
    Ok(())
}
