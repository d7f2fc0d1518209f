//! Tracks from reports.

use super::*;
use crate::types::event::VehicleId;
use proptest::prelude::*;

/// A cell is ten metres wide.
fn centre(cell: Cell) -> Position {
    Position::new(10.0 * f64::from(cell.east), 0.0)
}

fn track(reports: &[&[(u32, u8)]]) -> ReceivedTrack {
    let mut track = ReceivedTrack::default();
    for report in reports {
        let waypoints = report.iter().map(|&(slot, east)| (slot, Cell { east, north: 0, depth: 0 }));
        track.add(&waypoints.collect::<Vec<_>>());
    }
    track
}

fn position(track: &ReceivedTrack, slot: u32) -> Option<Position> {
    let slots = Slots::cycle(10.0, ["a", "b"].map(VehicleId::new).into());
    track.at(slot, &slots, &centre, 40.0)
}

fn east_m(track: &ReceivedTrack, slot: u32) -> Option<f64> {
    position(track, slot).map(|at| at.east_m.round())
}

#[test]
fn headings_are_the_courses_of_segments_longer_than_a_cell() {
    let heading_deg = |track: &ReceivedTrack, slot| position(track, slot).and_then(|at| at.heading_deg);
    let there_and_back = track(&[&[(0, 0), (20, 20), (40, 0)]]);
    let found = [0, 10, 19, 20, 30, 40, 43].map(|slot| heading_deg(&there_and_back, slot));
    assert_eq!(found, [90.0, 90.0, 90.0, 270.0, 270.0, 270.0, 270.0].map(Some));
    // A vehicle at rest may drift between two cells.
    let drifting = track(&[&[(0, 0), (20, 1), (40, 0)]]);
    assert_eq!([0, 10, 20, 43].map(|slot| heading_deg(&drifting, slot)), [None; 4]);
}

#[test]
fn long_gaps_between_reports_are_not_interpolated() {
    let (first, lost, last): ([_; 2], [_; 3], [_; 2]) =
        ([(0, 0), (20, 20)], [(20, 20), (40, 20), (60, 0)], [(60, 0), (80, 40)]);
    let heard = track(&[&first, &last]);
    assert_eq!(east_m(&heard, 10), Some(100.0));
    assert_eq!(east_m(&heard, 70), Some(200.0));
    // Extrapolated for 40 s, then unknown.
    assert_eq!(east_m(&heard, 24), Some(240.0));
    assert_eq!((25..60).find_map(|slot| east_m(&heard, slot)), None);
    // The lost report fills the gap, in any order of arrival.
    let all = [track(&[&first, &last, &lost]), track(&[&lost, &last, &first, &lost])];
    for track in all {
        let found = [24, 30, 50, 59].map(|slot| east_m(&track, slot).unwrap());
        assert_eq!(found, [200.0, 200.0, 100.0, 10.0]);
    }
}

#[test]
fn gaps_between_reports_may_be_longer_than_a_segment() {
    let heard = track(&[&[(0, 0), (255, 51)], &[(1000, 51), (1255, 0)]]);
    let found = [100, 255, 259, 500, 1000, 1005].map(|slot| east_m(&heard, slot));
    assert_eq!(found, [Some(200.0), Some(510.0), Some(518.0), None, Some(510.0), Some(500.0)]);
}

#[test]
fn short_gaps_between_reports_are_interpolated() {
    // A gap of 80 s, then one of 90 s.
    let heard = track(&[&[(0, 0), (20, 20)], &[(28, 12), (40, 0)]]);
    assert_eq!(east_m(&heard, 24), Some(160.0));
    let heard = track(&[&[(0, 0), (20, 20)], &[(29, 12), (40, 0)]]);
    assert_eq!(east_m(&heard, 24), Some(240.0));
}

proptest! {
    /// Outside the affected range, adding or removing a report changes no position.
    #[test]
    fn a_report_changes_positions_in_its_affected_range_only(
        steps in prop::collection::vec(prop::collection::vec((1..9u32, 0..50u8), 1..4), 1..6),
        begins in prop::collection::vec(0..40u32, 6),
    ) {
        let report = |(steps, begin): (&Vec<(u32, u8)>, &u32)| {
            let slots = steps.iter().scan(*begin, |slot, step| { *slot += step.0; Some(*slot) });
            slots.zip(steps).map(|(slot, step)| (slot, step.1)).collect::<Vec<_>>()
        };
        let reports: Vec<Vec<(u32, u8)>> = steps.iter().zip(&begins).map(report).collect();
        let all: Vec<&[(u32, u8)]> = reports.iter().map(Vec::as_slice).collect();
        let (with, without) = (track(&all), track(&all[1..]));
        let waypoints: Vec<(u32, Cell)> = all[0].iter().map(|&(slot, east)| (slot, Cell { east, north: 0, depth: 0 })).collect();
        prop_assert_eq!(with.range_affected_by(&waypoints), without.range_affected_by(&waypoints));
        let affected = with.range_affected_by(&waypoints);
        let mut outside = (0..80).filter(|slot| !affected.contains(slot));
        prop_assert!(outside.all(|slot| position(&with, slot) == position(&without, slot)));
    }
}

#[test]
fn the_track_is_extrapolated_for_a_limited_time() {
    let heard = track(&[&[(0, 0), (20, 20)]]);
    assert_eq!([23, 24, 25].map(|slot| east_m(&heard, slot)), [Some(230.0), Some(240.0), None]);
    // A single waypoint gives no velocity.
    assert_eq!(east_m(&track(&[&[(20, 20)]]), 23), Some(200.0));
    assert_eq!(east_m(&track(&[&[(20, 20)]]), 19), None);
}
