//! The reference system of an imported log, and the position of (0, 0).

use pingmap_agent::{Geographic, ReferenceSystem};
use pingmap_import::{ImportError, Place, Reference};

use super::records::Records;
use crate::output::BadInput;
use crate::reference::ORIGIN_DISTANCE_MAX_M;

/// Source of the position of (0, 0).
#[derive(Clone, Copy, PartialEq)]
pub enum OriginSource {
    /// An option of the command.
    Option,
    /// The recorded files.
    Files,
    /// The mean of all positions.
    Mean,
}

/// A reference system, and the position of (0, 0) with its source if it is known.
type Choice = (Reference, Option<(Geographic, OriginSource)>);

/// Chooses the reference system: the system of an option, else that of the files, else an origin at the mean of all
/// positions in degrees.
///
/// # Errors
/// Fails if positions are in several systems, or do not fit the option.
pub fn choose_reference(given: Option<ReferenceSystem>, places: &[Place], records: &Records) -> anyhow::Result<Choice> {
    let degrees: Vec<Geographic> = places.iter().filter_map(degrees_of).collect();
    if let Some(system) = given {
        return given_reference(system, places, &degrees, records);
    }
    let with_origin = |origin| Reference::with_origin(origin).map_err(ImportError::from);
    if let Some(datum) = records.datum()? {
        check_origin("the origin in the files,", datum, &degrees)?;
        return Ok((with_origin(datum)?, Some((datum, OriginSource::Files))));
    }
    if degrees.is_empty() {
        return Ok((Reference::unknown(), None));
    }
    if has_metres(places) {
        let message = "some positions are in metres and others in degrees; expected --origin, the latitude and longitude of (0, 0) of \
                       the metres, or --crs";
        return Err(BadInput(message.into()).into());
    }
    let mean = mean_position(&degrees);
    Ok((with_origin(mean)?, Some((mean, OriginSource::Mean))))
}

/// Checks that a reference system from an option fits the positions.
fn given_reference(
    system: ReferenceSystem,
    places: &[Place],
    degrees: &[Geographic],
    records: &Records,
) -> anyhow::Result<Choice> {
    let reference = Reference::new(system).map_err(ImportError::from)?;
    if let ReferenceSystem::About(origin) = system {
        check_origin("--origin", origin, degrees)?;
        return Ok((reference, Some((origin, OriginSource::Option))));
    }
    if let (Some((path, _)), true) = (records.datums.first(), records.has_metres) {
        let message = format!(
            "{}: its metres have an origin of their own and are not of {system}; expected --origin, or no --crs",
            path.display()
        );
        return Err(BadInput(message).into());
    }
    if let Some((east_m, north_m)) = places.iter().find_map(|place| reference.metres(*place)) {
        reference.check_scale(east_m, north_m).map_err(ImportError::from)?;
    }
    Ok((reference, None))
}

/// Checks that an origin is near the positions. `source` names it in the message.
fn check_origin(source: &str, origin: Geographic, degrees: &[Geographic]) -> anyhow::Result<()> {
    let Some(place) = degrees.first() else { return Ok(()) };
    let distance_m = origin.distance_m(place);
    if distance_m <= ORIGIN_DISTANCE_MAX_M {
        return Ok(());
    }
    let swapped = Geographic::new(origin.longitude_deg, origin.latitude_deg);
    let remedy = match swapped.filter(|swapped| swapped.distance_m(place) <= ORIGIN_DISTANCE_MAX_M) {
        Some(swapped) => {
            format!("the latitude first: --origin {},{}", swapped.latitude_deg, swapped.longitude_deg)
        }
        None => "at most 100 km; without --origin the log gets an origin at the mean of the positions".to_owned(),
    };
    let message = format!(
        "{source} {},{} is {:.0} km from a position at {:.4}, {:.4}; expected {remedy}",
        origin.latitude_deg,
        origin.longitude_deg,
        distance_m / 1000.0,
        place.latitude_deg,
        place.longitude_deg
    );
    Err(BadInput(message).into())
}

/// Whether any position is in metres.
pub fn has_metres<'a>(places: impl IntoIterator<Item = &'a Place>) -> bool {
    places.into_iter().any(|place| matches!(place, Place::Metres(..)))
}

fn degrees_of(place: &Place) -> Option<Geographic> {
    match place {
        Place::Degrees(place) => Some(*place),
        Place::Metres(..) => None,
    }
}

/// Returns the mean of positions in degrees. It is rounded to a hundredth, so that logs of one area share it.
fn mean_position(degrees: &[Geographic]) -> Geographic {
    let mean = |of: &dyn Fn(&Geographic) -> f64| {
        (degrees.iter().map(of).sum::<f64>() / degrees.len() as f64 * 100.0).round() / 100.0
    };
    // Longitudes jump at the antimeridian, so the mean is over differences from the first longitude.
    let from_deg = degrees[0].longitude_deg.round();
    let wrap_deg = |east_deg: f64| (east_deg + 180.0).rem_euclid(360.0) - 180.0;
    let east_deg = mean(&|place| wrap_deg(place.longitude_deg - from_deg));
    let longitude_deg = (wrap_deg(from_deg + east_deg) * 100.0).round() / 100.0;
    Geographic { latitude_deg: mean(&|place| place.latitude_deg), longitude_deg }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_between_positions_at_the_antimeridian() {
        let place = |longitude_deg| Geographic { latitude_deg: -17.0, longitude_deg };
        let found = mean_position(&[179.98, -179.98, -179.97].map(place));
        assert!((found.longitude_deg + 179.99).abs() < 1e-9 && found.latitude_deg == -17.0, "{found:?}");
    }
}
