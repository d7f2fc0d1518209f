//! The reference system: conversion between metres of a log, and latitude and longitude.

use std::str::FromStr;

use pingmap_agent::{Geographic, NoReferenceSystem, ReferenceSystem, bounds};
use proj4rs::Proj;
use proj4rs::transform::transform;

use crate::model::utm_zone::UtmZone;

/// A horizontal position, in metres or in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// Metres east and north of the origin of the log.
    Metres(f64, f64),
    /// Latitude and longitude on the WGS 84 ellipsoid.
    Degrees(Geographic),
}

/// The accepted formats of a place, for error messages.
const PLACE: &str = "expected EAST,NORTH in metres, or degrees such as 41.52N,70.67W";

impl FromStr for Place {
    type Err = &'static str;

    /// Parses two numbers as metres. Degrees are two numbers with the letters of their hemispheres.
    fn from_str(text: &str) -> Result<Self, &'static str> {
        let (a, b) = text.split_once(',').ok_or(PLACE)?;
        let (a, b) = (a.trim(), b.trim());
        let degrees = |text: &str, hemispheres: [char; 2]| {
            let hemisphere = hemispheres
                .into_iter()
                .position(|hemisphere| text.ends_with([hemisphere, hemisphere.to_ascii_lowercase()]))?;
            let number = text[..text.len() - 1].trim().parse::<f64>().ok().filter(|number| *number >= 0.0)?;
            Some(if hemisphere == 0 { number } else { -number })
        };
        let metres = |text: &str| text.parse::<f64>().ok().and_then(|number| bounds::COORDINATE_M.check(number));
        let place_in_degrees = degrees(a, ['N', 'S']).zip(degrees(b, ['E', 'W']));
        match place_in_degrees {
            Some((a, b)) => Geographic::new(a, b).map(Place::Degrees).ok_or(PLACE),
            None => metres(a).zip(metres(b)).map(|(a, b)| Place::Metres(a, b)).ok_or(PLACE),
        }
    }
}

/// A reference system with its projection.
#[derive(Clone)]
pub struct Reference {
    system: ReferenceSystem,
    /// The ellipsoid WGS 84 and the plane; `None` if the reference system is unknown.
    projections: Option<(Proj, Proj)>,
}

/// An error in a reference system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// The system is unknown, or its unit is not the metre.
    #[error("{system} is not a known reference system in metres; expected one such as EPSG:32619 (UTM zone 19 north)")]
    Unknown {
        /// The system that was requested.
        system: ReferenceSystem,
    },
    /// The metres of the system are no metres on the ground.
    #[error(
        "100 m of {system} are {:.0} m on the ground at {:.2}, {:.2}; expected a system with true metres there, such as {utm}",
        100.0 * scale, place.latitude_deg, place.longitude_deg
    )]
    Scale {
        /// The system that was requested.
        system: ReferenceSystem,
        /// A position of the log.
        place: Geographic,
        /// The length on the ground of one metre of the system.
        scale: f64,
        /// The UTM zone of the position.
        utm: UtmZone,
    },
    /// The text is not the name of a reference system.
    #[error(transparent)]
    NoName(#[from] NoReferenceSystem),
}

impl Reference {
    /// Returns a system of metres with an unknown origin. It cannot convert degrees.
    pub fn unknown() -> Self {
        Self { system: ReferenceSystem::Unknown, projections: None }
    }

    /// Makes the projection of a reference system.
    ///
    /// # Errors
    /// [`ReferenceError::Unknown`] if the system does not exist, or its unit is not the metre.
    pub fn new(system: ReferenceSystem) -> Result<Self, ReferenceError> {
        let plane = match system {
            ReferenceSystem::Unknown => return Ok(Self::unknown()),
            ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => Proj::from_proj_string(&format!(
                "+proj=tmerc +lat_0={latitude_deg} +lon_0={longitude_deg} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
            )),
            ReferenceSystem::Epsg(_) => Proj::from_user_string(&system.to_string()),
        };
        let is_in_metres = |plane: &Proj| !plane.is_latlong() && !plane.is_geocent() && plane.to_meter() == 1.0;
        let ellipsoid = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok();
        let projections = ellipsoid.zip(plane.ok().filter(is_in_metres)).ok_or(ReferenceError::Unknown { system })?;
        Ok(Self { system, projections: Some(projections) })
    }

    /// Makes a system of metres east and north of an origin ([`ReferenceSystem::About`]).
    ///
    /// # Errors
    /// Those of [`Reference::new`].
    pub fn with_origin(origin: Geographic) -> Result<Self, ReferenceError> {
        Self::new(ReferenceSystem::About(origin))
    }

    /// Makes a projected reference system from its EPSG code, such as `EPSG:32619` for UTM zone 19 north.
    ///
    /// # Errors
    /// Those of [`Reference::new`], and [`ReferenceError::NoName`].
    pub fn epsg(name: &str) -> Result<Self, ReferenceError> {
        match name.parse()? {
            system @ ReferenceSystem::Epsg(_) => Self::new(system),
            _ => Err(NoReferenceSystem(name.to_owned()).into()),
        }
    }

    /// Returns the reference system.
    pub fn system(&self) -> ReferenceSystem {
        self.system
    }

    /// Describes the coordinates for people.
    pub fn name(&self) -> String {
        match self.system {
            ReferenceSystem::Unknown => "metres about an origin that the files do not state".to_owned(),
            ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => {
                format!("metres east and north of {latitude_deg:.6}, {longitude_deg:.6}")
            }
            ReferenceSystem::Epsg(_) => format!("eastings and northings of {}", self.system),
        }
    }

    /// Converts a place to metres of the log. Returns `None` outside of the projection, and for degrees if the origin
    /// is unknown.
    pub fn metres(&self, place: Place) -> Option<(f64, f64)> {
        let (east_m, north_m) = match place {
            Place::Metres(east_m, north_m) => (east_m, north_m),
            Place::Degrees(Geographic { latitude_deg, longitude_deg }) => {
                let (ellipsoid, plane) = self.projections.as_ref()?;
                let mut point = (longitude_deg.to_radians(), latitude_deg.to_radians(), 0.0);
                transform(ellipsoid, plane, &mut point).ok()?;
                (point.0, point.1)
            }
        };
        Some((bounds::COORDINATE_M.check(east_m)?, bounds::COORDINATE_M.check(north_m)?))
    }

    /// Converts metres of the log to latitude and longitude. Returns `None` if the origin is unknown, or outside of the
    /// projection.
    pub fn geographic(&self, east_m: f64, north_m: f64) -> Option<Geographic> {
        let (ellipsoid, plane) = self.projections.as_ref()?;
        let mut point = (east_m, north_m, 0.0);
        transform(plane, ellipsoid, &mut point).ok()?;
        Geographic::new(point.1.to_degrees(), point.0.to_degrees())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversion_to_degrees_and_back_keeps_metres() {
        let origin = Geographic::new(41.52, -70.67).unwrap();
        for reference in [Reference::with_origin(origin).unwrap(), Reference::epsg("epsg:32619").unwrap()] {
            let (east_m, north_m) = reference.metres(Place::Degrees(origin)).unwrap();
            let found = reference.geographic(east_m + 1500.0, north_m - 900.0).unwrap();
            let (returned_east_m, returned_north_m) = reference.metres(Place::Degrees(found)).unwrap();
            assert!(
                (returned_east_m - east_m - 1500.0).abs() < 1e-6 && (returned_north_m - north_m + 900.0).abs() < 1e-6
            );
        }
    }

    /// Compares with two properties of WGS 84: a quarter of a meridian is 10 001 965.729 m long. A central meridian of
    /// UTM has the easting 500 000 and the scale 0.9996.
    #[test]
    fn projections_agree_with_known_lengths_on_the_ellipsoid() {
        let equator = Reference::with_origin(Geographic::new(0.0, -69.0).unwrap()).unwrap();
        let (_, north_m) = equator.metres(Place::Degrees(Geographic::new(45.0, -69.0).unwrap())).unwrap();
        assert!((north_m - 4_984_944.378).abs() < 0.01, "{north_m}");
        let utm = Reference::epsg("EPSG:32619").unwrap();
        let (east_m, utm_north_m) = utm.metres(Place::Degrees(Geographic::new(45.0, -69.0).unwrap())).unwrap();
        assert!((east_m - 500_000.0).abs() < 1e-3 && (utm_north_m - 0.9996 * north_m).abs() < 0.01);
    }

    #[test]
    fn places_are_parsed_as_metres_or_degrees() {
        let degrees = |a, b| Place::Degrees(Geographic::new(a, b).unwrap());
        for (text, place) in [
            ("600,-40.5", Place::Metres(600.0, -40.5)),
            ("41.52N, 70.67W", degrees(41.52, -70.67)),
            ("17s,179.5e", degrees(-17.0, 179.5)),
        ] {
            assert_eq!(text.parse(), Ok(place));
        }
        for wrong in
            ["", "1", "1,2,3", "41.5N,70.6", "95N,0E", "41.5W,70.6N", "-41.5N,70E", "NaN,1", "1e10,0", "é,é", "N,E"]
        {
            assert_eq!(wrong.parse::<Place>(), Err(PLACE), "{wrong}");
        }
    }

    #[test]
    fn a_system_without_metres_is_refused() {
        for name in ["EPSG:4326", "EPSG:2264", "EPSG:1", "utm 19", "", "EPSG:99999"] {
            assert!(Reference::epsg(name).is_err(), "{name}");
        }
        assert!(Reference::unknown().metres(Place::Degrees(Geographic::new(1.0, 1.0).unwrap())).is_none());
        assert_eq!(Reference::unknown().metres(Place::Metres(1.0, 2.0)), Some((1.0, 2.0)));
        assert!(Reference::unknown().metres(Place::Metres(f64::NAN, 2.0)).is_none());
    }
}
