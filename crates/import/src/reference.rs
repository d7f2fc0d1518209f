//! Where things are: metres of a log, and latitude and longitude.

use pingmap_agent::{Geographic, bounds};
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

/// Latitude and longitude, if both are such.
pub fn geographic(latitude_deg: f64, longitude_deg: f64) -> Option<Geographic> {
    let latitude_deg = bounds::LATITUDE_DEG.check(latitude_deg)?;
    Some(Geographic { latitude_deg, longitude_deg: bounds::LONGITUDE_DEG.check(longitude_deg)? })
}

/// What the metres of a log mean.
pub struct Reference {
    /// For people.
    name: String,
    /// WGS 84, and the plane.
    projections: Option<(Proj, Proj)>,
}

/// What can be wrong with a reference system.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReferenceError {
    /// There is no such system.
    #[error(
        "{name:?} is no reference system in metres that is known; expected one such as EPSG:32619 (UTM zone 19 north)"
    )]
    Unknown {
        /// What was asked for.
        name: String,
    },
}

impl Reference {
    /// Metres about an origin that nobody told: places in degrees have none.
    pub fn unknown() -> Self {
        Self { name: "metres about an origin that the files do not tell".into(), projections: None }
    }

    /// Metres east and north of a place: a transverse Mercator projection about it, on WGS 84. Lengths are true to a millionth within 9 km.
    ///
    /// # Errors
    /// [`ReferenceError::Unknown`] at the poles.
    pub fn about(origin: Geographic) -> Result<Self, ReferenceError> {
        let Geographic { latitude_deg, longitude_deg } = origin;
        let plane = format!(
            "+proj=tmerc +lat_0={latitude_deg} +lon_0={longitude_deg} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m"
        );
        let name = format!("metres east and north of {latitude_deg:.6}, {longitude_deg:.6}");
        Self::of(Proj::from_proj_string(&plane), name)
    }

    /// A projected reference system in metres by its number, `EPSG:32619` for UTM zone 19 north.
    ///
    /// # Errors
    /// [`ReferenceError::Unknown`] for what is none, or has other units.
    pub fn epsg(name: &str) -> Result<Self, ReferenceError> {
        let code = name.trim().to_uppercase();
        let found = Self::of(Proj::from_user_string(&code), format!("eastings and northings of {code}"));
        let in_metres = |plane: &Proj| !plane.is_latlong() && !plane.is_geocent() && plane.to_meter() == 1.0;
        let unknown = || ReferenceError::Unknown { name: name.to_owned() };
        let found = found.map_err(|_| unknown())?;
        if found.projections.as_ref().is_some_and(|(_, plane)| in_metres(plane)) { Ok(found) } else { Err(unknown()) }
    }

    fn of(plane: Result<Proj, proj4rs::errors::Error>, name: String) -> Result<Self, ReferenceError> {
        let ellipsoid = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs");
        match (ellipsoid, plane) {
            (Ok(ellipsoid), Ok(plane)) => Ok(Self { name, projections: Some((ellipsoid, plane)) }),
            _ => Err(ReferenceError::Unknown { name }),
        }
    }

    /// What the metres mean, for people.
    pub fn name(&self) -> &str {
        &self.name
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
        geographic(point.1.to_degrees(), point.0.to_degrees())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metres_and_degrees_come_back() {
        let origin = geographic(41.52, -70.67).unwrap();
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
        let equator = Reference::about(geographic(0.0, -69.0).unwrap()).unwrap();
        let (_, north_m) = equator.metres(Place::Degrees(geographic(45.0, -69.0).unwrap())).unwrap();
        assert!((north_m - 4_984_944.378).abs() < 0.01, "{north_m}");
        let utm = Reference::epsg("EPSG:32619").unwrap();
        let (east_m, utm_north_m) = utm.metres(Place::Degrees(geographic(45.0, -69.0).unwrap())).unwrap();
        assert!((east_m - 500_000.0).abs() < 1e-3 && (utm_north_m - 0.9996 * north_m).abs() < 0.01);
    }

    #[test]
    fn what_is_no_system_in_metres_is_refused() {
        for name in ["EPSG:4326", "EPSG:2264", "EPSG:1", "utm 19", "", "EPSG:99999"] {
            assert!(Reference::epsg(name).is_err(), "{name}");
        }
        assert!(Reference::unknown().metres(Place::Degrees(geographic(1.0, 1.0).unwrap())).is_none());
        assert_eq!(Reference::unknown().metres(Place::Metres(1.0, 2.0)), Some((1.0, 2.0)));
        assert!(Reference::unknown().metres(Place::Metres(f64::NAN, 2.0)).is_none());
    }
}
