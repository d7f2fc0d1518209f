//! The scale of a reference system: whether its metres are metres on the ground.

use pingmap_agent::{Geographic, ReferenceSystem};

use crate::model::reference::{Place, Reference, ReferenceError};
use crate::model::utm_zone::UtmZone;

/// Largest deviation of the scale from 1. UTM deviates by at most 0.1 % within its zone.
const SCALE_DEVIATION_MAX: f64 = 0.01;

/// Length in metres over which the scale is measured.
const BASELINE_M: f64 = 100.0;

impl Reference {
    /// Checks that the metres of the reference system are metres on the ground at a position of the log.
    ///
    /// # Errors
    /// [`ReferenceError::Scale`] if a length deviates by more than 1 %, as in Mercator projections, or far outside of a
    /// UTM zone.
    pub fn check_scale(&self, east_m: f64, north_m: f64) -> Result<(), ReferenceError> {
        let ReferenceSystem::Epsg(_) = self.system() else { return Ok(()) };
        let Some((place, scales)) = self.scales(east_m, north_m) else { return Ok(()) };
        let wrong = scales.into_iter().find(|scale| (scale - 1.0).abs() > SCALE_DEVIATION_MAX);
        let system = self.system();
        wrong.map_or(Ok(()), |scale| Err(ReferenceError::Scale { system, place, scale, utm: UtmZone::at(place) }))
    }

    /// Returns the place of a position, and the length on the ground of one metre of the system, eastwards and
    /// northwards.
    fn scales(&self, east_m: f64, north_m: f64) -> Option<(Geographic, [f64; 2])> {
        let place = self.geographic(east_m, north_m)?;
        let ground = Reference::with_origin(place).ok()?;
        let scale = |east_m: f64, north_m: f64| {
            let end = self.geographic(east_m, north_m)?;
            let (x_m, y_m) = ground.metres(Place::Degrees(end))?;
            Some(x_m.hypot(y_m) / BASELINE_M)
        };
        Some((place, [scale(east_m + BASELINE_M, north_m)?, scale(east_m, north_m + BASELINE_M)?]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(name: &str, latitude_deg: f64, longitude_deg: f64) -> Result<(), ReferenceError> {
        let reference = Reference::epsg(name).unwrap();
        let place = Place::Degrees(Geographic::new(latitude_deg, longitude_deg).unwrap());
        let (east_m, north_m) = reference.metres(place).unwrap();
        reference.check_scale(east_m, north_m)
    }

    #[test]
    fn systems_with_other_lengths_than_on_the_ground_are_refused() {
        for name in ["EPSG:3857", "EPSG:3395", "EPSG:3832", "EPSG:4087"] {
            let error = check(name, 43.6, -70.3).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("EPSG:32619 (UTM zone 19 north)"), "{error}");
        }
        // A wrong zone stretches lengths, too.
        assert!(check("EPSG:32632", 43.6, -15.0).is_err());
        for (name, latitude_deg, longitude_deg) in [
            ("EPSG:32619", 43.6, -70.3),
            ("EPSG:32760", -17.2, 179.9),
            ("EPSG:3035", 54.0, 10.0),
            ("EPSG:3857", 0.0, 9.0),
        ] {
            check(name, latitude_deg, longitude_deg).unwrap();
        }
    }

    #[test]
    fn the_scale_of_web_mercator_is_the_cosine_of_the_latitude() {
        let reference = Reference::epsg("EPSG:3857").unwrap();
        let (east_m, north_m) = reference.metres(Place::Degrees(Geographic::new(60.0, 5.0).unwrap())).unwrap();
        let (_, [east, north]) = reference.scales(east_m, north_m).unwrap();
        // The system projects the ellipsoid as if it were a sphere, so the scales deviate by up to 0.7 %.
        assert!((east - 0.5).abs() < 0.005 && (north - 0.5).abs() < 0.005, "{east} {north}");
    }
}
