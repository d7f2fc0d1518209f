//! The track of a vehicle.

use super::*;

#[test]
fn navigation_at_a_high_rate_gives_the_course_of_a_moving_vehicle() {
    // One fix a tenth of a second, at one metre a second to the east.
    let fixes = (0..600).map(|n| (0.1 * f64::from(n), Position::new(0.1 * f64::from(n), 0.0)));
    let track = Track::new(fixes.collect());
    let heading = |time_s: f64| track.at(time_s).unwrap().heading_deg;
    assert_eq!(heading(30.0), Some(90.0));
    assert_eq!(heading(30.05), Some(90.0));
    // The vehicle has not moved two metres yet.
    assert_eq!(heading(1.0), None);
    let moored = Track::new((0..600).map(|n| (f64::from(n), Position::new(1e-3 * f64::from(n), 0.0))).collect());
    assert_eq!(moored.at(300.0).unwrap().heading_deg, None);
}

#[test]
fn a_course_comes_from_the_position_before_if_the_vehicle_moved_that_far() {
    let fixes = [(0.0, 0.0, 0.0), (100.0, 0.0, 50.0), (200.0, 50.0, 50.0)];
    let track = Track::new(fixes.map(|(time_s, east_m, north_m)| (time_s, Position::new(east_m, north_m))).into());
    let heading = |time_s: f64| track.at(time_s).unwrap().heading_deg;
    assert_eq!(
        [heading(0.0), heading(100.0), heading(150.0), heading(200.0)],
        [None, Some(0.0), Some(90.0), Some(90.0)]
    );
    assert_eq!(track.at_within(200.0, 50.0).unwrap().heading_deg, None);
}
