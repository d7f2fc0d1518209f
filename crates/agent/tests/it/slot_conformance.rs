//! Slot conformance: a member whose messages arrive outside its slots is detected, and its outcomes do not count
//! meanwhile.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::OutcomeBitmap;
use proptest::prelude::*;

const SLOTS: u32 = 200;

/// Five vehicles that do not move. Vehicle 0 hears seven of ten transmissions.
fn five() -> Trip {
    let cells = [(100, 128), (140, 128), (128, 150), (160, 110), (110, 100)];
    Trip::stationary(&cells, SLOTS, |slot, receiver| Some((7 * slot + 3 * (slot / 5) + receiver as u32) % 10 < 7))
}

/// Vehicle 0 with these events.
fn listener(trip: &Trip, late: impl Fn(usize, u32) -> i64) -> Agent {
    trip.vehicle_with_events(0, trip.recorded(late))
}

/// Offsets of the members that are out of slot.
fn out_of_slot(agent: &Agent) -> Vec<(VehicleId, Option<i32>)> {
    let members = agent.status().members.into_iter();
    let members = members.filter(|(_, member)| member.is_ignored(IgnoreReason::OutOfSlot));
    members.map(|(id, member)| (id, member.clock_offset_slots)).collect()
}

/// The time from the first reception of vehicle 3 outside its slots to the next one within.
fn span_s(trip: &Trip, events: &[Event]) -> (f64, f64) {
    let is_in_slot = |event: &Event| trip.team.slots.sent_in(event.time_s, &name(3)).is_some();
    let receptions: Vec<&Event> =
        events.iter().filter(|event| event.success && event.transmitter_id == name(3)).collect();
    let first = receptions.iter().position(|event| !is_in_slot(event)).unwrap();
    let next = receptions[first..].iter().find(|event| is_in_slot(event));
    (receptions[first].time_s, next.map_or(f64::INFINITY, |event| event.time_s))
}

/// Whether an event is one of vehicle 3 between these times.
fn is_in_span((from_s, to_s): (f64, f64), event: &Event) -> bool {
    event.transmitter_id == name(3) && (from_s..to_s).contains(&event.time_s)
}

/// Vehicle 3 is late from slot 60 to slot 140.
fn late_for_a_while(sender: usize, slot: u32) -> i64 {
    i64::from(sender == 3 && (60..140).contains(&slot))
}

#[test]
fn members_within_their_slots_are_not_reported() {
    let agent = listener(&five(), |_, _| 0);
    assert_eq!((out_of_slot(&agent), agent.status().own_clock_offset_slots), (vec![], None));
}

#[test]
fn a_member_outside_its_slots_is_detected_with_its_offset() {
    let trip = five();
    for offset in [-2, -1, 1, 2] {
        let agent = listener(&trip, |sender, _| if sender == 3 { offset } else { 0 });
        assert_eq!(out_of_slot(&agent), [(name(3), Some(offset as i32))]);
        assert_eq!(agent.status().own_clock_offset_slots, None);
    }
}

#[test]
fn three_receptions_outside_the_slots_do_not_suffice() {
    let trip = five();
    let all = trip.recorded(|sender, _| i64::from(sender == 3));
    let receptions: Vec<&Event> = all.iter().filter(|event| event.success && event.transmitter_id == name(3)).collect();
    for count in [3, 4] {
        let end_s = receptions[count].time_s;
        let agent = trip.vehicle_with_events(0, all.iter().filter(|event| event.time_s < end_s).cloned());
        assert_eq!(out_of_slot(&agent).len(), usize::from(count == 4));
    }
}

#[test]
fn an_offset_that_is_not_unique_is_not_reported() {
    // Vehicle 1 has every other slot, so that it may be early or late.
    let order = vec![name(0), name(1), name(2), name(1)];
    let team = Arc::new(Team { slots: Slots::cycle(SLOT_S, order), ..team(3, model()) });
    let link = link([0.0, 0.0, 100.0, 100.0]);
    let event = |slot: u32, sender: usize, success| Event {
        transmitter_id: name(sender),
        ..event_at(0, slot_s(slot), link, success)
    };
    let missed = (0..100).filter(|slot| slot % 2 == 1).map(|slot| event(slot, 1, false));
    let heard = (0..100).filter(|slot| slot % 2 == 0).map(|slot| event(slot, 1, true));
    let agent = vehicle(&team, 0, missed.chain(heard));
    assert_eq!(out_of_slot(&agent), [(name(1), None)]);
}

#[test]
fn a_member_that_returns_to_its_slots_conforms_again() {
    let trip = five();
    assert_eq!(out_of_slot(&listener(&trip, late_for_a_while)), []);
    let late_at_last = |sender, slot| i64::from(sender == 3 && slot >= 60);
    assert_eq!(out_of_slot(&listener(&trip, late_at_last)), [(name(3), Some(1))]);
}

#[test]
fn neither_heard_nor_missed_outcomes_outside_the_slots_count() {
    let trip = five();
    let events = trip.recorded(late_for_a_while);
    let span_s = span_s(&trip, &events);
    let (excluded, counting): (Vec<Event>, Vec<Event>) =
        events.iter().cloned().partition(|event| is_in_span(span_s, event));
    let count = |success: bool| excluded.iter().filter(|event| event.success == success).count();
    assert!(count(true) >= 8 && count(false) >= 8, "{} {}", count(true), count(false));
    let mut agent = trip.vehicle_with_events(0, events.iter().cloned());
    assert_eq!(agent.events().len(), events.len(), "recorded events stay recorded");
    agent.rebuild().unwrap();
    let mut expected = trip.vehicle_with_events(0, counting.iter().cloned());
    expected.rebuild().unwrap();
    assert!(latent_difference(&mut agent, &mut expected) < 1e-9);
    // Without fault they would count.
    let mut all = station(&trip.team, events.iter().cloned());
    assert!(latent_difference(&mut agent, &mut all) > 1e-3);
}

#[test]
fn excluded_outcomes_are_not_reported() {
    let trip = five();
    let events = trip.recorded(late_for_a_while);
    let span_s = span_s(&trip, &events);
    let mut agent = trip.vehicle_with_events(0, events.iter().cloned());
    let reports = frames(&mut agent, 100);
    let reported: BTreeSet<u32> =
        reports.iter().flat_map(|report| reported_outcomes(&agent, report)).map(|(slot, _)| slot).collect();
    // All other outcomes of members in their slots are reported.
    let is_expected = |&slot: &u32| {
        trip.sender(slot) != 0 && !(trip.sender(slot) == 3 && (span_s.0..span_s.1).contains(&slot_s(slot)))
    };
    assert_eq!(reported, (0..SLOTS).filter(is_expected).collect());
}

#[test]
fn excluded_outcomes_are_not_piggybacked() {
    let trip = five();
    let events = trip.recorded(late_for_a_while);
    let span_s = span_s(&trip, &events);
    let agent = trip.vehicle_with_events(0, events.iter().cloned());
    let mut count = 0;
    for now in (0..SLOTS).step_by(5) {
        let past = events.iter().filter(|event| event.time_s < slot_s(now)).cloned();
        // Its content is as of the whole mission, the bits as of a slot.
        let Some(bits) = trip.vehicle_with_events(0, past).piggyback(slot_s(now), 16) else { continue };
        let bitmap = OutcomeBitmap::decode(bits, 16).unwrap();
        let newest = (0..=now).rev().find(|slot| slot % 64 == u32::from(bitmap.slot_mod)).unwrap();
        let slots: Vec<u32> = (0..=newest).rev().filter(|&slot| trip.sender(slot) != 0).take(10).collect();
        let late = slots.iter().filter(|&&slot| trip.sender(slot) == 3 && (span_s.0..span_s.1).contains(&slot_s(slot)));
        // The first three receptions outside the slots do not show it yet.
        assert!(late.count() == 0 || now < 100, "{now}: {slots:?}");
        count += 1;
    }
    assert!(count > 10, "{count}");
    assert!(agent.piggyback(slot_s(SLOTS), 16).is_some());
}

/// Bits hold consecutive outcomes, and a late member leaves a gap in every cycle.
#[test]
fn piggybacking_pauses_while_a_member_is_outside_its_slots() {
    let trip = five();
    let events = trip.recorded(|sender, slot| i64::from(sender == 3 && slot >= 60));
    let bits_at = |now: u32| {
        let past = events.iter().filter(|event| event.time_s < slot_s(now)).cloned();
        trip.vehicle_with_events(0, past).piggyback(slot_s(now), 16)
    };
    assert!(bits_at(60).is_some());
    assert!((130..SLOTS).step_by(5).all(|now| bits_at(now).is_none()));
}

#[test]
fn reports_of_a_member_outside_its_slots_do_not_count() {
    let trip = five().without_exclusion();
    let events = trip.recorded(late_for_a_while);
    let (from_s, to_s) = span_s(&trip, &events);
    let agent = || trip.vehicle_with_events(0, events.iter().cloned());
    // Vehicle 3 reports its outcomes, the others report outcomes of vehicle 3.
    let mut reports: Vec<Vec<u8>> = (1..5).flat_map(|number| trip.reports_of(number)).collect();
    let is_out = |slot: u32| (from_s..to_s).contains(&slot_s(slot));
    let counts = |slot: u32, receiver: usize| !(is_out(slot) && (receiver == 3 || trip.sender(slot) == 3));
    let remote: usize = (1..5)
        .map(|receiver| {
            (0..SLOTS).filter(|&slot| trip.event(slot, receiver).is_some() && counts(slot, receiver)).count()
        })
        .sum();
    let mut listener = agent();
    receive_all(&mut listener, &reports);
    assert_eq!(remote_events(&listener), (remote, 0));
    // The order of arrival does not matter, nor whether reports come before own events.
    reports.reverse();
    let mut other = trip.vehicle_with_events(0, []);
    receive_all(&mut other, &reports);
    other.record(events.iter().cloned()).unwrap();
    assert_eq!(other.snapshot(), listener.snapshot());
    assert_eq!(remote_events(&other), (remote, 0));
    listener.rebuild().unwrap();
    other.rebuild().unwrap();
    assert_eq!(test_latent(&mut listener), test_latent(&mut other));
}

#[test]
fn an_offset_of_the_own_clock_shows_if_all_members_are_out_of_slot_alike() {
    let trip = five();
    for ahead in [-2, -1, 1, 2] {
        let agent = listener(&trip, |_, _| ahead);
        assert_eq!(agent.status().own_clock_offset_slots, Some(ahead as i32));
        assert_eq!(out_of_slot(&agent).len(), 4);
    }
    // Different offsets, or a member within its slots, show no offset of the own clock.
    let different = listener(&trip, |sender, _| if sender == 3 { 2 } else { 1 });
    assert_eq!((out_of_slot(&different).len(), different.status().own_clock_offset_slots), (4, None));
    let one_conforms = listener(&trip, |sender, _| i64::from(sender != 3));
    assert_eq!((out_of_slot(&one_conforms).len(), one_conforms.status().own_clock_offset_slots), (3, None));
}

#[test]
fn one_other_member_does_not_show_an_offset_of_the_own_clock() {
    let trip = five();
    let heard_one = |event: &Event| !event.success || event.transmitter_id == name(3);
    let events = trip.recorded(|_, _| 1).into_iter().filter(heard_one);
    let agent = trip.vehicle_with_events(0, events);
    assert_eq!((out_of_slot(&agent), agent.status().own_clock_offset_slots), (vec![(name(3), Some(1))], None));
}

#[test]
fn without_recorded_misses_nothing_is_detected() {
    let trip = five();
    let late = |sender, _| i64::from(sender == 3);
    let heard = trip.recorded(late).into_iter().filter(|event| event.success);
    assert_eq!(out_of_slot(&trip.vehicle_with_events(0, heard)), []);
    // Misses outside the slots show that the vehicle does not record by this schedule.
    let shifted = |event: Event| Event { time_s: event.time_s + if event.success { 0.0 } else { SLOT_S }, ..event };
    let elsewhere = trip.recorded(late).into_iter().map(shifted);
    assert_eq!(out_of_slot(&trip.vehicle_with_events(0, elsewhere)), []);
}

#[test]
fn with_an_explicit_schedule_nothing_is_detected() {
    let trip = five().with_explicit_schedule();
    let agent = listener(&trip, |_, _| 1);
    assert_eq!((out_of_slot(&agent), agent.status().own_clock_offset_slots), (vec![], None));
}

#[test]
fn events_before_the_first_slot_are_not_compared_with_the_schedule() {
    let trip = five();
    let events = trip.recorded(|_, _| 1);
    let later = trip.with_team(|team| team.slots.start_s = slot_s(SLOTS + 10));
    assert_eq!(out_of_slot(&later.vehicle_with_events(0, events)), []);
}

#[test]
fn events_of_other_receivers_are_not_compared_with_the_schedule() {
    let trip = five();
    let events: Vec<Event> =
        trip.recorded(|_, _| 1).into_iter().map(|event| Event { receiver_id: name(9), ..event }).collect();
    let options = AgentOptions { record_all_receivers: true, ..AgentOptions::default() };
    let agent = vehicle_with(&trip.team, 0, options, events.iter().cloned());
    assert_eq!(out_of_slot(&agent), []);
    assert_eq!(out_of_slot(&station(&trip.team, trip.recorded(|_, _| 1))), []);
}

#[test]
fn forgotten_events_do_not_show_anything() {
    let trip = five().with_team(|team| team.limits.events_max = 96);
    let late_at_first = |sender, slot| i64::from(sender == 3 && slot < 60);
    let events = trip.recorded(late_at_first);
    let mut agent = trip.vehicle_with_events(0, []);
    for event in &events {
        agent.record([event.clone()]).unwrap();
    }
    assert_eq!(out_of_slot(&agent), []);
    let kept: Vec<Event> = agent.events().cloned().collect();
    assert!(kept.len() <= 96 && kept[0].time_s > slot_s(60));
    agent.rebuild().unwrap();
    let mut fresh = trip.vehicle_with_events(0, kept);
    fresh.rebuild().unwrap();
    assert_eq!(test_latent(&mut agent), test_latent(&mut fresh));
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn detection_and_exclusion_do_not_depend_on_the_order_of_arrival(
        from in 0..120u32, length in 10..80u32, offset in prop_oneof![-2..0i64, 1..3i64],
        hears in prop::collection::vec(any::<bool>(), SLOTS as usize), shuffle in any::<u64>(), asked in any::<u64>(),
    ) {
        let mut trip = five();
        trip.outcomes = hears.iter().map(|&heard| vec![Some(heard); 5]).collect();
        let late = |sender: usize, slot: u32| if sender == 3 && (from..from + length).contains(&slot) { offset } else { 0 };
        let events = trip.recorded(late);
        let mut in_order = trip.vehicle_with_events(0, events.iter().cloned());
        let mut order: Vec<usize> = (0..events.len()).collect();
        order.sort_by_key(|&place| (place as u64 + 1).wrapping_mul(shuffle | 1).rotate_left(17));
        let mut unordered = trip.vehicle_with_events(0, []);
        for (step, place) in order.into_iter().enumerate() {
            unordered.apply(Entry::Observed { number: place as u64, event: events[place].clone() }).unwrap();
            if asked >> (step % 64) & 1 == 1 && step % 16 == 0 {
                unordered.probability(test_links()[0]).unwrap();
                unordered.refit().unwrap();
            }
        }
        prop_assert_eq!(in_order.snapshot(), unordered.snapshot());
        prop_assert_eq!(out_of_slot(&in_order), out_of_slot(&unordered));
        let again = restored(&unordered, &unordered.snapshot());
        prop_assert_eq!(out_of_slot(&again), out_of_slot(&unordered));
        in_order.rebuild().unwrap();
        unordered.rebuild().unwrap();
        prop_assert_eq!(test_latent(&mut in_order), test_latent(&mut unordered));
        prop_assert_eq!(frames(&mut in_order, 100), frames(&mut unordered, 100));
    }

    /// Exclusion follows from the times of receptions alone. Inverted outcomes of all other members change nothing, and
    /// neither do misses of the member itself.
    #[test]
    fn exclusion_does_not_depend_on_other_outcomes(
        hears in prop::collection::vec(any::<bool>(), SLOTS as usize), from in 0..100u32,
    ) {
        let mut trip = five();
        let of_member = |slot: u32| slot % 5 == 3;
        let late = |sender: usize, slot: u32| i64::from(sender == 3 && slot >= from);
        let mut excluded_slots = [false, true].map(|is_inverted| {
            for slot in 0..SLOTS {
                let heard = hears[slot as usize] ^ (is_inverted && !of_member(slot));
                trip.outcomes[slot as usize] = vec![Some(heard); 5];
            }
            let mut agent = listener(&trip, late);
            let reports = frames(&mut agent, 100);
            let reported = reports.iter().flat_map(|report| reported_outcomes(&agent, report)).map(|(slot, _)| slot);
            let reported: BTreeSet<u32> = reported.collect();
            (0..SLOTS).filter(|&slot| of_member(slot) && !reported.contains(&slot)).collect::<Vec<u32>>()
        });
        let [first, inverted] = &mut excluded_slots;
        prop_assert_eq!(first, inverted);
    }
}
