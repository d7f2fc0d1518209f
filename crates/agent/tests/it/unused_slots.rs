//! Unused slots: members report the slots in which they did not transmit, so that no receiver counts these as missed.

use std::collections::BTreeSet;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// A trip and its unused slots. Receivers recorded them as missed.
fn with_unused_slots() -> impl Strategy<Value = (Trip, BTreeSet<u32>)> {
    (trips(), prop::collection::vec(prop::bool::weighted(0.2), 48)).prop_map(|(mut trip, unused)| {
        let unused: BTreeSet<u32> = (0..trip.slots).filter(|&slot| unused[slot as usize]).collect();
        for &slot in &unused {
            for outcome in &mut trip.outcomes[slot as usize] {
                *outcome = outcome.map(|_| false);
            }
        }
        (trip.without_exclusion(), unused)
    })
}

/// A vehicle that recorded its own unused slots.
fn vehicle_with_unused(trip: &Trip, unused: &BTreeSet<u32>, number: usize) -> Agent {
    let mut agent = trip.vehicle(number);
    let own = unused.iter().copied().filter(|&slot| trip.sender(slot) == number);
    agent.record_unused_slots(own.map(slot_s)).unwrap();
    agent
}

/// A station with all events of used slots.
fn station_without_unused(trip: &Trip, unused: &BTreeSet<u32>) -> Agent {
    let is_used = |event: &Event| !unused.contains(&((event.time_s / SLOT_S).round() as u32));
    station(&trip.team, trip.all_events().into_iter().filter(is_used))
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn reported_unused_slots_do_not_count_as_missed((trip, unused) in with_unused_slots(), turn in 0..50usize) {
        let reports: Vec<Vec<u8>> = (0..trip.members())
            .flat_map(|number| frames(&mut vehicle_with_unused(&trip, &unused, number), 100))
            .collect();
        let expected = test_probabilities(&mut station_without_unused(&trip, &unused));
        for number in 0..trip.members() {
            let mut agent = vehicle_with_unused(&trip, &unused, number);
            agent.refit().unwrap();
            let mut order = reports.clone();
            order.rotate_left(turn % reports.len().max(1));
            for report in &order {
                agent.receive(report, None);
                agent.probability(test_links()[0]).unwrap();
            }
            let mut other = vehicle_with_unused(&trip, &unused, number);
            receive_all(&mut other, &reports);
            prop_assert_eq!(other.snapshot(), agent.snapshot());
            prop_assert_eq!(remote_events(&restored(&agent, &agent.snapshot())), remote_events(&other));
            let found = rebuilt_probabilities(&mut agent);
            prop_assert!(largest_difference(&found, &expected) < 1e-9, "{found:?} {expected:?}");
        }
    }
}

/// Every vehicle hears the others up to slot 5 and misses them in slots 6 to 11. Vehicle 2 does not listen in slot 7.
fn three() -> Trip {
    let outcome = |slot: u32, receiver: usize| (slot < 12 && (slot, receiver) != (7, 2)).then_some(slot < 6);
    Trip::stationary(&[(100, 128), (110, 128), (120, 128)], 24, outcome).without_exclusion()
}

/// The probability of the link from vehicle 1 to vehicle 0 from own events.
fn own_probability(agent: &mut Agent) -> f64 {
    let link = three().event(1, 0).unwrap().link;
    agent.predict([link], Which::Own).unwrap()[0].probability
}

/// The probability after a fit from nothing.
fn probability(agent: &mut Agent) -> f64 {
    agent.rebuild().unwrap();
    own_probability(agent)
}

#[test]
fn a_slot_that_its_member_denies_counts_if_another_member_heard_it() {
    let trip = three();
    let mut agent = trip.vehicle(0);
    let all = probability(&mut agent);
    // Vehicle 1 denies slot 7, which vehicle 0 missed.
    let mut sender = trip.vehicle(1);
    sender.record_unused_slots([slot_s(7)]).unwrap();
    receive_all(&mut agent, &frames(&mut sender, 20));
    assert!(probability(&mut agent) > all + 1e-3);
    assert_eq!(agent.events().len(), trip.events(0).len(), "recorded events stay recorded");
    // Vehicle 2 heard that slot, so that it was used.
    let mut witness = trip.vehicle(2);
    let link = Link { transmitter: trip.at(1, 7), receiver: trip.at(2, 7) };
    witness.record([Event { transmitter_id: name(1), ..event_at(2, slot_s(7), link, true) }]).unwrap();
    receive_all(&mut agent, &frames(&mut witness, 20));
    assert!((probability(&mut agent) - all).abs() < 1e-9);
}

#[test]
fn an_event_that_counts_again_before_the_next_fit_counts_once() {
    let trip = three();
    let mut agent = trip.vehicle(0);
    agent.refit().unwrap();
    let before = own_probability(&mut agent);
    // Vehicle 1 denies its slots 7 and 10, and vehicle 2 heard them. No fit comes in between.
    let mut sender = trip.vehicle(1);
    sender.record_unused_slots([7, 10].map(slot_s)).unwrap();
    receive_all(&mut agent, &frames(&mut sender, 20));
    own_probability(&mut agent);
    let heard = |slot| {
        let link = Link { transmitter: trip.at(1, slot), receiver: trip.at(2, slot) };
        Event { transmitter_id: name(1), ..event_at(2, slot_s(slot), link, true) }
    };
    let events = trip.events(2).into_iter().filter(|event| event.time_s != slot_s(10));
    let mut witness = trip.vehicle_with_events(2, events.chain([7, 10].map(heard)));
    receive_all(&mut agent, &frames(&mut witness, 20));
    let after = own_probability(&mut agent);
    assert!((probability(&mut agent) - before).abs() < 1e-6, "a new fit gives the probability of before");
    assert!((after - before).abs() < 1e-6, "{before} {after}");
}

#[test]
fn an_unused_slot_counts_in_any_order_of_report_and_event() {
    let trip = three();
    let mut sender = trip.vehicle(1);
    sender.record_unused_slots([slot_s(7)]).unwrap();
    let reports = frames(&mut sender, 20);
    let mut first = trip.vehicle(0);
    receive_all(&mut first, &reports);
    let mut last = trip.vehicle_with_events(0, []);
    receive_all(&mut last, &reports);
    last.record(trip.events(0)).unwrap();
    assert_eq!(probability(&mut first), probability(&mut last));
    assert_eq!(first.snapshot(), last.snapshot());
}

#[test]
fn slots_of_other_members_cannot_be_recorded_as_unused() {
    let trip = three();
    let mut agent = trip.vehicle(0);
    let before = agent.snapshot();
    // Slot 4 belongs to vehicle 1.
    for time_s in [40.0, -5.0, f64::NAN] {
        let recorded = agent.record_unused_slots([0.0, time_s]);
        assert!(matches!(recorded, Err(AgentError::NotMyTurn { .. })), "{time_s}");
    }
    assert_eq!(agent.snapshot(), before);
    let mut stranger = Agent::new(VehicleId::new("a ship"), trip.team.clone(), AgentOptions::default());
    assert!(stranger.record_unused_slots([0.0]).is_err());
    agent.record_unused_slots([0.0]).unwrap();
    assert_ne!(agent.snapshot(), before);
}
