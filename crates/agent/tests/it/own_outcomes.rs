//! Own outcomes without positions, and frames that never left.

use std::collections::BTreeSet;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use proptest::prelude::*;

/// Records the outcomes of vehicle 0 without their positions.
fn record_outcomes(agent: &mut Agent, trip: &Trip) {
    for event in trip.events(0) {
        agent.record_outcome(&event.transmitter_id, event.time_s, event.success).unwrap();
    }
}

/// Records where all other members were in every slot.
fn record_peers(agent: &mut Agent, trip: &Trip, is_independent: bool) {
    for member in 1..trip.members() {
        for (time_s, position) in trip.positions(member) {
            agent.record_peer_position(&name(member), time_s, position, is_independent).unwrap();
        }
    }
}

/// The events of a vehicle that recorded outcomes alone, as the fit has them: predictions after a fit from nothing.
fn predictions_of_outcomes(trip: &Trip, is_independent: bool) -> Vec<f64> {
    let mut agent = trip.vehicle_with_events(0, []);
    record_outcomes(&mut agent, trip);
    record_peers(&mut agent, trip, is_independent);
    rebuilt_probabilities(&mut agent)
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn outcomes_with_known_positions_predict_as_events_do(trip in trips()) {
        let trip = trip.without_exclusion();
        let expected = rebuilt_probabilities(&mut trip.vehicle(0));
        let found = predictions_of_outcomes(&trip, true);
        prop_assert!(largest_difference(&found, &expected) < 1e-6, "{found:?} {expected:?}");
    }

    #[test]
    fn tracks_in_reports_locate_outcomes_without_positions(trip in trips()) {
        let trip = trip.without_exclusion();
        let reports: Vec<Vec<u8>> = (1..trip.members()).flat_map(|number| trip.reports_of(number)).collect();
        let mut by_events = trip.vehicle(0);
        let mut by_outcomes = trip.vehicle_with_events(0, []);
        record_outcomes(&mut by_outcomes, &trip);
        for agent in [&mut by_events, &mut by_outcomes] {
            receive_all(agent, &reports);
        }
        let located = trip.events(0).len() - by_outcomes.status().unlocated_events;
        prop_assert_eq!(by_outcomes.status().located_events, by_events.status().located_events + located);
        if by_outcomes.status().unlocated_events == 0 {
            let [expected, found] = [by_events, by_outcomes].map(|mut agent| rebuilt_probabilities(&mut agent));
            prop_assert!(largest_difference(&found, &expected) < 1e-6, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn reports_contain_outcomes_without_positions(trip in trips()) {
        let mut agent = trip.vehicle_with_events(0, []);
        record_outcomes(&mut agent, &trip);
        let mut receiver = trip.vehicle_with_events(1, []);
        receive_all(&mut receiver, &frames(&mut agent, 100));
        let status = receiver.status();
        prop_assert_eq!(status.located_events + status.unlocated_events, trip.events(0).len());
    }

    #[test]
    fn the_position_in_a_message_does_not_decide_whether_its_outcome_counts(
        trip in trips(), flipped in any::<prop::sample::Index>(),
    ) {
        // The host knows where a member was only from the messages that it hears.
        let vehicle = |trip: &Trip| {
            let mut agent = trip.vehicle_with_events(0, []);
            record_outcomes(&mut agent, trip);
            for event in trip.events(0).iter().filter(|event| event.success) {
                let (id, at) = (&event.transmitter_id, event.link.transmitter);
                agent.record_peer_position(id, event.time_s, at, false).unwrap();
            }
            agent
        };
        let slots: Vec<u32> = (0..trip.slots).filter(|&slot| trip.event(slot, 0).is_some()).collect();
        prop_assume!(!slots.is_empty());
        let slot = *flipped.get(&slots);
        let is_located = |success: bool| {
            let mut trip = trip.clone();
            trip.outcomes[slot as usize][0] = Some(success);
            // Without the outcome of the slot fewer events are located, if it was located.
            let with = vehicle(&trip).status().located_events;
            let mut without = trip.clone();
            without.outcomes[slot as usize][0] = None;
            let mut agent = trip.vehicle_with_events(0, []);
            record_outcomes(&mut agent, &without);
            for event in trip.events(0).iter().filter(|event| event.success) {
                let (id, at) = (&event.transmitter_id, event.link.transmitter);
                agent.record_peer_position(id, event.time_s, at, false).unwrap();
            }
            with - agent.status().located_events
        };
        prop_assert_eq!(is_located(true), is_located(false));
    }

    #[test]
    fn frames_that_were_dropped_are_sent_again_under_other_counters(trip in trips(), sharing_reports in any::<bool>()) {
        let options = if sharing_reports { reports_alone() } else { summaries_alone() };
        let new = || {
            let mut agent = vehicle_with(&trip.team, 0, options, trip.events(0));
            agent.record_positions(trip.positions(0)).unwrap();
            agent
        };
        let (mut dropping, mut sending) = (new(), new());
        let mut dropped = BTreeSet::new();
        for _ in 0..5 {
            let Some(frame) = dropping.next_frame(None, 32).unwrap() else { break };
            dropping.frame_dropped(frame.number).unwrap();
            dropped.insert(frame.bytes);
        }
        let live = dropping.status().live_packets;
        prop_assert_eq!(live, 0);
        let [again, first] = [&mut dropping, &mut sending].map(|agent| frames(agent, 100));
        // The content is that of a vehicle that never had a dropped frame.
        let learned = |frames: &[Vec<u8>]| {
            let mut receiver = trip.vehicle_with_events(1, []);
            receive_all(&mut receiver, frames);
            (remote_events(&receiver), rebuilt_probabilities(&mut receiver))
        };
        let (again_learned, first_learned) = (learned(&again), learned(&first));
        prop_assert_eq!(again_learned.0, first_learned.0);
        prop_assert!(largest_difference(&again_learned.1, &first_learned.1) < 1e-9);
        if !sharing_reports {
            prop_assert!(again.iter().all(|frame| !dropped.contains(frame)));
        }
    }
}

#[test]
fn receptions_outside_of_slots_show_a_wrong_clock_and_never_count() {
    let trip = Trip::stationary(&[(10, 10), (30, 10), (10, 30)], 48, |_, receiver| (receiver == 0).then_some(true));
    let mut agent = trip.vehicle_with_events(0, []);
    record_peers(&mut agent, &trip, true);
    for slot in 0..trip.slots {
        // Messages of vehicle 1 arrive one slot late, and its slots stay silent.
        match trip.sender(slot) {
            1 => {
                agent.record_outcome(&name(1), slot_s(slot), false).unwrap();
                agent.record_outcome(&name(1), slot_s(slot + 1), true).unwrap();
            }
            2 => drop(agent.record_outcome(&name(2), slot_s(slot), slot % 2 == 0).unwrap()),
            _ => {}
        }
    }
    assert_eq!(member(&agent, &name(1)).clock_offset_slots, Some(1));
    assert!(member(&agent, &name(1)).is_ignored(IgnoreReason::OutOfSlot));
    assert_eq!(agent.status().located_events, 16);
}

#[test]
fn unknown_members_slots_and_frames_are_refused() {
    let trip = Trip::stationary(&[(10, 10), (30, 10)], 8, |_, _| Some(true));
    let mut agent = trip.vehicle(0);
    let before = agent.snapshot();
    let stranger = VehicleId::new("stranger");
    for id in [&stranger, &name(0)] {
        assert_eq!(agent.record_outcome(id, 10.0, true), Err(AgentError::NotAPeer(id.clone())));
        let at = Position::new(0.0, 0.0);
        assert_eq!(agent.record_peer_position(id, 10.0, at, true), Err(AgentError::NotAPeer(id.clone())));
    }
    assert_eq!(agent.record_outcome(&name(1), -10.0, true), Err(AgentError::NoSlot { time_s: -10.0 }));
    assert!(matches!(agent.record_outcome(&name(1), f64::NAN, true), Err(AgentError::NoTime { .. })));
    assert_eq!(agent.frame_dropped(0), Err(AgentError::NoSuchFrame(0)));
    assert_eq!(agent.frame_departed(7, 10.0), Err(AgentError::NoSuchFrame(7)));
    assert_eq!(agent.snapshot(), before);
}

#[test]
fn an_outcome_that_is_recorded_twice_counts_once() {
    let trip = Trip::stationary(&[(10, 10), (30, 10)], 8, |_, _| Some(true));
    let mut agent = trip.vehicle_with_events(0, []);
    record_peers(&mut agent, &trip, true);
    assert!(agent.record_outcome(&name(1), 10.0, true).unwrap().is_some());
    assert_eq!(agent.record_outcome(&name(1), 10.0, true).unwrap(), None);
    assert_eq!(agent.status().located_events, 1);
    // Heard and missed in one slot is a contradiction, and counts as neither.
    agent.record_outcome(&name(1), 10.0, false).unwrap();
    assert_eq!(agent.status().located_events, 0);
}

#[test]
fn a_reported_track_locates_no_own_outcome_after_its_end() {
    let trip = Trip::stationary(&[(10, 10), (30, 10)], 24, |_, receiver| (receiver == 0).then_some(true));
    let mut peer = vehicle_with(&trip.team, 1, reports_alone(), []);
    peer.record_positions(trip.positions(1).take_while(|(time_s, _)| *time_s <= slot_s(12))).unwrap();
    peer.record_outcome(&name(0), slot_s(12), true).unwrap();
    let mut agent = trip.vehicle_with_events(0, []);
    record_outcomes(&mut agent, &trip);
    receive_all(&mut agent, &frames(&mut peer, 10));
    // The slots of vehicle 1 from slot 13 on.
    assert_eq!(agent.status().unlocated_events, 6);
}

#[test]
fn false_claims_about_forgotten_outcomes_do_not_count_in_any_order() {
    let trip =
        Trip::stationary(&[(10, 10), (30, 10)], 120, |_, _| Some(true)).with_team(|team| team.limits.events_max = 60);
    let mut liar = trip.vehicle(1);
    liar.record_unused_slots((1..40).step_by(2).map(slot_s)).unwrap();
    let claims = frames(&mut liar, 20);
    let vehicle = |claims_at: u32| {
        let mut agent = trip.vehicle_with_events(0, []);
        for (slot, event) in (0..trip.slots).map(|slot| (slot, trip.event(slot, 0))) {
            if slot == claims_at {
                receive_all(&mut agent, &claims);
                let is_ignored = member(&agent, &name(1)).is_ignored(IgnoreReason::FalseClaims);
                assert_eq!(is_ignored, claims_at == 60);
            }
            if let Some(event) = event {
                agent.record_outcome(&event.transmitter_id, event.time_s, event.success).unwrap();
            }
        }
        agent
    };
    for agent in [vehicle(60), vehicle(119)] {
        assert!(!member(&agent, &name(1)).is_ignored(IgnoreReason::FalseClaims));
    }
}
