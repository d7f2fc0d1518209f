//! Claims and tracks of members that the vehicle's own receptions contradict.

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::Cell;

const SLOTS: u32 = 120;

/// Three vehicles that do not move. Every vehicle hears two of three transmissions.
fn three() -> Trip {
    let outcome = |slot: u32, receiver: usize| Some(!(slot / 3 + receiver as u32).is_multiple_of(3));
    Trip::stationary(&[(100, 128), (140, 128), (128, 160)], SLOTS, outcome)
}

/// Reports of vehicle 1, which claims these of its slots as unused.
fn claims(trip: &Trip, is_claimed: impl Fn(u32) -> bool) -> Vec<Vec<u8>> {
    let mut agent = trip.vehicle(1);
    let unused = (0..SLOTS).filter(|&slot| trip.sender(slot) == 1 && is_claimed(slot));
    agent.record_unused_slots(unused.map(slot_s)).unwrap();
    frames(&mut agent, 50)
}

/// Predictions from own events after a fit from nothing.
fn own_probabilities(agent: &mut Agent) -> Vec<u64> {
    agent.rebuild().unwrap();
    let predicted = agent.predict(test_links(), Which::Own).unwrap();
    bits(&predicted.iter().map(|prediction| prediction.probability).collect::<Vec<_>>())
}

/// Slots of vehicle 1 with these outcomes of vehicle 0.
fn slots_of_1(trip: &Trip, heard: bool) -> Vec<u32> {
    let is_wanted = |&slot: &u32| trip.sender(slot) == 1 && trip.outcomes[slot as usize][0] == Some(heard);
    (0..SLOTS).filter(is_wanted).collect()
}

#[test]
fn claims_of_a_member_that_was_received_in_three_of_its_unused_slots_do_not_count() {
    let trip = three();
    let heard = slots_of_1(&trip, true);
    let missed = slots_of_1(&trip, false);
    for (contradictions, is_reliable) in [(0, true), (2, true), (3, false), (heard.len(), false)] {
        let reports = claims(&trip, |slot| missed.contains(&slot) || heard[..contradictions].contains(&slot));
        let mut agent = trip.vehicle(0);
        receive_all(&mut agent, &reports);
        assert_eq!(member(&agent, &name(1)).is_ignored(IgnoreReason::FalseClaims), !is_reliable, "{contradictions}");
        // Without claims the misses count.
        let is_equal = own_probabilities(&mut agent) == own_probabilities(&mut trip.vehicle(0));
        assert_eq!(is_equal, !is_reliable, "{contradictions}");
    }
}

#[test]
fn false_claims_are_found_in_any_order_of_reports_and_events() {
    let trip = three();
    let reports = claims(&trip, |_| true);
    let mut first = trip.vehicle(0);
    receive_all(&mut first, &reports);
    let mut last = trip.vehicle_with_events(0, []);
    receive_all(&mut last, reports.iter().rev());
    for event in trip.events(0).into_iter().rev() {
        last.record([event]).unwrap();
    }
    assert!(member(&last, &name(1)).is_ignored(IgnoreReason::FalseClaims));
    assert_eq!(own_probabilities(&mut first), own_probabilities(&mut last));
    let mut restored = restored(&first, &first.snapshot());
    assert!(member(&restored, &name(1)).is_ignored(IgnoreReason::FalseClaims));
    assert_eq!(own_probabilities(&mut restored), own_probabilities(&mut first));
}

/// Reports of a vehicle whose positions are off by some cells.
fn reports_off_by(trip: &Trip, number: usize, cells: u8) -> Vec<Vec<u8>> {
    let mut trip = trip.clone();
    let shifted = |cell: &mut Cell| cell.east += cells;
    trip.corners[number].iter_mut().for_each(shifted);
    trip.reports_of(number)
}

#[test]
fn a_wrong_track_locates_no_events_and_discredits_no_other_member() {
    let trip = three();
    let receive = |of_1: &[Vec<u8>]| {
        let mut agent = trip.vehicle(0);
        receive_all(&mut agent, trip.reports_of(2).iter().chain(of_1));
        agent.rebuild().unwrap();
        agent
    };
    let mut correct = receive(&trip.reports_of(1));
    assert!(
        !member(&correct, &name(1)).is_ignored(IgnoreReason::WrongTrack)
            && !member(&correct, &name(2)).is_ignored(IgnoreReason::WrongTrack)
    );
    let expected = test_probabilities(&mut correct);
    let mut agent = receive(&reports_off_by(&trip, 1, 60));
    assert!(
        member(&agent, &name(1)).is_ignored(IgnoreReason::WrongTrack)
            && !member(&agent, &name(2)).is_ignored(IgnoreReason::WrongTrack)
    );
    assert_eq!(excluded(&agent), []);
    // The vehicle knows from its own events where the member was.
    assert!(largest_difference(&test_probabilities(&mut agent), &expected) < 0.01);
    // Positions off by one waypoint cell are within the resolution.
    assert!(!member(&receive(&reports_off_by(&trip, 1, 1)), &name(1)).is_ignored(IgnoreReason::WrongTrack));
}

#[test]
fn a_wrong_track_is_found_in_any_order_of_reports_and_events() {
    let trip = three();
    let reports = [trip.reports_of(2), reports_off_by(&trip, 1, 60)].concat();
    let mut first = trip.vehicle(0);
    receive_all(&mut first, &reports);
    let mut last = trip.vehicle_with_events(0, []);
    for report in reports.iter().rev() {
        last.receive(report, None);
        last.probability(test_links()[0]).unwrap();
    }
    for event in trip.events(0) {
        last.record([event]).unwrap();
        last.probability(test_links()[0]).unwrap();
    }
    assert_eq!(bits(&rebuilt_probabilities(&mut first)), bits(&rebuilt_probabilities(&mut last)));
}
