//! Piggybacked outcomes: the same events as by reports, each once, in any order and mixture.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::common::trip::*;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::OutcomeBitmap;
use proptest::prelude::*;

/// The piggybacked bits of one message: number of the sender, time, and bits.
type Message = (usize, f64, u64);

const N_BITS: usize = 16;

/// Outcomes in [`N_BITS`] bits.
const OUTCOMES: usize = 10;

/// Three vehicles that do not move.
fn stationary(slots: u32, outcome: impl Fn(u32, usize) -> Option<bool>) -> Trip {
    Trip::stationary(&[(60, 128), (200, 128), (128, 150)], slots, outcome).with_team(|team| team.transmissions_max = 2)
}

/// The bits of the messages of a vehicle in all its slots, as it forms them under way.
fn messages(trip: &Trip, number: usize) -> Vec<Message> {
    let mut agent = Agent::new(name(number), trip.team.clone(), AgentOptions::default());
    let mut messages = Vec::new();
    for slot in 0..trip.slots {
        let time_s = slot_s(slot);
        if trip.sender(slot) == number {
            messages.extend(agent.piggyback(time_s, N_BITS).map(|bits| (number, time_s, bits)));
        }
        agent.record(trip.event(slot, number)).unwrap();
    }
    messages
}

fn receive(agent: &mut Agent, &(number, time_s, bits): &Message) -> Receipt {
    agent.receive_piggyback(&name(number), time_s, bits, N_BITS).receipt
}

/// The outcomes in the bits of one of three vehicles, by slot, the newest first. The message was formed in this slot.
fn outcomes(number: usize, slot: u32, bits: u64) -> Vec<(u32, bool)> {
    let OutcomeBitmap { slot_mod, outcomes } = OutcomeBitmap::decode(bits, N_BITS).unwrap();
    let newest = (0..=slot).rev().find(|slot| slot % OutcomeBitmap::SLOT_MODULUS == u32::from(slot_mod)).unwrap();
    (0..=newest).rev().filter(|slot| *slot as usize % 3 != number).zip(outcomes).collect()
}

/// The outcomes that a vehicle piggybacks in a slot.
fn piggybacked(agent: &Agent, number: usize, slot: u32) -> Option<Vec<(u32, bool)>> {
    Some(outcomes(number, slot, agent.piggyback(slot_s(slot), N_BITS)?))
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn any_mixture_with_reports_in_any_order_gives_the_same_events(
        trip in trips(), order in any::<u64>(), lost in prop::collection::vec(prop::bool::weighted(0.3), 7),
    ) {
        let mut all: Vec<Result<Vec<u8>, Message>> = trip.reports().into_iter().map(Ok).collect();
        all.extend((1..trip.members()).flat_map(|number| messages(&trip, number)).map(Err));
        let all: Vec<_> = all.into_iter().zip(lost.iter().cycle()).filter(|(_, lost)| !**lost).map(|(one, _)| one).collect();
        let receive_one = |agent: &mut Agent, one: &Result<Vec<u8>, Message>| match one {
            Ok(report) => agent.receive(report, None).receipt,
            Err(message) => receive(agent, message),
        };
        let mut one = trip.vehicle(0);
        all.iter().for_each(|message| drop(receive_one(&mut one, message)));
        let mut other = trip.vehicle(0);
        let mut repeated: Vec<_> = all.iter().chain(&all).collect();
        let mut state = order | 1;
        repeated.sort_by_cached_key(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            state
        });
        for (n, message) in repeated.into_iter().enumerate() {
            receive_one(&mut other, message);
            if n == 3 {
                other.probability(test_links()[0]).unwrap();
                other.refit().unwrap();
            }
        }
        prop_assert_eq!(remote_events(&one), remote_events(&other));
        prop_assert_eq!(one.snapshot(), other.snapshot());
        prop_assert_eq!(remote_events(&restored(&one, &one.snapshot())), remote_events(&one));
        prop_assert_eq!(bits(&rebuilt_probabilities(&mut one)), bits(&rebuilt_probabilities(&mut other)));
    }

    #[test]
    fn a_listener_to_all_messages_predicts_as_a_station_with_all_events(
        heard in prop::collection::vec(any::<[bool; 3]>(), 60), is_explicit in any::<bool>(),
    ) {
        let trip = stationary(60, |slot, receiver| Some(heard[slot as usize][receiver])).without_exclusion();
        let trip = if is_explicit { trip.with_explicit_schedule() } else { trip };
        let mut agent = trip.vehicle(0);
        let mut others: Vec<Event> = Vec::new();
        for number in 1..3 {
            let mut slots = BTreeSet::new();
            for message in messages(&trip, number) {
                receive(&mut agent, &message);
                slots.extend(outcomes(number, (message.1 / SLOT_S) as u32, message.2).into_iter().map(|(slot, _)| slot));
            }
            let last = (0..60).rev().find(|&slot| trip.sender(slot) == number).unwrap();
            let expected: BTreeSet<u32> = (0..last).filter(|&slot| trip.sender(slot) != number).collect();
            prop_assert_eq!(&slots, &expected);
            // Vehicle 0 knows the position of vehicle 1 from slot 1 on, and that of vehicle 2 from slot 2 on.
            let located = slots.into_iter().filter(|&slot| slot as usize >= number);
            others.extend(located.filter_map(|slot| trip.event(slot, number)));
        }
        prop_assert_eq!(remote_events(&agent), (others.len(), 3));
        let mut station = station(&trip.team, trip.events(0).into_iter().chain(others));
        let [found, expected] = [&mut agent, &mut station].map(rebuilt_probabilities);
        prop_assert!(largest_difference(&found, &expected) < 1e-9, "{found:?} {expected:?}");
    }
}

#[test]
fn piggybacking_holds_the_newest_consecutive_outcomes() {
    // Vehicle 1 did not listen in slots 40 to 44. It recorded ten outcomes from slot 45 to slot 59.
    let was_heard = |slot: u32| slot.is_multiple_of(2);
    let trip = stationary(60, |slot, receiver| (receiver != 1 || !(40..45).contains(&slot)).then_some(was_heard(slot)));
    let mut agent = trip.vehicle(1);
    let newest: Vec<(u32, bool)> =
        (45..60).rev().filter(|slot| slot % 3 != 1).map(|slot| (slot, was_heard(slot))).collect();
    assert_eq!(newest.len(), OUTCOMES);
    // The newest outcome is at most 47 slots old.
    for slot in (61..=106).step_by(3) {
        assert_eq!(piggybacked(&agent, 1, slot).as_ref(), Some(&newest), "{slot}");
        assert_eq!(piggybacked(&agent, 1, slot).as_ref(), Some(&newest), "a second call in slot {slot}");
    }
    assert_eq!(agent.piggyback(slot_s(107), N_BITS), None);
    // A gap in slot 51 leaves the outcomes from slot 39 on.
    let mut deaf = trip.clone();
    deaf.outcomes[51][1] = None;
    let expected: Vec<u32> = (0..40).rev().filter(|slot| slot % 3 != 1).take(OUTCOMES).collect();
    let found = piggybacked(&deaf.vehicle(1), 1, 61).unwrap();
    assert_eq!(found.iter().map(|(slot, _)| *slot).collect::<Vec<_>>(), expected);
    agent.refit().unwrap();
}

#[test]
fn more_bits_hold_more_outcomes() {
    let trip = stationary(120, |slot, receiver| Some(!(slot as usize + receiver).is_multiple_of(3)));
    let agent = trip.vehicle(1);
    let newest: Vec<u32> = (0..119).rev().filter(|slot| slot % 3 != 1).collect();
    for n_bits in [7, 8, 16, 32, 64] {
        let bits = agent.piggyback(slot_s(118), n_bits).unwrap();
        let bitmap = OutcomeBitmap::decode(bits, n_bits).unwrap();
        let newest: Vec<u32> = newest.iter().copied().filter(|&slot| slot < 119).collect();
        assert_eq!(bitmap.outcomes.len(), n_bits - 6);
        for (slot, heard) in newest.into_iter().zip(bitmap.outcomes) {
            assert_eq!(Some(heard), trip.outcomes[slot as usize][1], "{slot} in {n_bits} bits");
        }
    }
}

#[test]
fn near_the_first_slot_messages_hold_fewer_outcomes() {
    let trip = stationary(12, |_, _| Some(true));
    for (number, time_s, bits) in messages(&trip, 1) {
        let mut listener = trip.vehicle(0);
        let slot = (time_s / SLOT_S) as u32;
        assert_eq!(receive(&mut listener, &(number, time_s, bits)), Receipt::Accepted);
        let (located, unlocated) = remote_events(&listener);
        let expected = (0..slot).filter(|slot| slot % 3 != 1).count().min(OUTCOMES);
        assert_eq!(located + unlocated, expected, "{slot}");
    }
}

#[test]
fn a_delayed_message_describes_the_same_slots() {
    let trip = stationary(200, |slot, receiver| Some(!(slot as usize * 7 + receiver).is_multiple_of(3)));
    let snapshot = |(number, time_s, bits): Message, delay: u32| {
        let mut listener = trip.vehicle(0);
        receive(&mut listener, &(number, time_s + slot_s(delay), bits));
        // Snapshots hold the clock: it is the same in all of them.
        listener.record_positions([(slot_s(400), Position::new(0.0, 0.0))]).unwrap();
        listener.snapshot()
    };
    for message in (1..3).flat_map(|number| messages(&trip, number)) {
        let at_once = snapshot(message, 0);
        assert!([1, 2, 3, 29, 60].into_iter().all(|delay| snapshot(message, delay) == at_once), "{message:?}");
    }
    // A message with outcomes of the largest age may wait for 16 slots.
    let agent = trip.vehicle(1);
    let message = |slot| (1, slot_s(slot), agent.piggyback(slot_s(slot), N_BITS).unwrap());
    let oldest = message(198 + 47);
    let at_once = snapshot(oldest, 0);
    assert!((0..=16).all(|delay| snapshot(oldest, delay) == at_once));
    assert_eq!(agent.piggyback(slot_s(200 + 47), N_BITS), None);
}

#[test]
fn a_clock_that_is_slightly_behind_reads_the_same_slots() {
    // Every transmission takes two slots. Vehicle 1 begins in slots 0, 4, 8, …
    let order = [name(1), VehicleId::new(""), name(0), VehicleId::new("")].to_vec();
    let team = Arc::new(Team { slots: Slots::cycle(SLOT_S, order), ..team(2, model()) });
    let mut agent = vehicle(&team, 1, []);
    let link = link([0.0, 0.0, 300.0, 0.0]);
    for slot in (2..120).step_by(4) {
        let event = event_at(1, slot_s(slot), link, slot % 3 == 0);
        agent.record([Event { transmitter_id: name(0), ..event }]).unwrap();
    }
    for slot in (48..120).step_by(4) {
        let bits = agent.piggyback(slot_s(slot), N_BITS).unwrap();
        let after = |time_s: f64| {
            let mut listener = vehicle(&team, 0, []);
            receive(&mut listener, &(1, time_s, bits));
            listener.record_positions([(slot_s(120), Position::new(0.0, 0.0))]).unwrap();
            listener.snapshot()
        };
        assert_eq!(after(slot_s(slot) - 1e-3), after(slot_s(slot)), "{slot}");
    }
}

#[test]
fn four_lost_messages_in_a_row_lose_no_outcome() {
    // Every message holds ten outcomes, and two new ones come before the next message.
    let trip = stationary(120, |slot, _| Some(slot % 5 < 3));
    let all = messages(&trip, 1);
    let slots = |messages: &[Message]| -> BTreeSet<u32> {
        let slots = |&(number, time_s, bits): &Message| outcomes(number, (time_s / SLOT_S) as u32, bits);
        messages.iter().flat_map(slots).map(|(slot, _)| slot).collect()
    };
    let [first, last] = [1, all.len() - 6];
    for lost in first..=last {
        assert_eq!(slots(&[&all[..lost], &all[lost + 4..]].concat()), slots(&all), "{lost}");
    }
    assert_ne!(slots(&[&all[..9], &all[14..]].concat()), slots(&all), "five are too many");
}

#[test]
fn a_report_replaces_piggybacked_outcomes_and_contradictions_count_as_neither() {
    let trip = stationary(24, |_, _| Some(true));
    let message = messages(&trip, 1).pop().unwrap();
    let wrong = (1, message.1, message.2 ^ (0x3ff << 6));
    let [mut right, mut both, mut contradictory] = [0, 0, 0].map(|number| trip.vehicle(number));
    let reports: Vec<Vec<u8>> = (1..3).flat_map(|number| trip.reports_of(number)).collect();
    receive_all(&mut right, &reports);
    receive_all(&mut both, &reports);
    receive(&mut both, &wrong);
    assert_eq!(remote_events(&both), remote_events(&right));
    assert_eq!(bits(&rebuilt_probabilities(&mut right)), bits(&rebuilt_probabilities(&mut both)));
    receive(&mut contradictory, &message);
    assert_eq!(remote_events(&contradictory), (OUTCOMES, 0));
    receive(&mut contradictory, &wrong);
    assert_eq!(remote_events(&contradictory), (0, 0));
    let again = restored(&contradictory, &contradictory.snapshot());
    assert_eq!(again.snapshot(), contradictory.snapshot());
    assert_eq!(remote_events(&again), (0, 0));
}

#[test]
fn a_vehicle_that_sends_no_reports_does_not_piggyback() {
    let trip = stationary(60, |_, _| Some(true));
    let mut agent = trip.vehicle(1);
    assert!(agent.piggyback(slot_s(61), N_BITS).is_some());
    agent.options = summaries_alone();
    assert_eq!(agent.piggyback(slot_s(61), N_BITS), None);
    let station = trip.station();
    assert_eq!(station.piggyback(slot_s(61), N_BITS), None, "it is no member");
}

#[test]
fn piggybacking_needs_a_plain_team_or_an_explicit_permission() {
    let trip = stationary(30, |_, _| Some(true));
    let message = messages(&trip, 1).pop().unwrap();
    let with_key = Team { key: Some(key(1)), ..(*trip.team).clone() };
    let allowed = Team { piggyback: Some(true), ..with_key.clone() };
    let forbidden = Team { piggyback: Some(false), ..(*trip.team).clone() };
    for (team, is_on) in [(with_key, false), (allowed, true), (forbidden, false)] {
        let trip = Trip { team: Arc::new(team), ..trip.clone() };
        let mut agent = trip.vehicle(0);
        assert_eq!((trip.team.has_piggyback(), agent.piggyback(300.0, N_BITS).is_some()), (is_on, is_on));
        let expected = if is_on { Receipt::Accepted } else { Receipt::Refused(Refusal::PiggybackDisabled) };
        assert_eq!(receive(&mut agent, &message), expected);
    }
}

#[test]
fn malformed_piggybacked_bits_are_refused_and_change_nothing() {
    let trip = stationary(30, |_, _| Some(true));
    let message = messages(&trip, 1).pop().unwrap();
    let (_, time_s, bits) = message;
    let mut agent = trip.vehicle(0);
    let before = agent.snapshot();
    let stranger = VehicleId::new("a ship");
    let cases = [
        (stranger.clone(), time_s, Refusal::NoMember(stranger)),
        (name(0), time_s, Refusal::OwnReport),
        (name(1), -5.0, Refusal::NoSlot { time_s: -5.0 }),
    ];
    for (id, time_s, refusal) in cases {
        assert_eq!(agent.receive_piggyback(&id, time_s, bits, 16).receipt, Receipt::Refused(refusal));
    }
    for (bits, n_bits) in [(bits, 6), (bits, 65), (1 << 16, 16)] {
        let receipt = agent.receive_piggyback(&name(1), time_s, bits, n_bits).receipt;
        assert!(matches!(receipt, Receipt::Refused(Refusal::Malformed(_))), "{receipt:?}");
    }
    assert_eq!((agent.piggyback(300.0, 6), agent.piggyback(f64::NAN, 16)), (None, None));
    assert_eq!((remote_events(&agent), agent.snapshot()), ((0, 0), before));
    assert_eq!(receive(&mut agent, &message), Receipt::Accepted);
    assert_eq!(receive(&mut agent, &message), Receipt::Refused(Refusal::Duplicate));
}
