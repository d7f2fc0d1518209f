//! Simplified tracks.

use super::*;
use crate::track::received::ReceivedTrack;
use crate::types::event::VehicleId;
use proptest::prelude::*;

fn simplified(fixes: Vec<(f64, Position)>, tolerance_m: f64) -> (Track, BTreeMap<u32, Cell>, Grid, Chart, Slots) {
    let chart = Chart::about(fixes.iter().map(|fix| fix.1));
    let grid = Grid::covering(&chart, fixes.iter().map(|fix| fix.1));
    let slots = Slots::cycle(10.0, ["a", "b"].map(VehicleId::new).into());
    let track = Track::new(fixes);
    let simplifier = TrackSimplifier { slots: &slots, grid: &grid, chart: &chart, has_depth: false, tolerance_m };
    let waypoints = simplifier.simplify(&track, &BTreeMap::new(), 0).into_iter().flatten().collect();
    (track, waypoints, grid, chart, slots)
}

#[test]
fn straight_segments_take_two_waypoints_and_every_slot_is_within_the_tolerance() {
    // East, north, and a circle.
    let position = |t: f64| match t {
        ..1000.0 => Position::new(1.5 * t, 0.0),
        ..2000.0 => Position::new(1500.0, 1.5 * (t - 1000.0)),
        _ => Position::new(1300.0 + 200.0 * (t / 150.0).cos(), 1500.0 + 200.0 * (t / 150.0).sin()),
    };
    let fixes: Vec<(f64, Position)> = (0..600).map(|n| 5.0 * f64::from(n)).map(|t| (t, position(t))).collect();
    let (track, waypoints, grid, chart, slots) = simplified(fixes, 15.0);
    assert!(waypoints.keys().filter(|&&slot| slot < 199).count() <= 4, "{waypoints:?}");
    let centre = |cell| grid.waypoint_position(&chart, cell, false);
    let mut received = ReceivedTrack::default();
    received.add(&waypoints.into_iter().collect::<Vec<_>>());
    let at = |slot, extrapolation_s_max| received.at(slot, &slots, &centre, extrapolation_s_max);
    for slot in 0..300 {
        let (found, expected) = (at(slot, 0.0).unwrap(), track.at(10.0 * f64::from(slot)).unwrap());
        let deviation_m = found.distance_m(&expected);
        // The jump to the circle takes a single slot.
        assert!(deviation_m <= 15.0, "slot {slot} deviates by {deviation_m} m");
    }
    assert_eq!(at(300, 0.0), None);
}

#[test]
fn a_vehicle_at_rest_has_a_waypoint_every_255_slots() {
    let fixes = vec![(0.0, Position::new(5.0, 5.0)), (9990.0, Position::new(5.0, 5.0))];
    let (_, waypoints, ..) = simplified(fixes, 1.0);
    assert_eq!(waypoints.keys().copied().collect::<Vec<_>>(), [0, 255, 510, 765, 999]);
}

#[test]
fn the_track_is_interrupted_outside_the_grid() {
    let (_, _, grid, chart, slots) = simplified(vec![(0.0, Position::new(0.0, 0.0))], 15.0);
    // The vehicle leaves the grid and returns elsewhere. The second absence is longer than a segment may be.
    let far_m = 1e3 * grid.cell_m;
    let north_m = |slot: u32| if slot < 700 { 0.0 } else { grid.cell_m };
    let east_m = |slot: u32| if (100..120).contains(&slot) || (300..700).contains(&slot) { far_m } else { 0.0 };
    let fix = |slot: u32| (10.0 * f64::from(slot), Position::new(east_m(slot), north_m(slot)));
    let track = Track::new((0..800).map(fix).collect());
    let simplifier = TrackSimplifier { slots: &slots, grid: &grid, chart: &chart, has_depth: false, tolerance_m: 15.0 };
    let parts = simplifier.simplify(&track, &BTreeMap::new(), 0);
    let ends = |part: &Vec<(u32, Cell)>| (part[0].0, part[part.len() - 1].0);
    assert_eq!(parts.iter().map(ends).collect::<Vec<_>>(), [(0, 99), (120, 299), (700, 799)]);
    let is_short = |segment: &[(u32, Cell)]| segment[1].0 - segment[0].0 <= SEGMENT_SLOTS_MAX;
    assert!(parts.iter().all(|part| part.windows(2).all(is_short)));
}

/// Returns straight and curved stretches of random length and direction. They begin at a depth of 20 m.
fn any_track() -> impl Strategy<Value = Vec<(f64, Position)>> {
    let stretch = (10.0..400.0f64, -0.02..0.02f64, -0.5..0.5f64);
    prop::collection::vec(stretch, 1..12).prop_map(|stretches| {
        let (mut time_s, mut at, mut heading) =
            (0.0, Position { depth_m: Some(20.0), ..Position::new(0.0, 0.0) }, 0.0f64);
        let mut fixes = vec![(time_s, at)];
        for (duration_s, turn_per_s, climb) in stretches {
            for _ in 0..(duration_s / 5.0) as usize {
                (time_s, heading) = (time_s + 5.0, heading + 5.0 * turn_per_s);
                let depth_m = at.depth_m.map(|depth_m| (depth_m + climb).clamp(0.0, 40.0));
                at = Position {
                    depth_m,
                    ..Position::new(at.east_m + 7.0 * heading.cos(), at.north_m + 7.0 * heading.sin())
                };
                fixes.push((time_s, at));
            }
        }
        fixes
    })
}

proptest! {
    #[test]
    fn every_slot_is_within_the_tolerance(fixes in any_track(), tolerance_cells in 0.3..2.0f64, sent_share in 0.0..1.0f64) {
        let chart = Chart::about(fixes.iter().map(|fix| fix.1));
        let grid = Grid::covering(&chart, fixes.iter().map(|fix| fix.1));
        let slots = Slots::cycle(10.0, ["a", "b"].map(VehicleId::new).into());
        let tolerance_m = tolerance_cells * grid.cell_m;
        let simplifier = TrackSimplifier { slots: &slots, grid: &grid, chart: &chart, has_depth: true, tolerance_m };
        // The waypoints of the first part of the track were sent before.
        let sent_fixes = fixes[..(sent_share * fixes.len() as f64) as usize].to_vec();
        let sent: BTreeMap<u32, Cell> =
            simplifier.simplify(&Track::new(sent_fixes), &BTreeMap::new(), 0).into_iter().flatten().collect();
        let track = Track::new(fixes);
        let parts = simplifier.simplify(&track, &sent, 0);
        prop_assert_eq!(parts.len(), 1);
        prop_assert!(sent.iter().all(|waypoint| parts[0].contains(&(*waypoint.0, *waypoint.1))));
        // After the last sent waypoint the result does not depend on the track before it.
        if let Some((&begin, _)) = sent.last_key_value() {
            let onward: Vec<_> = parts[0].iter().copied().filter(|waypoint| waypoint.0 >= begin).collect();
            prop_assert_eq!(&simplifier.simplify(&track, &sent, begin), &[onward]);
        }
        let mut received = ReceivedTrack::default();
        received.add(&parts[0]);
        for slot in parts[0][0].0..=parts[0][parts[0].len() - 1].0 {
            let centre = |cell| grid.waypoint_position(&chart, cell, true);
            let found = received.at(slot, &slots, &centre, 0.0).unwrap();
            let expected = track.at(10.0 * f64::from(slot)).unwrap();
            let horizontal_m = found.distance_m(&expected);
            prop_assert!(horizontal_m <= tolerance_m, "slot {} deviates by {} m", slot, horizontal_m);
            let vertical_m = found.depth_m.unwrap() - expected.depth_m.unwrap();
            prop_assert!(vertical_m.abs() <= grid.depth_cell_m, "slot {} is {} m too deep", slot, vertical_m);
        }
    }
}

#[test]
fn a_circle_takes_fewer_waypoints_than_a_polygon_on_it() {
    let (radius_m, tolerance_m, step, stops) = (200.0f64, 15.0, 0.05, 2000u32);
    let position = |angle: f64| Position::new(radius_m * angle.cos(), radius_m * angle.sin());
    let fixes = (0..stops).map(|slot| (10.0 * f64::from(slot), position(step * f64::from(slot))));
    let (_, waypoints, ..) = simplified(fixes.collect(), tolerance_m);
    // A chord between points on the circle deviates most in its middle. A chord between points outside may deviate
    // by the tolerance on both sides.
    let whole_steps = |half_cosine: f64| (2.0 * half_cosine.acos() / step).floor();
    let (on_circle, outside) =
        (whole_steps(1.0 - tolerance_m / radius_m), whole_steps((radius_m - tolerance_m) / (radius_m + tolerance_m)));
    assert_eq!((on_circle, outside), (15.0, 21.0));
    let steps = f64::from(stops - 1) / (waypoints.len() - 1) as f64;
    assert!((1.2 * on_circle..=outside).contains(&steps), "{steps} steps per segment");
}
