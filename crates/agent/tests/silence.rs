//! What was not sent was not missed: vehicles say when they were silent, and others forget what they took for misses.

#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeSet;
use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// A trip, and the slots in which nobody sent, though others listened and took it for a miss.
fn with_silence() -> impl Strategy<Value = (Trip, BTreeSet<u32>)> {
    (trips(), prop::collection::vec(prop::bool::weighted(0.2), 48)).prop_map(|(mut trip, silent)| {
        let silent: BTreeSet<u32> = (0..trip.slots).filter(|&slot| silent[slot as usize]).collect();
        for &slot in &silent {
            for outcome in &mut trip.outcomes[slot as usize] {
                *outcome = outcome.map(|_| false);
            }
        }
        (trip.trusting(), silent)
    })
}

/// A vehicle that knows when it was silent itself.
fn knowing(trip: &Trip, silent: &BTreeSet<u32>, number: usize) -> Agent {
    let mut agent = trip.vehicle(number);
    let own = silent.iter().filter(|&&slot| slot as usize % trip.members() == number);
    agent.stay_silent(own.map(|&slot| SLOT_S * f64::from(slot))).unwrap();
    agent
}

/// The team where these may be silent.
fn where_all_may_be_silent(trip: &Trip) -> Trip {
    let slots = Slots { may_be_silent: names(trip.members()).into_iter().collect(), ..trip.team.slots.clone() };
    Trip { team: Arc::new(Team { slots, ..(*trip.team).clone() }), ..trip.clone() }
}

/// Somebody with all events that were some.
fn all_but_silence(trip: &Trip, silent: &BTreeSet<u32>) -> Agent {
    let is_sent = |event: &Event| !silent.contains(&((event.time_s / SLOT_S).round() as u32));
    let slots = Slots { may_be_silent: BTreeSet::new(), ..trip.team.slots.clone() };
    let team = Arc::new(Team { slots, ..(*trip.team).clone() });
    let mut all = Agent::new(VehicleId::new("shore"), team).owning_all_events();
    all.observe_all((0..trip.members()).flat_map(|number| trip.events(number)).filter(is_sent)).unwrap();
    all.rebuild_posteriors().unwrap();
    all
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn silence_is_no_miss_once_it_is_told((trip, silent) in with_silence(), all_may in any::<bool>(), turn in 0..50usize) {
        let trip = if all_may { where_all_may_be_silent(&trip) } else { trip };
        let reports: Vec<Vec<u8>> =
            (0..trip.members()).flat_map(|number| sent(&mut knowing(&trip, &silent, number), 100)).collect();
        let mut all = all_but_silence(&trip, &silent);
        let expected = all.probabilities(somewhere()).unwrap();
        for number in 0..trip.members() {
            let mut agent = knowing(&trip, &silent, number);
            agent.refit().unwrap();
            let mut order = reports.clone();
            order.rotate_left(turn % reports.len().max(1));
            for report in &order {
                agent.receive(report, 0.0);
                agent.probability(somewhere()[0]).unwrap();
            }
            let mut again = knowing(&trip, &silent, number);
            reports.iter().for_each(|report| drop(again.receive(report, 0.0)));
            prop_assert_eq!(again.snapshot(), agent.snapshot());
            prop_assert_eq!(restored(&agent, &agent.snapshot()).told_events(), again.told_events());
            agent.rebuild_posteriors().unwrap();
            let found = agent.probabilities(somewhere()).unwrap();
            prop_assert!(largest_difference(&found, &expected) < 1e-9, "{found:?} {expected:?}");
        }
    }
}

/// Vehicle 0 heard vehicle 1 in slots 1 and 3 of two, and missed it in slots 5 and 7.
fn two() -> Trip {
    let outcomes = (0..16).map(|slot| vec![(slot < 8).then_some(slot < 4), Some(true)]).collect();
    let turns = vec![vec![pingmap_packet::Cell { east: 100, north: 128, depth: 0 }; 3]; 2];
    let team = Team { track_off_max_m: 1e-6, ..team(2, model()) };
    Trip { team: Arc::new(team), slots: 16, turns, outcomes }
}

fn probability(agent: &mut Agent) -> f64 {
    agent.probability(two().event(1, 0).unwrap().link).unwrap()
}

#[test]
fn what_may_not_have_been_sent_counts_when_its_sender_says_so_or_anybody_heard_it() {
    let always = two();
    let may = where_all_may_be_silent(&always);
    let nothing = Trip { outcomes: vec![vec![None; 2]; 16], ..always.clone() };
    let mut doubting = may.vehicle(0);
    let [with_all, without] = [&mut always.vehicle(0), &mut nothing.vehicle(0)].map(|agent| {
        agent.rebuild_posteriors().unwrap();
        probability(agent)
    });
    doubting.rebuild_posteriors().unwrap();
    // What was heard does not count before what was missed does.
    assert!((probability(&mut doubting) - without).abs() < 1e-12 && (with_all - without).abs() > 1e-3);
    assert_eq!(doubting.events().len(), 4, "what it recorded stays recorded");
    // Its sender says that it sent: all four come back.
    let mut sender = may.vehicle(1);
    sent(&mut sender, 20).iter().for_each(|report| drop(doubting.receive(report, 0.0)));
    doubting.mute(&names(2)[1]);
    doubting.rebuild_posteriors().unwrap();
    assert!((probability(&mut doubting) - with_all).abs() < 1e-9);
}

#[test]
fn silence_is_for_ones_own_slots() {
    let trip = two();
    let mut agent = trip.vehicle(0);
    let before = agent.snapshot();
    // Slot 3 is the other one's.
    for time_s in [30.0, -5.0, f64::NAN] {
        assert!(matches!(agent.stay_silent([0.0, time_s]), Err(AgentError::NotMyTurn { .. })), "{time_s}");
    }
    assert_eq!(agent.snapshot(), before);
    let mut stranger = Agent::new(VehicleId::new("a ship"), trip.team.clone());
    assert!(stranger.stay_silent([0.0]).is_err());
    agent.stay_silent([0.0]).unwrap();
    assert_ne!(agent.snapshot(), before);
}
