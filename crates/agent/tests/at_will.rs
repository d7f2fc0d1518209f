//! Members who send when they like: what they say that they sent is what others could have heard.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// The trip of a team without turns.
fn at_will(trip: &Trip) -> Trip {
    let slots = Slots { start_s: -SLOT_S, ..Slots::at_will(SLOT_S / 2.0, names(trip.members())) };
    Trip { team: Arc::new(Team { slots, ..(*trip.team).clone() }), ..trip.clone() }.trusting()
}

/// A vehicle that knows what it sent and heard, and nothing of what it missed. What it hears seems to come so much later.
fn knowing(trip: &Trip, number: usize, late_s: f64) -> Agent {
    let without_events = Trip { outcomes: vec![vec![None; trip.members()]; trip.slots as usize], ..trip.clone() };
    let mut agent = without_events.vehicle(number);
    let heard = trip.events(number).into_iter().filter(|event| event.success);
    agent.observe_all(heard.map(|event| Event { time_s: event.time_s + late_s, ..event })).unwrap();
    let own = (0..trip.slots).filter(|&slot| slot as usize % trip.members() == number);
    agent.sent(&names(number + 1)[number], own.map(|slot| SLOT_S * f64::from(slot))).unwrap();
    agent
}

fn slot(event: &Event) -> usize {
    (event.time_s / SLOT_S).round() as usize
}

/// Its host records what it missed, of what others say that they sent.
fn record_missed(trip: &Trip, agent: &mut Agent, number: usize) -> usize {
    let listened = |event: &Event| trip.outcomes[slot(event)][number].is_some();
    let missed: Vec<Event> = agent.unheard(f64::NEG_INFINITY).into_iter().filter(listened).collect();
    agent.observe_all(missed.clone()).unwrap();
    missed.len()
}

/// Everybody says what it sent, and then what it heard and missed.
fn share(trip: &Trip, late_s: f64) -> (Vec<Agent>, Vec<Vec<u8>>) {
    let mut agents: Vec<Agent> = (0..trip.members()).map(|number| knowing(trip, number, late_s)).collect();
    let mut frames: Vec<Vec<u8>> = Vec::new();
    for _ in 0..2 {
        let told: Vec<Vec<u8>> = agents.iter_mut().flat_map(|agent| sent(agent, 200)).collect();
        for (number, agent) in agents.iter_mut().enumerate() {
            told.iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
            record_missed(trip, agent, number);
        }
        frames.extend(told);
    }
    (agents, frames)
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn what_was_sent_is_known_by_its_sender_and_then_everything_is(trip in trips(), turn in 0..50usize) {
        let will = at_will(&trip);
        let (agents, frames) = share(&will, 0.0);
        let mut all = trip.all_in_one_place();
        let expected = all.probabilities(somewhere()).unwrap();
        for (number, mut agent) in agents.into_iter().enumerate() {
            let listened = |event: &&Event| !event.success;
            prop_assert_eq!(agent.events().filter(listened).count(), trip.events(number).iter().filter(listened).count());
            agent.rebuild_posteriors().unwrap();
            let found = agent.probabilities(somewhere()).unwrap();
            prop_assert!(largest_difference(&found, &expected) < 1e-9, "{found:?} {expected:?}");
            // In any order, and twice.
            let mut again = knowing(&will, number, 0.0);
            let mut order = frames.clone();
            order.rotate_left(turn % frames.len().max(1));
            order.iter().chain(&frames).for_each(|frame| drop(again.receive(frame, 0.0)));
            record_missed(&will, &mut again, number);
            prop_assert_eq!(again.told_events(), agent.told_events());
            prop_assert_eq!(restored(&again, &again.snapshot()).told_events(), again.told_events());
            again.rebuild_posteriors().unwrap();
            prop_assert!(largest_difference(&again.probabilities(somewhere()).unwrap(), &expected) < 1e-9);
        }
    }

    /// A stretch is 5 s long: what is heard 3 s late seems to have been sent in the same one or the next.
    #[test]
    fn clocks_may_differ_by_less_than_a_stretch(trip in trips(), late_s in -4.9..4.9) {
        let will = at_will(&trip);
        let (agents, _) = share(&will, late_s);
        let (exact, _) = share(&will, 0.0);
        for (number, (agent, exact)) in agents.iter().zip(&exact).enumerate() {
            let missed = |agent: &Agent| agent.events().filter(|event| !event.success).map(slot).collect::<Vec<_>>();
            prop_assert_eq!(missed(agent), missed(exact));
            prop_assert_eq!(agent.events().len(), trip.events(number).len());
            // What was heard before the first place of a track has no place.
            prop_assert!(agent.told_events().0 + 2 * trip.members() >= exact.told_events().0);
        }
    }

    #[test]
    fn what_is_heard_counts_no_sooner_than_what_is_missed(trip in trips()) {
        let will = at_will(&trip);
        let mut agent = knowing(&will, 0, 0.0);
        let nothing = Agent::new(names(1).remove(0), will.team.clone()).probabilities(somewhere()).unwrap();
        agent.rebuild_posteriors().unwrap();
        prop_assert_eq!(agent.probabilities(somewhere()).unwrap(), nothing);
        // Its host knows by the numbers of messages what was sent, and so what was missed.
        for other in 1..trip.members() {
            let own = (0..trip.slots).filter(|&slot| slot as usize % trip.members() == other);
            agent.sent(&names(other + 1)[other], own.map(|slot| SLOT_S * f64::from(slot))).unwrap();
        }
        let missed = trip.events(0).into_iter().filter(|event| !event.success);
        agent.observe_all(missed).unwrap();
        agent.rebuild_posteriors().unwrap();
        let mut own = trip.vehicle(0);
        own.rebuild_posteriors().unwrap();
        let (found, expected) = (agent.probabilities(somewhere()).unwrap(), own.probabilities(somewhere()).unwrap());
        prop_assert!(largest_difference(&found, &expected) < 1e-9);
    }
}

#[test]
fn a_ledger_takes_a_byte_for_each_transmission() {
    // One vehicle sends every 40 s for half an hour, and stays where it is.
    let slots = Slots::at_will(2.0, names(3));
    let team = Arc::new(Team { slots, ..team(3, model()) });
    let mut agent = Agent::new(names(1).remove(0), team.clone());
    agent.navigate([0.0, 400.0].map(|time_s| (time_s, Position::new(0.0, 0.0)))).unwrap();
    agent.sent(&names(1)[0], (0..10).map(|n| 40.0 * f64::from(n))).unwrap();
    let frame = agent.next_packet(0.0, 64).unwrap().unwrap();
    // Head, span and counts take ten bytes less half of one, each of four knots three.
    assert_eq!(frame.len(), 10 + 4 * 3 + 10);
    let mut other = Agent::new(names(2).remove(1), team);
    other.navigate([0.0, 400.0].map(|time_s| (time_s, Position::new(500.0, 0.0)))).unwrap();
    assert_eq!(other.receive(&frame, 400.0), Receipt::Accepted);
    let times_s: Vec<f64> = other.unheard(100.0).iter().map(|event| event.time_s).collect();
    assert_eq!(times_s, [120.0, 160.0, 200.0, 240.0, 280.0, 320.0, 360.0]);
    assert!(other.recent(400.0, 16).is_none());
    assert!(matches!(agent.sent(&VehicleId::new("a ship"), [0.0]), Err(AgentError::NotMyTurn { .. })));
}

#[test]
fn who_said_that_it_sent_can_take_it_back() {
    let team = Arc::new(Team { slots: Slots::at_will(2.0, names(2)), ..team(2, model()) });
    let [mut agent, mut other] = [0, 1].map(|number| {
        let mut agent = vehicle(&team, number, []);
        agent.navigate([0.0, 400.0].map(|time_s| (time_s, Position::new(500.0 * number as f64, 0.0)))).unwrap();
        agent
    });
    let id = agent.id().clone();
    agent.sent(&id, (0..4).map(|n| 40.0 * f64::from(n))).unwrap();
    let mut unheard = |agent: &mut Agent| {
        let frame = agent.next_packet(200.0, 64).unwrap().unwrap();
        assert_eq!(other.receive(&frame, 200.0), Receipt::Accepted);
        other.unheard(f64::NEG_INFINITY).iter().map(|event| event.time_s).collect::<Vec<_>>()
    };
    assert_eq!(unheard(&mut agent), [0.0, 40.0, 80.0, 120.0]);
    agent.stay_silent([80.0]).unwrap();
    assert_eq!(unheard(&mut agent), [0.0, 40.0, 120.0]);
}
