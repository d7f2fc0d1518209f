//! Reference systems of logs, from the log, a model or an option; and conversion of places to positions.

use clap::Args;
use pingmap_agent::{Geographic, Position, ReferenceSystem};
use pingmap_import::{Place, Reference};
use pingmap_trial::EventLog;
use schemars::JsonSchema;
use serde::Serialize;

use crate::cli_parsers::{crs, origin};
use crate::output::BadInput;

/// Options that give the reference system of a log.
#[derive(Args)]
#[command(next_help_heading = "Reference system")]
pub struct ReferenceOptions {
    /// Latitude and longitude of (0, 0) of the log, if the log does not contain them
    #[arg(long, value_name = "LAT,LON", value_parser = origin, allow_hyphen_values = true)]
    origin: Option<ReferenceSystem>,
    /// Reference system of the log's eastings and northings, such as EPSG:32619, if the log does not name it
    #[arg(long, value_name = "EPSG:CODE", value_parser = crs, conflicts_with = "origin")]
    crs: Option<ReferenceSystem>,
}

impl ReferenceOptions {
    /// Sets the log's reference system if an option gives it.
    ///
    /// # Errors
    /// Fails if the log names another system, or has events too far from its origin for a plane.
    pub fn apply(&self, log: &mut EventLog) -> anyhow::Result<()> {
        if let Some(given) = self.origin.or(self.crs) {
            if !log.reference.agrees_with(&given) {
                let known = log.reference;
                let message = format!("the log uses {known}, but the option names {given}; expected no such option");
                return Err(BadInput(message).into());
            }
            log.reference = given;
        }
        let reference = reference(log.reference)?;
        if let Some(Position { east_m, north_m, .. }) = log.events.first().map(|event| event.link.transmitter) {
            reference.check_scale(east_m, north_m).map_err(|error| BadInput(error.to_string()))?;
        }
        check_near_origin(log)
    }
}

/// Returns the conversion for a reference system.
pub fn reference(system: ReferenceSystem) -> Result<Reference, BadInput> {
    Reference::new(system).map_err(|error| BadInput(error.to_string()))
}

/// Converts a place that an option names to metres of the log.
pub fn position(option: &str, place: Place, reference: &Reference) -> Result<Position, BadInput> {
    // Places of these options come from tables, whose columns name their unit.
    let is_from_table = ["--along", "--among"].contains(&option);
    if let Some(corrected) = bare_degrees(place, reference).filter(|_| !is_from_table) {
        let message = format!("{option}: these metres seem to be degrees near the log; expected {option} {corrected}");
        return Err(BadInput(message));
    }
    let metres = reference.metres(place).map(|(east_m, north_m)| Position::new(east_m, north_m));
    let reason = match reference.system() {
        ReferenceSystem::Unknown => "the log has no reference system; expected metres, or --origin or --crs",
        _ => "that is not on the log's map",
    };
    let metres = metres.ok_or_else(|| BadInput(format!("{option}: {reason}")))?;
    let distance_m = metres.east_m.hypot(metres.north_m);
    if matches!(reference.system(), ReferenceSystem::About(_)) && distance_m > ORIGIN_DISTANCE_MAX_M {
        let distance_km = distance_m / 1000.0;
        let reason =
            format!("that is {distance_km:.0} km from the origin; expected at most 100 km (another hemisphere?)");
        return Err(BadInput(format!("{option}: {reason}")));
    }
    Ok(metres)
}

/// Largest difference in degrees between the log and metres that seem to be degrees.
const BARE_DEGREES_MAX: f64 = 1.0;

/// Returns the corrected text for metres that seem to be a latitude and longitude near the log, in this or the other
/// order.
fn bare_degrees(place: Place, reference: &Reference) -> Option<String> {
    let Place::Metres(a, b) = place else { return None };
    let is_near = |found: &Geographic| match reference.system() {
        ReferenceSystem::About(origin) => {
            let east_deg = (found.longitude_deg - origin.longitude_deg).abs();
            let north_deg = (found.latitude_deg - origin.latitude_deg).abs();
            north_deg.max(east_deg.min(360.0 - east_deg)) <= BARE_DEGREES_MAX
        }
        // No projected system has eastings and northings of a few metres in its area.
        ReferenceSystem::Epsg(_) => reference.metres(Place::Degrees(*found)).is_some(),
        ReferenceSystem::Unknown => false,
    };
    let orders = [Geographic::new(a, b), Geographic::new(b, a)];
    let found = orders.into_iter().flatten().find(is_near)?;
    let [latitude, longitude] =
        [(found.latitude_deg, "N", "S"), (found.longitude_deg, "E", "W")].map(|(degrees, positive, negative)| {
            format!("{}{}", degrees.abs(), if degrees < 0.0 { negative } else { positive })
        });
    Some(format!("{latitude},{longitude}"))
}

/// Converts several places. Depths that are not given are `depth_m`; a depth is an error if the log has no depths.
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

/// A position in JSON.
#[derive(Serialize, JsonSchema)]
pub struct PlaceJson {
    /// Easting in metres of the log.
    pub easting_m: f64,
    /// Northing in metres of the log.
    pub northing_m: f64,
    /// Depth below the surface in metres, if the log has depths.
    pub depth_m: Option<f64>,
    /// Latitude, if the reference system is known.
    pub latitude_deg: Option<f64>,
    /// Longitude, if the reference system is known.
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

/// Largest distance from the origin of a tangent plane.
pub const ORIGIN_DISTANCE_MAX_M: f64 = 1e5;

/// Checks that the origin of a log is near its events, if the origin is a latitude and longitude.
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
             these UTM coordinates? then give --crs EPSG:CODE)"
        );
        return Err(BadInput(message).into());
    }
    Ok(())
}
