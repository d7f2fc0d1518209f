//! Clocks that are off by whole slots: they show by what is heard, and it spoils nothing.

#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeMap;
use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use pingmap_packet::{Cell, Outcome};
use proptest::prelude::*;

/// Who may send in a slot, before the first one too.
fn turn(trip: &Trip, slot: i64) -> usize {
    slot.rem_euclid(trip.members() as i64) as usize
}

/// What the host of vehicle 0 records by a clock so many slots ahead.
fn by_a_clock_ahead(trip: &Trip, ahead: i64) -> Vec<Event> {
    let shown = |slot: u32| i64::from(slot) + ahead;
    trip.misread(|slot| (shown(slot), turn(trip, shown(slot))))
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

fn every_other() -> Trip {
    Trip::of_three(|slot| slot % 2 == 0)
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

/// What vehicle 0 of so many reports of others' slots.
fn told(agent: &mut Agent, members: u32) -> BTreeMap<u32, bool> {
    let mut told = BTreeMap::new();
    for frame in sent(agent, 60) {
        let (_, report, _) = agent.read_report(&frame).unwrap();
        let slots = (report.first..).filter(|slot| report.tells_own || slot % members != 0);
        let said = slots.zip(report.outcomes).filter(|(_, said)| *said != Outcome::Untold);
        told.extend(said.filter(|(slot, _)| slot % members != 0).map(|(slot, said)| (slot, said == Outcome::Heard)));
    }
    told
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
    // It is no member of itself.
    let own = names(1).remove(0);
    agent.mute(&own);
    assert_eq!((agent.told_events(), agent.surprise(&own).unwrap()), (before, None));
    // What it reports of either is what became of these slots.
    agent.navigate((0..=48).map(|slot| (480.0 + SLOT_S * f64::from(slot), trip.at(0, slot)))).unwrap();
    let told = told(&mut agent, 3);
    assert!(told.iter().all(|(slot, heard)| *heard == (slot % 2 == 0)), "{told:?}");
    let is_told = |slot: &u32| told.contains_key(slot);
    assert!((0..48).filter(|slot| slot % 3 == 1).all(|slot| is_told(&slot)), "{told:?}");
    // But for what was missed between the last message by the wrong clock and the first by the right one.
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

/// A trip of five on which 3 and 4 are as seldom heard as this, of ten messages.
fn of_five(heard: usize) -> Trip {
    let is_heard = |slot: usize| match slot % 5 {
        1 | 2 => slot * 7 % 10 < 8,
        _ => slot * 7 % 10 < heard,
    };
    let outcomes = (0..200).map(|slot| vec![Some(is_heard(slot)); 5]).collect();
    let turns = vec![vec![Cell { east: 128, north: 128, depth: 0 }; 26]; 5];
    Trip { team: Arc::new(team(5, model())), slots: 200, turns, outcomes }
}

#[test]
fn two_clocks_that_are_off_alike_convince_nobody_that_it_is_his_own() {
    for heard in [3, 5, 7] {
        let trip = of_five(heard);
        let mut agent = vehicle(&trip.team, 0, []);
        // 1 and 2 send a slot late: they are heard then, and missed in their turn.
        for event in trip.events(0) {
            let is_late = names(5)[1..3].contains(&event.transmitter_id);
            if is_late {
                agent.observe(Event { success: false, ..event.clone() }).unwrap();
            }
            if !is_late || event.success {
                agent.observe(Event { time_s: event.time_s + if is_late { SLOT_S } else { 0.0 }, ..event }).unwrap();
            }
        }
        assert_eq!(agent.clock_ahead_slots(), 0, "{heard}");
        assert_eq!(agent.out_of_turn(), names(5)[1..3].iter().cloned().collect(), "{heard}");
    }
}

#[test]
fn nothing_is_told_wrongly_about_when_a_clock_was_set_or_jumped() {
    for (heard, set_at) in (1..10).flat_map(|heard| [(heard, 83), (heard, 90)]) {
        let trip = of_five(heard);
        for [before, after] in [[-1, 0], [1, 0], [-2, 0], [2, 0], [2, -1]] {
            let recorded = |ahead: i64| {
                by_a_clock_ahead(&trip, ahead)
                    .into_iter()
                    .map(move |event| (event.time_s - SLOT_S * ahead as f64, event))
            };
            let set_s = SLOT_S * f64::from(set_at);
            let mut all: Vec<_> = recorded(before).filter(|(time_s, _)| *time_s < set_s).collect();
            all.extend(recorded(after).filter(|(time_s, _)| *time_s >= set_s));
            all.sort_by(|one, other| one.0.total_cmp(&other.0));
            let mut agent = vehicle(&trip.team, 0, []).telling(Telling { points: false, reports: true });
            agent.navigate((0..=200).map(|slot| (SLOT_S * f64::from(slot), trip.at(0, slot)))).unwrap();
            agent.observe_all(all.into_iter().map(|(_, event)| event)).unwrap();
            let told = told(&mut agent, 5);
            // By the time when it is told.
            let wrong: Vec<u32> = told
                .iter()
                .filter(|&(&slot, &heard)| trip.event(slot, 0).unwrap().success != heard)
                .map(|(&slot, _)| slot)
                .collect();
            assert!(wrong.is_empty(), "{heard} {set_at} {before} {after}: {wrong:?}");
            assert!(told.len() > 60, "{heard} {set_at} {before} {after}: {}", told.len());
        }
    }
}

/// Events that are heard or missed in these slots of an order, by what is heard of whom.
fn in_blocks(late: Option<&str>, ahead: i64, heard: impl Fn(&str, usize) -> bool) -> Agent {
    let order = ["a", "b", "b", "b", "c", "c", "c"];
    let base = Team::new(["a", "b", "c"].map(VehicleId::new), model(), [Position::new(-REACH_M, -REACH_M)]).unwrap();
    let slots = Slots::in_turn(SLOT_S, order.map(VehicleId::new).to_vec());
    let mut agent = Agent::new(VehicleId::new("a"), Arc::new(Team { slots, ..base }));
    let event = |slot: i64, sender: &str, success| Event {
        time_s: SLOT_S * slot as f64,
        transmitter_id: VehicleId::new(sender),
        receiver_id: VehicleId::new("a"),
        link: link([0.0, 0.0, 100.0, 100.0]),
        kind: None,
        success,
    };
    let turn = |slot: i64| order[slot.rem_euclid(7) as usize];
    let mut events = Vec::new();
    for slot in 7..700 {
        let sender = turn(slot);
        let comes = slot + ahead + i64::from(late == Some(sender));
        let is_heard = sender != "a" && heard(sender, slot as usize);
        if is_heard {
            events.push(event(comes, sender, true));
        }
        let expected = turn(comes);
        if sender != "a" && expected != "a" && (expected != sender || !is_heard) {
            events.push(event(comes, expected, false));
        }
    }
    agent.observe_all(events).unwrap();
    agent
}

#[test]
fn whoever_sends_in_several_slots_in_a_row_shows_a_clock_too() {
    // Whether something is heard is by chance, the same each time.
    let by_chance = |tenths: usize, slot: usize| (slot * 7919 + slot / 7 * 104_729) % 97 % 10 < tenths;
    for (ahead, tenths) in [-1, 1].into_iter().flat_map(|ahead| [3, 5, 7].map(|tenths| (ahead, tenths))) {
        let agent = in_blocks(None, ahead, |_, slot| by_chance(tenths, slot));
        assert_eq!(i64::from(agent.clock_ahead_slots()), ahead, "{tenths}");
        let right = in_blocks(None, 0, |_, slot| by_chance(tenths, slot));
        assert_eq!((right.clock_ahead_slots(), right.out_of_turn().len()), (0, 0));
    }
    // One who is late, beside one who is seldom heard: it is his clock.
    let agent = in_blocks(Some("c"), 0, |sender, slot| by_chance(if sender == "c" { 8 } else { 1 }, slot));
    assert_eq!(agent.clock_ahead_slots(), 0);
}

#[test]
fn what_has_no_slot_is_not_out_of_turn() {
    let mut agent = vehicle(
        &Arc::new(Team { slots: Slots { start_s: 240.0, ..Slots::in_turn(SLOT_S, names(3)) }, ..team(3, model()) }),
        0,
        [],
    );
    agent.observe_all(every_other().events(0)).unwrap();
    assert_eq!((agent.out_of_turn().len(), agent.clock_ahead_slots()), (0, 0));
}
