//! Reports beyond the capacity of a vehicle, and reports that contradict each other or themselves.

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::{Cell, Outcome, OutcomeBitmap, Report, Waypoint};
use proptest::prelude::*;

/// Two vehicles that lie 900 m apart. They heard each other in every other slot.
fn two(slots: u32) -> Trip {
    let trip = Trip::stationary(&[(60, 128), (130, 128)], slots, |slot, _| Some(slot % 4 < 2));
    trip.with_team(|team| team.transmissions_max = 2)
}

#[test]
fn a_vehicle_that_stores_few_reports_sends_as_many_and_then_stops() {
    let mut trip = two(1200);
    // For a third of the mission vehicle 1 is near and heard.
    trip.corners[1][..50].fill(Cell { east: 70, north: 100, depth: 0 });
    trip.outcomes[..400].fill(vec![Some(true); 2]);
    for (max, sharing) in [(1, Sharing::reports()), (2, Sharing::reports()), (3, Sharing::default())] {
        let trip = trip.with_team(|team| team.reports_per_sender_max = max);
        let mut agent = trip.vehicle(0);
        agent.options.sharing = sharing;
        let frames = frames(&mut agent, 100);
        // A report displaces another one only if it holds something new. Summaries describe what reports no longer
        // hold.
        assert!(frames.len() < if sharing.summaries { 60 } else { 10 }, "{max}: {}", frames.len());
        let mut listener = trip.vehicle(1);
        receive_all(&mut listener, &frames);
        let (located, _) = remote_events(&listener);
        assert!(located > 40 * usize::from(max) && located < 600, "{max}: {located}");
        assert_eq!(listener.status().live_packets > 0, sharing.summaries);
    }
}

proptest! {
    /// A snapshot holds the reports that are still stored. A vehicle restored from it never had the others.
    #[test]
    fn a_report_that_left_the_window_has_no_effect(
        firsts in prop::collection::vec((0u32..60, 1usize..40, any::<u64>(), 0u8..40), 6..30), max in 1u16..6,
    ) {
        let trip = Trip::stationary(&[(60, 128), (130, 128)], 64, |_, _| Some(true));
        let trip = trip.with_team(|team| team.reports_per_sender_max = max);
        let mut agent = trip.vehicle(0);
        for (first, count, pattern, steps) in firsts {
            let outcome = |n: usize| if pattern >> n & 1 == 1 { Outcome::Heard } else { Outcome::Missed };
            let waypoint = |(n, slots)| Waypoint { slots, east: 100 + pattern.rotate_left(n) as u8 % 100, north: 128, depth: 0 };
            let report = Report {
                sender: 1,
                model: 0,
                first,
                includes_own_slots: pattern % 3 == 0,
                outcomes: (0..count).map(outcome).collect(),
                waypoints: [(3, 0), (7, steps), (11, 1 + steps)].map(waypoint).to_vec(),
            };
            let bytes = agent.codec().write_report(&report).unwrap();
            agent.receive(&bytes, Some(slot_s(64)));
        }
        agent.rebuild().unwrap();
        let mut restored = Agent::restore(name(0), trip.team.clone(), agent.options, &agent.snapshot()).unwrap();
        restored.rebuild().unwrap();
        prop_assert_eq!(remote_events(&agent), remote_events(&restored));
        prop_assert_eq!(bits(&test_probabilities(&mut agent)), bits(&test_probabilities(&mut restored)));
    }
}

#[test]
fn two_waypoints_in_one_slot_break_nothing() {
    let trip = Trip::stationary(&[(60, 128), (130, 128), (200, 128)], 48, |_, _| None);
    let mut agent = Agent::new(name(0), trip.team.clone(), AgentOptions::default());
    agent.record_positions([0.0, 400.0].map(|time_s| (time_s, Position::new(0.0, 0.0)))).unwrap();
    let waypoint = |slots, east| Waypoint { slots, east, north: 128, depth: 0 };
    for sender in [1, 2] {
        let report = Report {
            sender,
            model: 0,
            first: 3,
            includes_own_slots: true,
            outcomes: vec![Outcome::Heard; 12],
            waypoints: vec![waypoint(0, 10), waypoint(1, 250), waypoint(0, 90), waypoint(9, 40)],
        };
        let bytes = agent.codec().write_report(&report).unwrap();
        assert_eq!(agent.receive(&bytes, None).receipt, Receipt::Accepted);
    }
    assert!(remote_events(&agent).0 > 0);
    agent.rebuild().unwrap();
    let p = test_probabilities(&mut agent);
    assert!(p.iter().all(|p| (0.0..=1.0).contains(p)), "{p:?}");
    assert!(agent.status().longest_link_m.is_some_and(f64::is_finite));
}

#[test]
fn a_report_beyond_the_last_slot_breaks_nothing() {
    let trip = two(16);
    let mut agent = trip.vehicle(0);
    let waypoint = |slots| Waypoint { slots, east: 100, north: 128, depth: 0 };
    let report = Report {
        sender: 1,
        model: 0,
        first: pingmap_packet::SLOTS - 2,
        includes_own_slots: false,
        outcomes: vec![Outcome::Heard; 12],
        waypoints: vec![waypoint(0), waypoint(255), waypoint(255)],
    };
    let bytes = agent.codec().write_report(&report).unwrap();
    assert_eq!(agent.receive(&bytes, Some(slot_s(pingmap_packet::SLOTS))).receipt, Receipt::Accepted);
    let (located, unlocated) = remote_events(&agent);
    assert!(located + unlocated <= 1, "one of two slots is one of the listener");
    assert_eq!(restored(&agent, &agent.snapshot()).snapshot(), agent.snapshot());
    agent.rebuild().unwrap();
}

#[test]
fn a_report_that_corrects_piggybacked_outcomes_counts_at_once() {
    let trip = two(16);
    let mut agent = trip.vehicle_with_events(0, []);
    // Vehicle 0 transmits in even slots. It heard vehicle 1 between them.
    let link = trip.event(1, 0).unwrap().link;
    let seen = (0..9).map(|n| event_at(0, 20.0 * f64::from(n) - 1.0, link, true));
    agent.record(seen.map(|event| Event { transmitter_id: name(1), ..event })).unwrap();
    // Outcomes of slots 14, 12, … 0, all inverted.
    let inverted = OutcomeBitmap { slot_mod: 14, outcomes: (0..8).map(|n| (14 - 2 * n) % 4 >= 2).collect() };
    let report = trip.reports_of(1).remove(0);
    let link = trip.event(0, 1).unwrap().link;
    let mut never = agent.clone();
    never.receive(&report, None);
    assert_eq!(agent.receive_piggyback(&name(1), 150.0, inverted.encode(), 14).receipt, Receipt::Accepted);
    assert_eq!(remote_events(&agent), (8, 0));
    agent.refit().unwrap();
    agent.probability(link).unwrap();
    agent.receive(&report, None);
    never.refit().unwrap();
    let (found, expected) = (agent.probability(link).unwrap(), never.probability(link).unwrap());
    assert!((found - expected).abs() < 0.05, "{found} {expected}");
    agent.rebuild().unwrap();
    never.rebuild().unwrap();
    assert_eq!(agent.probability(link).unwrap(), never.probability(link).unwrap());
}

#[test]
fn a_late_position_moves_remote_events() {
    let trip = two(48);
    let reports = trip.reports_under_way(1);
    // With and without a report after the last prediction.
    for last in [reports.len(), reports.len() - 1] {
        let mut agent = Agent::new(name(0), trip.team.clone(), AgentOptions::default());
        let fix = |time_s: f64, east_m: f64| (time_s, Position::new(east_m, 0.0));
        agent.record_positions([fix(0.0, 0.0), fix(105.0, 0.0), fix(165.0, 900.0), fix(475.0, 900.0)]).unwrap();
        receive_all(&mut agent, &reports[..last]);
        let before = test_latent(&mut agent);
        receive_all(&mut agent, &reports[last..]);
        agent.record_positions([fix(135.0, 0.0)]).unwrap();
        let again = restored(&agent, &agent.snapshot());
        let latents = [agent, again].map(|mut agent| {
            agent.rebuild().unwrap();
            test_latent(&mut agent)
        });
        assert_eq!(latents[0], latents[1]);
        assert_ne!(latents[0], before);
    }
}

#[test]
fn contradictory_reports_of_one_number_count_as_neither() {
    let trip = two(16);
    let inverted = Trip {
        outcomes: trip.outcomes.iter().map(|slot| slot.iter().map(|o| o.map(|o| !o)).collect()).collect(),
        ..trip.clone()
    };
    let mut agent = trip.vehicle(0);
    receive_all(&mut agent, &trip.reports_of(1));
    assert_eq!(remote_events(&agent), (trip.remote_event_count(0), 0));
    receive_all(&mut agent, &inverted.reports_of(1));
    assert_eq!(remote_events(&agent), (0, 0));
    let mut alone = trip.vehicle(0);
    assert_eq!(rebuilt_probabilities(&mut agent), rebuilt_probabilities(&mut alone));
}

#[test]
fn a_report_longer_than_the_frames_of_the_team_is_refused() {
    let trip = two(1200);
    let mut agent = trip.vehicle(0);
    let max = agent.team().frame_bytes;
    let report = |outcomes| Report {
        sender: 1,
        model: 0,
        first: 0,
        includes_own_slots: true,
        outcomes: vec![Outcome::Missed; outcomes],
        waypoints: Vec::new(),
    };
    let before = agent.snapshot();
    // Outcomes that alternate cannot be encoded in runs.
    let mut long = report(600);
    long.outcomes.iter_mut().step_by(2).for_each(|outcome| *outcome = Outcome::Heard);
    let bytes = agent.codec().write_report(&long).unwrap();
    let refusal = Refusal::TooLong { length: bytes.len(), max };
    assert!(bytes.len() > max);
    assert_eq!(agent.receive(&bytes, None).receipt, Receipt::Refused(refusal));
    assert_eq!(agent.snapshot(), before);
    let bytes = agent.codec().write_report(&report(60)).unwrap();
    assert_eq!(agent.receive(&bytes, None).receipt, Receipt::Accepted);
}
