//! Reports: single outcomes by slot. Every listener predicts as a station with all events, in spite of losses and
//! delays.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::Outcome;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn a_listener_to_all_reports_predicts_as_a_station_with_all_events(trip in trips(), is_explicit in any::<bool>()) {
        let trip = if is_explicit { trip.with_explicit_schedule() } else { trip }.without_exclusion();
        let reports = trip.reports();
        let mut station = trip.station();
        for number in 0..trip.members() {
            let mut agent = trip.vehicle(number);
            receive_all(&mut agent, &reports);
            prop_assert_eq!(remote_events(&agent), (trip.remote_event_count(number), 0));
            agent.rebuild().unwrap();
            prop_assert!(latent_difference(&mut agent, &mut station) < 1e-9);
        }
    }

    #[test]
    fn order_and_repetition_of_reports_do_not_matter(trip in trips(), order in any::<prop::sample::Index>(), lost in 0..4usize) {
        let mut reports = trip.reports();
        let kept = reports.len().saturating_sub(lost);
        reports.truncate(kept);
        let mut one = trip.vehicle(0);
        receive_all(&mut one, &reports);
        let mut other = trip.vehicle(0);
        let turn = if reports.is_empty() { 0 } else { order.index(reports.len()) };
        reports.rotate_left(turn);
        reports.extend(reports.clone());
        reports.reverse();
        for (n, report) in reports.iter().enumerate() {
            other.receive(report, None);
            if n == turn {
                other.probability(test_links()[0]).unwrap();
                other.refit().unwrap();
            }
        }
        prop_assert_eq!(remote_events(&one), remote_events(&other));
        prop_assert_eq!(one.snapshot(), other.snapshot());
        one.rebuild().unwrap();
        other.rebuild().unwrap();
        prop_assert_eq!(bits(&test_latent(&mut one).0), bits(&test_latent(&mut other).0));
    }

    #[test]
    fn own_data_may_be_recorded_before_or_after_reports(
        trip in trips(), order in Just((0..400usize).collect::<Vec<_>>()).prop_shuffle(), is_in_order in any::<bool>(),
        max in prop_oneof![Just(256), 1..6u16], record_all_receivers in any::<bool>(),
        asks in prop::collection::vec(any::<bool>(), 20),
    ) {
        // If few reports are stored, later ones displace earlier ones.
        let trip = trip.with_team(|team| team.reports_per_sender_max = max);
        let options = AgentOptions { record_all_receivers, ..AgentOptions::default() };
        let agent = || Agent::new(name(0), trip.team.clone(), options);
        // Position and outcome of every slot, and a report after every other slot.
        let others: Vec<Vec<u8>> = (1..trip.members()).flat_map(|number| trip.reports_under_way(number)).collect();
        let count = others.len();
        let mut entries: Vec<Entry> = (0..trip.slots).flat_map(|slot| {
            let (time_s, number) = (slot_s(slot), u64::from(slot));
            let navigated = Entry::Navigated { time_s, position: trip.at(0, slot) };
            let receiver = if record_all_receivers { slot as usize / 3 % trip.members() } else { 0 };
            let observed = trip.event(slot, receiver).map(|event| Entry::Observed { number, event });
            let report = (slot % 2 == 1).then(|| others.get(slot as usize / 2 % count.max(1))).flatten();
            let received = report.map(|bytes| Entry::Received { time_s: None, bytes: bytes.clone() });
            [Some(navigated), observed, received].into_iter().flatten().collect::<Vec<_>>()
        }).collect();
        let mut at_once = agent();
        entries.iter().for_each(|entry| { at_once.apply(entry.clone()).unwrap(); });
        if !is_in_order {
            let mut places = order.into_iter().filter(|&place| place < entries.len());
            entries = std::iter::from_fn(|| places.next().map(|place| entries[place].clone())).collect();
        }
        let mut asked = agent();
        for (entry, &is_asked) in entries.into_iter().zip(asks.iter().cycle()) {
            asked.apply(entry).unwrap();
            if is_asked {
                asked.status();
            }
        }
        prop_assert_eq!(remote_events(&asked), remote_events(&at_once));
        asked.rebuild().unwrap();
        at_once.rebuild().unwrap();
        prop_assert_eq!(test_latent(&mut asked), test_latent(&mut at_once));
    }

    #[test]
    fn a_snapshot_holds_reports_and_positions(trip in trips()) {
        let mut agent = trip.vehicle(0);
        receive_all(&mut agent, &trip.reports());
        agent.refit().unwrap();
        agent.next_frame(Some(0.0), 32).unwrap();
        let snapshot = agent.snapshot();
        let mut again = restored(&agent, &snapshot);
        prop_assert_eq!(again.snapshot(), snapshot);
        prop_assert_eq!(remote_events(&again), remote_events(&agent));
        agent.rebuild().unwrap();
        again.rebuild().unwrap();
        prop_assert_eq!(test_latent(&mut agent), test_latent(&mut again));
        prop_assert_eq!(agent.next_frame(Some(0.0), 32).unwrap().map(|frame| frame.bytes), again.next_frame(Some(0.0), 32).unwrap().map(|frame| frame.bytes));
    }
}

proptest! {
    #![proptest_config(cases(32))]

    /// With all outcomes inverted, the same events are located and the same are not.
    #[test]
    fn whether_an_event_is_located_does_not_depend_on_its_outcome(
        trip in trips(), lost in prop::collection::vec(any::<bool>(), 40),
    ) {
        let trip = trip.without_exclusion();
        let mut listener = trip.vehicle(0);
        let mut inverted = listener.clone();
        let reports = (1..trip.members()).flat_map(|number| trip.reports_under_way(number));
        for report in reports.zip(lost.iter().cycle()).filter(|(_, lost)| !**lost).map(|(report, _)| report) {
            let (_, mut message, _) = listener.codec().read_report(&report).unwrap();
            prop_assert!(!message.includes_own_slots);
            for outcome in &mut message.outcomes {
                *outcome = match outcome {
                    Outcome::Heard => Outcome::Missed,
                    Outcome::Missed => Outcome::Heard,
                    Outcome::Unreported => Outcome::Unreported,
                };
            }
            listener.receive(&report, None);
            let opposite = inverted.codec().write_report(&message).unwrap();
            inverted.receive(&opposite, None);
        }
        prop_assert_eq!(remote_events(&listener), remote_events(&inverted));
    }
}

/// Three vehicles that do not move. Each of the first two records these outcomes of transmissions of the third.
fn stationary(outcomes: [&[bool]; 2]) -> (Trip, Vec<Agent>) {
    let trip = Trip::stationary(&[(64, 128), (192, 128), (128, 149)], 1000, |slot, receiver| {
        let outcomes = outcomes.get(receiver)?;
        (slot % 3 == 2).then(|| outcomes.get(slot as usize / 3).copied()).flatten()
    });
    let agents = (0..3).map(|number| trip.vehicle(number)).collect();
    (trip, agents)
}

/// Lets vehicle 2 record that it heard vehicle 0 in slot 0. Without an outcome it does not know whether the schedule is
/// in use.
fn record_slot_0(trip: &Trip, third: &mut Agent) {
    let link = Link { transmitter: trip.at(0, 0), receiver: trip.at(2, 0) };
    third.record([Event { transmitter_id: name(0), ..event_at(2, 0.0, link, true) }]).unwrap();
}

#[test]
fn events_wait_for_the_positions_of_both_ends() {
    let (trip, mut agents) = stationary([&[true, false, true, false, false], &[]]);
    let reports = frames(&mut agents[0], 20);
    let mut listener = agents[1].clone();
    receive_all(&mut listener, &reports);
    // Vehicle 2 has not reported its positions.
    assert_eq!(remote_events(&listener), (0, 5));
    record_slot_0(&trip, &mut agents[2]);
    receive_all(&mut listener, &frames(&mut agents[2], 20));
    assert_eq!(remote_events(&listener), (6, 0));
}

#[test]
fn events_of_a_muted_member_do_not_count_until_unmuting() {
    let (trip, mut agents) = stationary([&[true; 40], &[]]);
    let link = agents[0].events().next().unwrap().link;
    let mut listener = Agent::new(VehicleId::new("shore"), trip.team.clone(), AgentOptions::default());
    let before = listener.probability(link).unwrap();
    record_slot_0(&trip, &mut agents[2]);
    for number in [0, 2] {
        receive_all_at(&mut listener, &frames(&mut agents[number], 20), slot_s(trip.slots));
    }
    listener.refit().unwrap();
    let with_events = listener.probability(link).unwrap();
    assert!(with_events > 0.8 && with_events > before, "{before} {with_events}");
    listener.set_muted(&name(0), true);
    let muted = listener.probability(link).unwrap();
    assert!((muted - before).abs() < 1e-9, "{before} {muted}");
    listener.set_muted(&name(0), false);
    assert!((listener.probability(link).unwrap() - with_events).abs() < 1e-9);
}

#[test]
fn reported_and_own_events_of_one_place_weigh_the_same() {
    let (trip, mut agents) = stationary([&[true; 80], &[false; 10]]);
    let mut station = station(&trip.team, agents.iter().flat_map(events).collect::<Vec<_>>());
    let link = agents[0].events().next().unwrap().link;
    record_slot_0(&trip, &mut agents[2]);
    let mut listener = agents[1].clone();
    for number in [0, 2] {
        receive_all(&mut listener, &frames(&mut agents[number], 20));
    }
    listener.refit().unwrap();
    let (expected, found) = (station.probability(link).unwrap(), listener.probability(link).unwrap());
    assert!((expected - found).abs() < 0.01, "{expected} {found}");
}

#[test]
fn depths_do_not_matter_to_reports_under_a_model_without_depths() {
    // The grid has depths down to 32 m.
    let trip = Trip::stationary(&[(64, 128), (192, 128)], 60, |slot, _| Some(slot % 4 < 2));
    let deep = |position| Position { depth_m: Some(900.0), ..position };
    let dive = |from: u32| {
        let is_deep = move |time_s: f64| time_s >= slot_s(from);
        let events = trip.events(0).into_iter().map(move |mut event| {
            if is_deep(event.time_s) {
                event.link.receiver = deep(event.link.receiver);
            }
            event
        });
        let mut agent = vehicle_with(&trip.team, 0, reports_alone(), events);
        let fixes = trip.positions(0).map(|(time_s, at)| (time_s, if is_deep(time_s) { deep(at) } else { at }));
        agent.record_positions(fixes).unwrap();
        let reports = frames(&mut agent, 100);
        reports
            .iter()
            .flat_map(|report| reported_outcomes(&agent, report))
            .map(|(slot, _)| slot)
            .collect::<BTreeSet<u32>>()
    };
    let expected = dive(u32::MAX);
    assert!(expected.len() >= 30);
    for from in [0, 30] {
        assert_eq!(dive(from), expected, "{from}");
    }
}

#[test]
fn transmissions_of_strangers_are_sent_in_summaries() {
    // A listener could never locate them.
    let heard = walk(0, 60, 0.0);
    let scheduled = |event: &Event| ScheduledTransmission {
        time_s: event.time_s,
        sender: event.transmitter_id.clone(),
        listeners: vec![event.receiver_id.clone()],
    };
    let explicit: Vec<ScheduledTransmission> = heard.iter().map(scheduled).collect();
    let team = team(2, model());
    let team = Arc::new(Team { slots: Slots { explicit: Some(explicit.into()), ..team.slots.clone() }, ..team });
    let packets = frames(&mut vehicle(&team, 0, heard), 4);
    assert!(!packets.is_empty() && packets.iter().all(|packet| pingmap_packet::ReportLayout::of(packet).is_none()));
}

#[test]
fn reports_of_another_team_or_of_the_own_number_are_refused() {
    let (trip, mut agents) = stationary([&[true, false, true], &[]]);
    let report = frames(&mut agents[0], 1).remove(0);
    let mut listener = agents[1].clone();
    let mut damaged = report.clone();
    damaged[6] ^= 4;
    assert!(matches!(
        listener.receive(&damaged, None).receipt,
        Receipt::Refused(Refusal::OtherTeam { .. } | Refusal::Malformed(_))
    ));
    assert_eq!(agents[0].receive(&report, None).receipt, Receipt::Refused(Refusal::Duplicate));
    let mut twin = vehicle(&trip.team, 0, []);
    assert_eq!(twin.receive(&report, Some(slot_s(trip.slots))).receipt, Receipt::Refused(Refusal::OwnReport));
    let with_key = trip.with_team(|team| team.key = Some(key(3)));
    let mut stranger = vehicle(&with_key.team, 1, []);
    assert!(matches!(stranger.receive(&report, None).receipt, Receipt::Refused(Refusal::OtherForm(_))));
    let padded = [report.clone(), vec![0; 7]].concat();
    assert_eq!(listener.receive(&padded, None).receipt, Receipt::Accepted);
    assert_eq!(listener.receive(&report, None).receipt, Receipt::Refused(Refusal::Duplicate));
    assert_eq!(["accepted", "duplicate"].map(|class| count(&listener, class)), [1, 1]);
}
