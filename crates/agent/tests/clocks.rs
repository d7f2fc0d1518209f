//! Clocks that are off by whole slots: they show by what is heard, and it spoils nothing.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// Who may send in a slot, before the first one too.
fn turn(trip: &Trip, slot: i64) -> usize {
    slot.rem_euclid(trip.members() as i64) as usize
}

/// What the host of vehicle 0 records of these events by a clock so many slots ahead: what it hears comes in the turn of another one,
/// and whose turn it takes it to be it misses, but for itself. Where that one was it knows as little as who it was.
fn by_a_clock_ahead(trip: &Trip, ahead: i64) -> Vec<Event> {
    let mut recorded = Vec::new();
    for event in trip.events(0) {
        let slot = (event.time_s / SLOT_S).round() as i64 + ahead;
        let time_s = SLOT_S * slot as f64;
        let expected = turn(trip, slot);
        let is_expected = names(trip.members())[expected] == event.transmitter_id;
        if expected != 0 && (!is_expected || !event.success) {
            let mut missed =
                Event { transmitter_id: names(trip.members()).remove(expected), success: false, ..event.clone() };
            missed.link.transmitter = Position::new(-77.0, 33.0);
            recorded.push(Event { time_s, ..missed });
        }
        if event.success {
            recorded.push(Event { time_s, ..event });
        }
    }
    recorded
}

/// Vehicle 0 with such a clock.
fn wrong(trip: &Trip, ahead: i64) -> Agent {
    let mut agent = vehicle(&trip.team, 0, []).telling(Telling { points: false, reports: true });
    let at = |slot: u32| (SLOT_S * (f64::from(slot) + ahead as f64), trip.at(0, slot));
    agent.navigate((0..=trip.slots).map(at)).unwrap();
    agent.observe_all(by_a_clock_ahead(trip, ahead)).unwrap();
    agent
}

/// Vehicle 0 with a right clock, that did not listen when it would have sent by the other one.
fn right(trip: &Trip, ahead: i64) -> Agent {
    let mut deaf = trip.clone();
    for slot in (0..trip.slots).filter(|&slot| turn(trip, i64::from(slot) + ahead) == 0) {
        deaf.outcomes[slot as usize][0] = None;
    }
    deaf.vehicle(0)
}

/// Trips of more than two on which what vehicle 0 hears comes from several, more and less often.
fn trips_of_many() -> impl Strategy<Value = Trip> {
    trips().prop_filter("more than two", |trip| trip.members() > 2).prop_map(Trip::trusting)
}

fn is_near(one: &mut Agent, other: &mut Agent) -> bool {
    let ((mean, variance), (other_mean, other_variance)) = (latent(one), latent(other));
    largest_difference(&mean, &other_mean) < 1e-6 && largest_difference(&variance, &other_variance) < 1e-6
}

proptest! {
    #![proptest_config(cases(24))]

    /// Everybody knows of it what they would know had the clock been right.
    #[test]
    fn a_clock_that_is_off_by_a_slot_is_as_good_as_a_right_one(trip in trips_of_many(), ahead in prop_oneof![Just(-1i64), Just(1)]) {
        let (mut wrong, mut right) = (wrong(&trip, ahead), right(&trip, ahead));
        // Where too little was heard nothing shows, and nothing counts.
        prop_assert!([0, ahead].contains(&wrong.clock_ahead_slots().into()));
        prop_assume!(i64::from(wrong.clock_ahead_slots()) == ahead);
        let others: Vec<Vec<u8>> = (1..trip.members()).flat_map(|number| sent(&mut trip.vehicle(number), 100)).collect();
        let mut listeners = [&mut wrong, &mut right].map(|agent| {
            let mut listener = trip.vehicle(1);
            sent(agent, 100).iter().chain(&others).for_each(|frame| drop(listener.receive(frame, f64::INFINITY)));
            listener.rebuild_posteriors().unwrap();
            listener
        });
        let [of_wrong, of_right] = &mut listeners;
        prop_assert_eq!(of_wrong.told_events(), of_right.told_events());
        prop_assert!(is_near(of_wrong, of_right));
        // And so does it itself, once others told where they were.
        for agent in [&mut wrong, &mut right] {
            others.iter().for_each(|frame| drop(agent.receive(frame, f64::INFINITY)));
            agent.rebuild_posteriors().unwrap();
        }
        prop_assert!(is_near(&mut wrong, &mut right));
        prop_assert_eq!(restored(&wrong, &wrong.snapshot()).clock_ahead_slots(), wrong.clock_ahead_slots());
    }
}

/// A long way on which vehicle 0 of three hears every other message.
fn every_other() -> Trip {
    let outcomes = (0..48).map(|slot| vec![Some(slot % 2 == 0); 3]).collect();
    let turns = [60, 128, 200].map(|east| vec![pingmap_packet::Cell { east, north: 128, depth: 0 }; 7]).to_vec();
    let team = Team { track_off_max_m: 1e-6, ..team(3, model()) };
    Trip { team: Arc::new(team), slots: 48, turns, outcomes }
}

#[test]
fn a_clock_that_is_off_is_noticed() {
    let trip = every_other();
    assert!(trip.vehicle(0).out_of_turn().is_empty());
    assert_eq!(trip.vehicle(0).clock_ahead_slots(), 0);
    for ahead in [-1, 1] {
        let wrong = wrong(&trip, ahead);
        assert_eq!(i64::from(wrong.clock_ahead_slots()), ahead);
        assert_eq!(wrong.out_of_turn(), names(3)[1..].iter().cloned().collect());
    }
}

#[test]
fn what_came_before_a_clock_was_set_is_as_good_as_what_came_after() {
    let trip = every_other();
    let mut agent = wrong(&trip, 1);
    let frames = sent(&mut trip.vehicle(1), 20);
    frames.iter().for_each(|frame| drop(agent.receive(frame, f64::INFINITY)));
    let before = agent.told_events();
    // Its host sets the clock: all comes in turn again.
    let again = |event: &Event| Event { time_s: event.time_s + 480.0, ..event.clone() };
    agent.observe_all(trip.events(0).iter().map(again)).unwrap();
    assert_eq!(agent.clock_ahead_slots(), 0);
    assert!(agent.out_of_turn().is_empty());
    assert_eq!(agent.told_events(), before);
    // What it reports of either is what became of these slots.
    agent.navigate((0..=48).map(|slot| (480.0 + SLOT_S * f64::from(slot), trip.at(0, slot)))).unwrap();
    let mut told = std::collections::BTreeMap::new();
    for frame in sent(&mut agent, 40) {
        let (_, report, _) = agent.read_report(&frame).unwrap();
        let slots = (report.first..).filter(|slot| report.tells_own || slot % 3 != 0);
        let said = slots.zip(report.outcomes).filter(|(_, said)| *said != pingmap_packet::Outcome::Untold);
        told.extend(
            said.filter(|(slot, _)| slot % 3 != 0).map(|(slot, said)| (slot, said == pingmap_packet::Outcome::Heard)),
        );
    }
    assert!(told.iter().all(|(slot, heard)| *heard == (slot % 2 == 0)), "{told:?}");
    let is_told = |slot: &u32| told.contains_key(slot);
    assert!((0..48).filter(|slot| slot % 3 == 1).all(|slot| is_told(&slot)), "{told:?}");
    // But for what was missed before the first message by the right clock.
    assert!((50..95).filter(|slot| slot % 3 != 0).all(|slot| is_told(&slot)), "{told:?}");
}

#[test]
fn of_two_nobody_can_say_whose_clock_it_is() {
    let trip = every_other();
    let is_of_two = |event: &Event| event.success && event.transmitter_id == names(3)[2];
    let heard_one = by_a_clock_ahead(&trip, 1).into_iter().filter(|event| !is_of_two(event));
    let agent = vehicle(&trip.team, 0, heard_one);
    assert_eq!((agent.clock_ahead_slots(), agent.out_of_turn()), (0, names(2)[1..].iter().cloned().collect()));
}
