//! Frames whose slot or counter is ahead of the vehicle's clock.

use std::sync::Arc;

use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::{Outcome, Report, Waypoint};

/// A report of a member about four slots, with its position in the first of them.
fn report(team: &Arc<Team>, sender: u8, first: u32) -> Vec<u8> {
    let report = Report {
        sender,
        model: 0,
        first,
        includes_own_slots: false,
        outcomes: vec![Outcome::Heard, Outcome::Missed, Outcome::Heard, Outcome::Heard],
        waypoints: vec![Waypoint { slots: 0, east: 40 + (first % 7) as u8, north: 90, depth: 0 }],
    };
    vehicle(team, 0, []).codec().write_report(&report).unwrap()
}

fn three() -> Arc<Team> {
    Arc::new(team(3, model()))
}

fn is_ahead(receipt: &Receipt) -> bool {
    matches!(receipt, Receipt::Refused(Refusal::SlotAhead { .. } | Refusal::CounterAhead { .. }))
}

#[test]
fn counters_beyond_the_schedule_wait_and_do_not_end_the_sharing_of_their_sender() {
    let team = three();
    let mut agent = vehicle(&team, 0, []);
    let mut receive = |counter| agent.receive(&empty_packet(&team, 1, counter), Some(0.0)).receipt;
    // Ten minutes ahead of slot 0 a member has 21 slots of eight frames.
    let largest = COUNTER_LEAD + 8 * 21;
    let ahead = |counter| Receipt::Refused(Refusal::CounterAhead { counter, largest });
    for counter in [65_535, 65_534, largest + 1] {
        assert_eq!(receive(counter), ahead(counter));
    }
    for counter in [0, 1, 2] {
        assert_eq!(receive(counter), Receipt::Accepted);
    }
    assert_eq!(receive(largest), Receipt::Accepted);
    let status = agent.status();
    assert_eq!((status.counts["ahead"], status.members[&name(1)].waiting_frames, status.live_packets), (3, 3, 1));
    // A day later the schedule allows every counter.
    agent.record_positions([(86_400.0, Position::new(0.0, 0.0))]).unwrap();
    assert_eq!(member(&agent, &name(1)).waiting_frames, 2);
    agent.record_positions([(3.0 * 86_400.0, Position::new(0.0, 0.0))]).unwrap();
    assert_eq!((member(&agent, &name(1)).waiting_frames, agent.status().live_packets), (0, 2));
}

#[test]
fn a_foreign_packet_with_the_largest_counter_does_not_use_up_the_counters_of_a_vehicle() {
    let team = three();
    let mut agent = vehicle(&team, 0, walk(0, 40, 0.0));
    for counter in [65_535, 65_534] {
        assert!(is_ahead(&agent.receive(&empty_packet(&team, 0, counter), Some(400.0)).receipt));
    }
    let bytes = agent.next_frame(None, 32).unwrap().unwrap().bytes;
    assert_eq!(agent.codec().read(&bytes).unwrap().1.counter, 0);
}

#[test]
fn reports_about_far_slots_do_not_end_the_window_of_correct_reports() {
    let team = three();
    let [mut agent, mut other] = [vehicle(&team, 0, []), vehicle(&team, 0, [])];
    for first in 262_000..262_140 {
        let receipt = agent.receive(&report(&team, 1, first), Some(5.0)).receipt;
        assert!(matches!(receipt, Receipt::Refused(Refusal::SlotAhead { latest: 60, .. })), "{receipt:?}");
    }
    assert_eq!(member(&agent, &name(1)).waiting_frames, 64, "the smallest slots are kept");
    for first in 0..50 {
        let (frame, time_s) = (report(&team, 1, 6 * first), Some(60.0 * f64::from(first)));
        assert_eq!(agent.receive(&frame, time_s).receipt, Receipt::Accepted);
        assert_eq!(other.receive(&frame, time_s).receipt, Receipt::Accepted);
    }
    assert!(remote_events(&agent).1 > 100);
    assert_eq!(remote_events(&agent), remote_events(&other));
}

/// A member whose clock is five hours ahead for one transmission.
#[test]
fn one_report_from_a_clock_far_ahead_changes_no_prediction_and_no_later_report() {
    let (mut trip, late) = (trip::Trip::stationary(&[(60, 128), (130, 128)], 240, |slot, _| Some(slot % 4 < 2)), 1800);
    trip = trip.with_team(|team| team.limits.report_window_slots = 512);
    let mut sender = trip.vehicle(1);
    let reports = frames(&mut sender, 12);
    let early = report(&trip.team, 1, late);
    let [mut with, mut without] = [true, false].map(|has_glitch| {
        let mut listener = trip.vehicle(0);
        receive_all(&mut listener, &reports[..2]);
        if has_glitch {
            assert!(is_ahead(&listener.receive(&early, None).receipt));
        }
        receive_all(&mut listener, &reports[2..]);
        listener
    });
    assert!(remote_events(&with).0 > 50);
    assert_eq!(remote_events(&with), remote_events(&without));
    assert_eq!(bits(&rebuilt_probabilities(&mut with)), bits(&rebuilt_probabilities(&mut without)));
}

#[test]
fn waiting_frames_count_in_any_order_of_frames_and_clock() {
    let team = three();
    let frames: Vec<Vec<u8>> = [1, 2]
        .into_iter()
        .flat_map(|sender| [report(&team, sender, 3), report(&team, sender, 400), empty_packet(&team, sender, 2000)])
        .collect();
    let fixes = [0.0, 900.0, 30_000.0].map(|time_s| (time_s, Position::new(0.0, 0.0)));
    let build = |clock_at: usize, reversed: bool| {
        let mut agent = vehicle(&team, 0, []);
        for place in 0..=frames.len() {
            if place == clock_at {
                agent.record_positions(fixes).unwrap();
            }
            let frame = frames.get(if reversed { frames.len().wrapping_sub(1 + place) } else { place });
            frame.into_iter().for_each(|frame| drop(agent.receive(frame, None).receipt));
        }
        agent
    };
    let reference = build(0, false);
    assert_eq!(reference.status().members.values().map(|member| member.waiting_frames).sum::<usize>(), 0);
    for clock_at in 0..=frames.len() {
        for reversed in [false, true] {
            let agent = build(clock_at, reversed);
            assert_eq!(agent.snapshot(), reference.snapshot(), "{clock_at} {reversed}");
            assert_eq!(remote_events(&agent), remote_events(&reference));
        }
    }
    // A snapshot holds frames that still wait.
    let waiting = build(frames.len() + 1, false);
    assert_eq!(member(&waiting, &name(1)).waiting_frames, 2);
    let mut restored = restored(&waiting, &waiting.snapshot());
    assert_eq!(restored.snapshot(), waiting.snapshot());
    restored.record_positions(fixes).unwrap();
    assert_eq!(restored.snapshot(), reference.snapshot());
}
