//! Positions from coordinates that a log records one at a time.

use pingmap_agent::{Geographic, bounds};

use crate::model::recording::Fix;
use crate::model::reference::{Place, Reference};

/// Largest time between the two coordinates of one position, in seconds.
const PAIR_S: f64 = 0.5;

/// Largest time between a position in degrees and the same position in metres, in seconds.
const BOTH_FORMS_S: f64 = 0.05;

/// Shortest interval between two stored fixes, in seconds.
const FIX_INTERVAL_S_MIN: f64 = 1.0;

/// A depth is valid for so long, in seconds.
const DEPTH_S_MAX: f64 = 30.0;

/// A value with the time of its record.
type TimedValue = Option<(f64, f64)>;

/// Whether degrees stand for no position: receivers report latitude and longitude 0 before their first fix.
pub(crate) fn is_before_first_fix(latitude_deg: f64, longitude_deg: f64) -> bool {
    latitude_deg == 0.0 && longitude_deg == 0.0
}

/// Collects the fixes of a vehicle.
#[derive(Debug, Default)]
pub(crate) struct Navigation {
    /// Pending coordinates: latitude and longitude, and east and north.
    degrees: [TimedValue; 2],
    metres: [TimedValue; 2],
    depth: TimedValue,
    degree_fixes: Vec<Fix>,
    metre_fixes: Vec<Fix>,
    /// The latest position in each form, with its time.
    latest_degrees: Option<(f64, Geographic)>,
    latest_metres: Option<(f64, (f64, f64))>,
    /// The position nearest to (0, 0) that was recorded in both forms, in degrees and in metres.
    datum_pair: Option<(Geographic, (f64, f64))>,
    /// Number of positions with NaN, and with latitude and longitude 0.
    pub(crate) missing: usize,
}

impl Navigation {
    /// Absorbs a coordinate under its MOOS name. Returns false if the value is invalid. Other names are ignored.
    pub(crate) fn absorb_coordinate(&mut self, time_s: f64, name: &str, value: &str) -> bool {
        let (is_degrees, index) = match name {
            "LAT" => (true, 0),
            "LONG" | "LON" => (true, 1),
            "X" => (false, 0),
            "Y" => (false, 1),
            "DEPTH" => (false, 2),
            _ => return true,
        };
        let Ok(value) = value.parse::<f64>() else { return false };
        if value.is_nan() {
            self.missing += 1;
            return true;
        }
        let Some(value) = bounds::COORDINATE_M.check(value) else { return false };
        if index == 2 {
            self.depth = Some((time_s, value));
            return true;
        }
        let pair = if is_degrees { &mut self.degrees } else { &mut self.metres };
        pair[index] = Some((time_s, value));
        let simultaneous = |pair: [TimedValue; 2]| {
            let (first, second) = pair[0].zip(pair[1])?;
            ((first.0 - second.0).abs() <= PAIR_S).then_some((first.1, second.1))
        };
        let Some((first, second)) = simultaneous(*pair) else { return true };
        *pair = [None; 2];
        if is_degrees {
            return self.add_degrees(time_s, (first, second), None);
        }
        self.add_metres(time_s, (first, second), None)
    }

    /// Adds a position in degrees. Returns false if it is invalid.
    pub(crate) fn add_degrees(&mut self, time_s: f64, place: (f64, f64), depth_m: Option<f64>) -> bool {
        if is_before_first_fix(place.0, place.1) || place.0.is_nan() || place.1.is_nan() {
            self.missing += 1;
            return true;
        }
        let Some(place) = Geographic::new(place.0, place.1) else { return false };
        let is_bounded = |value: &f64| bounds::COORDINATE_M.check(*value).is_some();
        self.add_fix(time_s, Place::Degrees(place), depth_m.filter(is_bounded));
        true
    }

    /// Adds a position in metres. Returns false if it is invalid.
    pub(crate) fn add_metres(&mut self, time_s: f64, (x_m, y_m): (f64, f64), depth_m: Option<f64>) -> bool {
        if x_m.is_nan() || y_m.is_nan() {
            self.missing += 1;
            return true;
        }
        let is_bounded = |value: f64| bounds::COORDINATE_M.check(value).is_some();
        if !is_bounded(x_m) || !is_bounded(y_m) {
            return false;
        }
        self.add_fix(time_s, Place::Metres(x_m, y_m), depth_m.filter(|depth_m| is_bounded(*depth_m)));
        true
    }

    /// Adds a fix. Without a depth of its own, it gets the latest depth.
    fn add_fix(&mut self, time_s: f64, place: Place, depth_m: Option<f64>) {
        self.depth = depth_m.map(|depth_m| (time_s, depth_m)).or(self.depth);
        let depth_m = self.depth.filter(|depth| time_s - depth.0 <= DEPTH_S_MAX).map(|depth| depth.1);
        match place {
            Place::Degrees(degrees) => self.latest_degrees = Some((time_s, degrees)),
            Place::Metres(east_m, north_m) => self.latest_metres = Some((time_s, (east_m, north_m))),
        }
        if let Some(((degrees_s, degrees), (metres_s, metres))) = self.latest_degrees.zip(self.latest_metres) {
            let is_nearer = self
                .datum_pair
                .is_none_or(|(_, datum_pair)| metres.0.hypot(metres.1) < datum_pair.0.hypot(datum_pair.1));
            if is_nearer && (degrees_s - metres_s).abs() <= BOTH_FORMS_S {
                self.datum_pair = Some((degrees, metres));
            }
        }
        let fixes = if matches!(place, Place::Degrees(_)) { &mut self.degree_fixes } else { &mut self.metre_fixes };
        if fixes.last().is_none_or(|last| !(0.0..FIX_INTERVAL_S_MIN).contains(&(time_s - last.time_s))) {
            fixes.push(Fix { time_s, place, depth_m });
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.degree_fixes.is_empty() && self.metre_fixes.is_empty()
    }

    /// Estimates the datum, the place of (0, 0), from a position in both forms.
    ///
    /// It uses the position nearest to (0, 0). The error grows with its distance, because the log may stem from another
    /// projection.
    pub(crate) fn datum(&self) -> Option<Geographic> {
        let (place, (east_m, north_m)) = self.datum_pair?;
        let mut datum = place;
        for _ in 0..4 {
            let (x_m, y_m) = Reference::with_origin(datum).ok()?.metres(Place::Degrees(place))?;
            // Approximate length of a degree of latitude. The remaining error shrinks with every iteration.
            let metres_a_degree = 111_200.0;
            datum = Geographic::new(
                datum.latitude_deg + (y_m - north_m) / metres_a_degree,
                datum.longitude_deg
                    + (x_m - east_m) / (metres_a_degree * datum.latitude_deg.to_radians().cos().max(0.01)),
            )?;
        }
        // Rounds to 0.1 m, which restores the digits of the mission file.
        let round = |degrees: f64| (degrees * 1e6).round() / 1e6;
        Geographic::new(round(datum.latitude_deg), round(datum.longitude_deg))
    }

    /// Returns the fixes in degrees, or those in metres if they are more than twice as many. A satellite receiver works
    /// at the surface only.
    pub(crate) fn into_fixes(self) -> Vec<Fix> {
        if self.metre_fixes.len() > 2 * self.degree_fixes.len() { self.metre_fixes } else { self.degree_fixes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_form_positions_that_determine_the_datum() {
        let origin = Geographic::new(43.8253, -70.3304).unwrap();
        let reference = Reference::with_origin(origin).unwrap();
        let mut navigation = Navigation::default();
        for n in 0..100 {
            let (time_s, east_m) = (0.1 * f64::from(n), 10.0 * f64::from(n) - 600.0);
            let place = reference.geographic(east_m, 300.0).unwrap();
            for (name, value) in
                [("X", east_m), ("Y", 300.0), ("LAT", place.latitude_deg), ("LONG", place.longitude_deg)]
            {
                assert!(navigation.absorb_coordinate(time_s, name, &value.to_string()));
            }
            assert!(
                navigation.absorb_coordinate(time_s, "DEPTH", "12")
                    && navigation.absorb_coordinate(time_s, "SPEED", "fast")
            );
        }
        let datum = navigation.datum().unwrap();
        let error_m = reference.metres(Place::Degrees(datum)).unwrap();
        assert!(error_m.0.hypot(error_m.1) < 0.001, "{error_m:?}");
        assert!(!navigation.absorb_coordinate(11.0, "X", "inf") && !navigation.absorb_coordinate(11.0, "LAT", "here"));
        assert!(navigation.absorb_coordinate(11.0, "X", "nan") && navigation.missing == 1);
        let fixes = navigation.into_fixes();
        assert!((9..=11).contains(&fixes.len()) && fixes[1].depth_m == Some(12.0), "{}", fixes.len());
        // Coordinates too far apart in time form no position.
        let mut navigation = Navigation::default();
        navigation.absorb_coordinate(0.0, "X", "1");
        navigation.absorb_coordinate(0.9, "Y", "1");
        assert!(navigation.is_empty());
    }

    #[test]
    fn zeros_before_the_first_fix_and_nan_are_counted_and_yield_no_position() {
        let mut navigation = Navigation::default();
        for (time_s, place) in [(0.0, (0.0, 0.0)), (1.0, (f64::NAN, 5.0)), (2.0, (0.0, 5.0)), (4.0, (43.8, 289.7))] {
            assert!(navigation.add_degrees(time_s, place, None));
        }
        assert!(!navigation.add_degrees(5.0, (91.0, 0.0), None) && !navigation.add_degrees(5.0, (0.0, 361.0), None));
        assert_eq!(navigation.missing, 2);
        let fixes = navigation.into_fixes();
        let Place::Degrees(last) = fixes[1].place else { panic!("{fixes:?}") };
        assert!(fixes.len() == 2 && (last.longitude_deg + 70.3).abs() < 1e-9, "{fixes:?}");
    }
}
