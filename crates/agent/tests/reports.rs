//! What vehicles hear and miss, told one by one: everybody comes to know what everything in one place says, whatever is lost,
//! doubled or late on the way.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use pingmap_packet::Outcome;
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn who_hears_all_reports_knows_what_everything_in_one_place_says(trip in trips()) {
        let trip = trip.trusting();
        let reports = trip.reports();
        let all = trip.all_in_one_place();
        for number in 0..trip.members() {
            let mut agent = trip.vehicle(number);
            reports.iter().for_each(|report| { agent.receive(report, 0.0); });
            let (told, waiting) = agent.told_events();
            let others: usize = (0..trip.members()).filter(|&other| other != number).map(|other| trip.events(other).len()).sum();
            prop_assert_eq!((told, waiting), (others, 0));
            agent.rebuild_posteriors().unwrap();
            let mut all = all.clone();
            let ((mean, variance), (mean_all, variance_all)) = (latent(&mut agent), latent(&mut all));
            prop_assert!(largest_difference(&mean, &mean_all) < 1e-9, "{mean:?} {mean_all:?}");
            prop_assert!(largest_difference(&variance, &variance_all) < 1e-9);
        }
    }

    #[test]
    fn order_and_repeats_do_not_matter(trip in trips(), order in any::<prop::sample::Index>(), lost in 0..4usize) {
        let mut reports = trip.reports();
        let kept = reports.len().saturating_sub(lost);
        reports.truncate(kept);
        let mut one = trip.vehicle(0);
        reports.iter().for_each(|report| { one.receive(report, 0.0); });
        let mut other = trip.vehicle(0);
        let turn = if reports.is_empty() { 0 } else { order.index(reports.len()) };
        reports.rotate_left(turn);
        reports.extend(reports.clone());
        reports.reverse();
        for (n, report) in reports.iter().enumerate() {
            other.receive(report, 0.0);
            if n == turn {
                // Questions in between change nothing either.
                other.probability(somewhere()[0]).unwrap();
                other.refit().unwrap();
            }
        }
        prop_assert_eq!(one.told_events(), other.told_events());
        prop_assert_eq!(one.snapshot(), other.snapshot());
        one.rebuild_posteriors().unwrap();
        other.rebuild_posteriors().unwrap();
        let ((mean, _), (mean_other, _)) = (latent(&mut one), latent(&mut other));
        prop_assert_eq!(bits(&mean), bits(&mean_other));
    }

    #[test]
    fn what_is_recorded_before_and_after_reports_is_the_same(
        trip in trips(), order in Just((0..400usize).collect::<Vec<_>>()).prop_shuffle(), is_in_order in any::<bool>(),
        max in prop_oneof![Just(256), 1..6u16], owns_all in any::<bool>(), asks in prop::collection::vec(any::<bool>(), 20),
    ) {
        // Where few reports are kept, some go for others.
        let team = Team { reports_per_sender_max: max, ..(*trip.team).clone() };
        let trip = Trip { team: Arc::new(team), ..trip };
        let agent = || {
            let agent = Agent::new(names(1).remove(0), trip.team.clone());
            if owns_all { agent.owning_all_events() } else { agent }
        };
        // Where it was and what it heard slot by slot, and after some slots a report of somebody.
        let others: Vec<Vec<u8>> = (1..trip.members()).flat_map(|number| trip.reports_under_way(number)).collect();
        let count = others.len();
        let mut entries: Vec<Entry> = (0..trip.slots).flat_map(|slot| {
            let (time_s, number) = (SLOT_S * f64::from(slot), u64::from(slot));
            let navigated = Entry::Navigated { time_s, position: trip.at(0, slot) };
            let receiver = if owns_all { slot as usize / 3 % trip.members() } else { 0 };
            let observed = trip.event(slot, receiver).map(|event| Entry::Observed { number, event });
            let heard = (slot % 2 == 1).then(|| others.get(slot as usize / 2 % count.max(1))).flatten();
            let heard = heard.map(|bytes| Entry::Heard { bytes: bytes.clone() });
            [Some(navigated), observed, heard].into_iter().flatten().collect::<Vec<_>>()
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
                asked.told_events();
            }
        }
        prop_assert_eq!(asked.told_events(), at_once.told_events());
        asked.rebuild_posteriors().unwrap();
        at_once.rebuild_posteriors().unwrap();
        prop_assert_eq!(latent(&mut asked), latent(&mut at_once));
    }

    #[test]
    fn a_snapshot_holds_reports_and_where_it_was(trip in trips()) {
        let mut agent = trip.vehicle(0);
        // When they were heard, which says who else has them, is no part of it.
        trip.reports().iter().for_each(|report| { agent.receive(report, f64::NAN); });
        agent.refit().unwrap();
        agent.next_packet(0.0, 32).unwrap();
        let snapshot = agent.snapshot();
        let mut again = restored(&agent, &snapshot).telling(Telling { points: false, reports: true });
        prop_assert_eq!(again.snapshot(), snapshot);
        prop_assert_eq!(again.told_events(), agent.told_events());
        agent.rebuild_posteriors().unwrap();
        again.rebuild_posteriors().unwrap();
        prop_assert_eq!(latent(&mut agent), latent(&mut again));
        prop_assert_eq!(agent.next_packet(0.0, 32).unwrap(), again.next_packet(0.0, 32).unwrap());
    }
}

proptest! {
    #![proptest_config(cases(32))]

    /// Where everything heard was missed, and the other way round, the same is known and the same waits.
    #[test]
    fn what_waits_for_a_place_does_not_depend_on_what_became_of_it(trip in trips(), lost in prop::collection::vec(any::<bool>(), 40)) {
        let trip = trip.trusting();
        let mut listener = trip.vehicle(0);
        let mut opposite = listener.clone();
        let reports = (1..trip.members()).flat_map(|number| trip.reports_under_way(number));
        for report in reports.zip(lost.iter().cycle()).filter(|(_, lost)| !**lost).map(|(report, _)| report) {
            let (_, mut message, _) = listener.read_report(&report).unwrap();
            prop_assert!(!message.tells_own);
            for outcome in &mut message.outcomes {
                *outcome = match outcome {
                    Outcome::Heard => Outcome::Missed,
                    Outcome::Missed => Outcome::Heard,
                    Outcome::Untold => Outcome::Untold,
                };
            }
            listener.receive(&report, f64::INFINITY);
            opposite.receive(&opposite.write_report(&message).unwrap(), f64::INFINITY);
        }
        prop_assert_eq!(listener.told_events(), opposite.told_events());
        for (heard, missed) in listener.told_shares_heard().into_iter().zip(opposite.told_shares_heard()) {
            prop_assert!(heard.is_none() == missed.is_none() && heard.zip(missed).is_none_or(|(a, b)| (a + b - 1.0).abs() < 1e-12));
        }
    }
}

/// Three vehicles that lie still, and what each of the first two hears of the third.
fn still(outcomes: [&[bool]; 2]) -> (Arc<Team>, Vec<Agent>) {
    let team = Arc::new(team(3, model()));
    let places = [(-300.0, 0.0), (300.0, 0.0), (0.0, 100.0)].map(|(east, north)| {
        let cell = team.grid.knot_cell(&team.model.chart, &Position::new(east, north)).unwrap();
        team.grid.knot_position(&team.model.chart, cell, false)
    });
    let agents = (0..3).map(|number| {
        let heard = outcomes.get(number).copied().unwrap_or_default().iter().enumerate();
        let event = |(n, &success): (usize, &bool)| Event {
            time_s: SLOT_S * (3 * n + 2) as f64,
            transmitter_id: names(3).remove(2),
            receiver_id: names(3).remove(number),
            link: Link { transmitter: places[2], receiver: places[number] },
            kind: None,
            success,
        };
        let mut agent = vehicle(&team, number, heard.map(event)).telling(Telling { points: false, reports: true });
        agent.navigate((0..1000).map(|slot| (SLOT_S * f64::from(slot), places[number]))).unwrap();
        agent
    });
    let agents = agents.collect();
    (team, agents)
}

#[test]
fn events_wait_for_places_whatever_their_outcome() {
    let (_, mut agents) = still([&[true, false, true, false, false], &[]]);
    let reports = sent(&mut agents[0], 20);
    let mut listener = agents[1].clone();
    reports.iter().for_each(|report| drop(listener.receive(report, 0.0)));
    // Where the third one was it has not said.
    assert_eq!(listener.told_events(), (0, 5));
    // It heard nobody, and so it does not know that the schedule is in force until it hears somebody.
    let places = Link { transmitter: Position::new(-300.0, 0.0), receiver: Position::new(0.0, 100.0) };
    let [transmitter_id, receiver_id] = [0, 2].map(|number| names(3).remove(number));
    let event = Event { time_s: 0.0, transmitter_id, receiver_id, link: places, kind: None, success: true };
    agents[2].observe(event).unwrap();
    for report in sent(&mut agents[2], 20) {
        listener.receive(&report, 0.0);
    }
    assert_eq!(listener.told_events(), (6, 0));
}

#[test]
fn a_member_that_is_muted_counts_no_more_and_comes_back() {
    let (_, mut agents) = still([&[true; 40], &[]]);
    let link = agents[0].events().next().unwrap().link;
    let mut listener = Agent::new(VehicleId::new("shore"), Arc::new(agents[0].team().clone()));
    let before = listener.probability(link).unwrap();
    let mut third = agents[2].clone();
    third
        .observe(Event {
            receiver_id: names(3).remove(2),
            transmitter_id: names(3).remove(0),
            time_s: 0.0,
            ..agents[0].events().next().unwrap().clone()
        })
        .unwrap();
    for report in sent(&mut agents[0], 20).into_iter().chain(sent(&mut third, 20)) {
        listener.receive(&report, 0.0);
    }
    listener.mute(&names(3)[2]);
    listener.refit().unwrap();
    let told = listener.probability(link).unwrap();
    assert!(told > 0.8 && told > before, "{before} {told}");
    listener.mute(&names(3)[0]);
    let muted = listener.probability(link).unwrap();
    assert!((muted - before).abs() < 1e-9, "{before} {muted}");
    listener.unmute(&names(3)[0]);
    assert!((listener.probability(link).unwrap() - told).abs() < 1e-9);
}

/// What both ends of a line heard of one place goes together as if it were in one place.
#[test]
fn what_one_told_and_another_missed_is_weighed_as_in_one_place() {
    let (team, mut agents) = still([&[true; 80], &[false; 10]]);
    let mut all = Agent::new(VehicleId::new("shore"), team).owning_all_events();
    all.observe_all(agents.iter().flat_map(events).collect::<Vec<_>>()).unwrap();
    all.rebuild_posteriors().unwrap();
    let mut third = agents[2].clone();
    let some = agents[0].events().next().unwrap().clone();
    third
        .observe(Event {
            receiver_id: names(3).remove(2),
            transmitter_id: names(3).remove(0),
            time_s: 0.0,
            ..some.clone()
        })
        .unwrap();
    let mut listener = agents[1].clone();
    for report in sent(&mut agents[0], 20).into_iter().chain(sent(&mut third, 20)) {
        listener.receive(&report, 0.0);
    }
    listener.mute(&names(3)[2]);
    listener.refit().unwrap();
    let (together, apart) = (all.probability(some.link).unwrap(), listener.probability(some.link).unwrap());
    assert!((together - apart).abs() < 0.01, "{together} {apart}");
}

/// Nobody would ever know where they took place.
#[test]
fn transmissions_of_no_member_are_told_by_points() {
    let heard = walk(0, 60, 0.0);
    let opportunity = |event: &Event| Opportunity {
        time_s: event.time_s,
        sender: event.transmitter_id.clone(),
        listeners: vec![event.receiver_id.clone()],
    };
    let listed: Vec<Opportunity> = heard.iter().map(opportunity).collect();
    let team = team(2, model());
    let team = Arc::new(Team { slots: Slots { listed: Some(listed.into()), ..team.slots.clone() }, ..team });
    let packets = sent(&mut vehicle(&team, 0, heard), 4);
    assert!(!packets.is_empty() && packets.iter().all(|packet| pingmap_packet::ReportLayout::of(packet).is_none()));
}

#[test]
fn what_is_no_report_of_the_team_is_refused() {
    let (team, mut agents) = still([&[true, false, true], &[]]);
    let report = sent(&mut agents[0], 1).remove(0);
    let mut listener = agents[1].clone();
    let mut damaged = report.clone();
    damaged[6] ^= 4;
    assert!(matches!(
        listener.receive(&damaged, 0.0),
        Receipt::Refused(Refusal::OtherTeam { .. } | Refusal::Malformed(_))
    ));
    assert_eq!(agents[0].receive(&report, 0.0), Receipt::Refused(Refusal::Duplicate));
    let mut twin = Agent::new(names(1).remove(0), team.clone());
    assert_eq!(twin.receive(&report, 0.0), Receipt::Refused(Refusal::OwnReport));
    let sealed = Arc::new(Team { key: Some(key(3)), ..(*team).clone() });
    let mut stranger = Agent::new(names(2).remove(1), sealed);
    assert!(matches!(stranger.receive(&report, 0.0), Receipt::Refused(Refusal::OtherForm { .. })));
    let padded = [report.clone(), vec![0; 7]].concat();
    assert_eq!(listener.receive(&padded, 0.0), Receipt::Accepted);
    assert_eq!(listener.receive(&report, 0.0), Receipt::Refused(Refusal::Duplicate));
    assert_eq!((listener.counts().accepted, listener.counts().duplicate), (1, 1));
}

#[test]
fn slots_are_numbered_by_time_through_changes_and_long_turns() {
    let [a, b, c] = [0, 1, 2].map(|number| names(3).remove(number));
    let nobody = VehicleId::new("");
    let change = |from, order: &[&VehicleId]| SlotChange { from, order: order.iter().map(|&id| id.clone()).collect() };
    let slots = Slots {
        start_s: 100.0,
        changes: vec![change(7, &[&c, &nobody, &a]), change(13, &[&b])],
        ..Slots::in_turn(5.0, vec![a.clone(), b.clone()])
    };
    let senders = |from: u32, to: u32| (from..to).map(|slot| slots.sender(slot).cloned()).collect::<Vec<_>>();
    let some = |id: &VehicleId| Some(id.clone());
    assert_eq!(senders(0, 7), [&a, &b, &a, &b, &a, &b, &a].map(some));
    assert_eq!(senders(7, 15), [some(&c), None, some(&a), some(&c), None, some(&a), some(&b), some(&b)]);
    assert_eq!((slots.number(99.9), slots.number(100.0), slots.number(139.0)), (None, Some(0), Some(7)));
    // A turn of two slots is one opportunity, which began with the first.
    assert_eq!(
        (slots.sent_in(136.0, &c), slots.sent_in(142.0, &c), slots.sent_in(142.0, &a)),
        (Some(7), Some(7), None)
    );
    let next = [(101.0, &a), (106.0, &a), (142.0, &a), (142.0, &c)].map(|(time_s, id)| slots.next_turn(time_s, id));
    assert_eq!(next, [Some(0), Some(2), Some(9), Some(7)]);
    let never = [(99.0, &a), (f64::INFINITY, &a), (200.0, &a)].map(|(time_s, id)| slots.next_turn(time_s, id));
    assert_eq!(never, [None; 3]);
    // Behind a change of order its turn is late.
    let late =
        Slots { changes: vec![change(2, &[&b, &c, &a])], ..Slots::in_turn(5.0, vec![a.clone(), b.clone(), c.clone()]) };
    assert_eq!(late.next_turn(5.0, &a), Some(4));
    let opportunity =
        |(time_s, sender): (f64, &VehicleId)| Opportunity { time_s, sender: sender.clone(), listeners: Vec::new() };
    let listed = [(1.0, &a), (4.0, &b), (6.0, &b), (9.0, &a)].map(opportunity);
    let listed = Slots { listed: Some(listed.into()), ..Slots::in_turn(1.0, Vec::new()) };
    // What is listed goes on until the next one.
    let next = [(0.0, &a), (2.0, &a), (2.0, &b), (5.0, &a), (9.5, &b), (f64::INFINITY, &a)];
    let next = next.map(|(time_s, id)| listed.next_turn(time_s, id));
    assert_eq!(next, [None, Some(0), Some(1), Some(3), None, None]);
    assert!(slots.is_heard_by(7, &a) && !slots.is_heard_by(7, &c) && !slots.is_heard_by(8, &a));
    assert_eq!(slots.begin_s(7), Some(135.0));
    let later = slots.clone().beginning_by(1000.0);
    assert!((990.0..=1000.0).contains(&later.start_s), "{}", later.start_s);
    assert_eq!(later.owner(later.start_s), Some(&a));
}
