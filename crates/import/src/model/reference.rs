//! Where things are: metres of a log, and latitude and longitude.

use std::str::FromStr;

use pingmap_agent::{Geographic, NoReferenceSystem, ReferenceSystem, bounds};
use proj4rs::Proj;
use proj4rs::transform::transform;

/// A place as somebody wrote it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// Metres east and north of the origin that the log will have.
    Metres(f64, f64),
    /// On the ellipsoid.
    Degrees(Geographic),
}

/// What a place may be written as.
const PLACE: &str = "expected EAST,NORTH in metres, or degrees such as 41.52N,70.67W";

impl FromStr for Place {
    type Err = &'static str;

    /// Metres as two numbers, degrees as two numbers with the letters of their halves of the Earth.
    fn from_str(text: &str) -> Result<Self, &'static str> {
        let (a, b) = text.split_once(',').ok_or(PLACE)?;
        let (a, b) = (a.trim(), b.trim());
        let degrees = |text: &str, halves: [char; 2]| {
            let half = halves.into_iter().position(|half| text.ends_with([half, half.to_ascii_lowercase()]))?;
            let number = text[..text.len() - 1].trim().parse::<f64>().ok().filter(|number| *number >= 0.0)?;
            Some(if half == 0 { number } else { -number })
        };
        let metres = |text: &str| text.parse::<f64>().ok().and_then(|number| bounds::COORDINATE_M.check(number));
        let of_degrees = degrees(a, ['N', 'S']).zip(degrees(b, ['E', 'W']));
        match of_degrees {
            Some((a, b)) => Geographic::new(a, b).map(Place::Degrees).ok_or(PLACE),
            None => metres(a).zip(metres(b)).map(|(a, b)| Place::Metres(a, b)).ok_or(PLACE),
        }
    }
}

/// What the metres of a log mean, and how to reckon with it.
pub struct Reference {
    system: ReferenceSystem,
    /// WGS 84, and the plane; nothing where nobody knows what the metres mean.
    projections: Option<(Proj, Proj)>,
}

/// What can be wrong with a reference system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// There is no such system.
    #[error(
        "{system} is no reference system in metres that is known; expected one such as EPSG:32619 (UTM zone 19 north)"
    )]
    Unknown {
        /// What was asked for.
        system: ReferenceSystem,
    },
    /// It is no name of a system.
    #[error(transparent)]
    NoName(#[from] NoReferenceSystem),
}

impl Reference {
    /// Metres about an origin that nobody told: places in degrees have none.
    pub fn unknown() -> Self {
        Self { system: ReferenceSystem::Unknown, projections: None }
    }

    /// That of a log.
    ///
    /// # Errors
    /// [`ReferenceError::Unknown`] for a system that is none, or has other units than metres.
    pub fn of(system: ReferenceSystem) -> Result<Self, ReferenceError> {
        let plane = match system {
            ReferenceSystem::Unknown => return Ok(Self::unknown()),
            ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => Proj::from_proj_string(&format!(
                "+proj=tmerc +lat_0={latitude_deg} +lon_0={longitude_deg} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
            )),
            ReferenceSystem::Epsg(_) => Proj::from_user_string(&system.to_string()),
        };
        let in_metres = |plane: &Proj| !plane.is_latlong() && !plane.is_geocent() && plane.to_meter() == 1.0;
        let ellipsoid = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok();
        let projections = ellipsoid.zip(plane.ok().filter(in_metres)).ok_or(ReferenceError::Unknown { system })?;
        Ok(Self { system, projections: Some(projections) })
    }

    /// Metres east and north of a place ([`ReferenceSystem::About`]).
    ///
    /// # Errors
    /// As [`Reference::of`].
    pub fn about(origin: Geographic) -> Result<Self, ReferenceError> {
        Self::of(ReferenceSystem::About(origin))
    }

    /// A projected reference system in metres by its number, `EPSG:32619` for UTM zone 19 north.
    ///
    /// # Errors
    /// As [`Reference::of`], and [`ReferenceError::NoName`].
    pub fn epsg(name: &str) -> Result<Self, ReferenceError> {
        match name.parse()? {
            system @ ReferenceSystem::Epsg(_) => Self::of(system),
            _ => Err(NoReferenceSystem(name.to_owned()).into()),
        }
    }

    /// Its name.
    pub fn system(&self) -> ReferenceSystem {
        self.system
    }

    /// What the metres mean, for people.
    pub fn name(&self) -> String {
        match self.system {
            ReferenceSystem::Unknown => "metres about an origin that the files do not tell".to_owned(),
            ReferenceSystem::About(Geographic { latitude_deg, longitude_deg }) => {
                format!("metres east and north of {latitude_deg:.6}, {longitude_deg:.6}")
            }
            ReferenceSystem::Epsg(_) => format!("eastings and northings of {}", self.system),
        }
    }

    /// Metres of the log; `None` for degrees where the origin is not known, or where the projection ends.
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

    /// Latitude and longitude of metres of the log; `None` where these mean nothing.
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
    fn metres_and_degrees_come_back() {
        let origin = Geographic::new(41.52, -70.67).unwrap();
        for reference in [Reference::about(origin).unwrap(), Reference::epsg("epsg:32619").unwrap()] {
            let (east_m, north_m) = reference.metres(Place::Degrees(origin)).unwrap();
            let found = reference.geographic(east_m + 1500.0, north_m - 900.0).unwrap();
            let (again_east, again_north) = reference.metres(Place::Degrees(found)).unwrap();
            assert!((again_east - east_m - 1500.0).abs() < 1e-6 && (again_north - north_m + 900.0).abs() < 1e-6);
        }
    }

    /// Figures of the Geographical Survey's own worked example would be as good: a quadrant of the meridian is 10 001 965.729 m, and a
    /// UTM central meridian has easting 500 000 and the scale .9996.
    #[test]
    fn projections_are_those_of_the_ellipsoid() {
        let equator = Reference::about(Geographic::new(0.0, -69.0).unwrap()).unwrap();
        let (_, north_m) = equator.metres(Place::Degrees(Geographic::new(45.0, -69.0).unwrap())).unwrap();
        assert!((north_m - 4_984_944.378).abs() < 0.01, "{north_m}");
        let utm = Reference::epsg("EPSG:32619").unwrap();
        let (east_m, utm_north_m) = utm.metres(Place::Degrees(Geographic::new(45.0, -69.0).unwrap())).unwrap();
        assert!((east_m - 500_000.0).abs() < 1e-3 && (utm_north_m - 0.9996 * north_m).abs() < 0.01);
    }

    #[test]
    fn places_are_metres_or_degrees() {
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
    fn what_is_no_system_in_metres_is_refused() {
        for name in ["EPSG:4326", "EPSG:2264", "EPSG:1", "utm 19", "", "EPSG:99999"] {
            assert!(Reference::epsg(name).is_err(), "{name}");
        }
        assert!(Reference::unknown().metres(Place::Degrees(Geographic::new(1.0, 1.0).unwrap())).is_none());
        assert_eq!(Reference::unknown().metres(Place::Metres(1.0, 2.0)), Some((1.0, 2.0)));
        assert!(Reference::unknown().metres(Place::Metres(f64::NAN, 2.0)).is_none());
    }
}
