//! What rides along in spare bits: the same events as by reports, once, in whatever order and company they come.

#![allow(clippy::unwrap_used)]

mod common;

use std::collections::BTreeSet;
use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use pingmap_packet::{Cell, Recent};
use proptest::prelude::*;

/// A message of a host's: who sent it, when, and its spare bits.
type Spare = (usize, f64, u64);

const N_BITS: usize = 16;

/// Three vehicles that lie in the middle of their cells and listen always.
fn still(slots: u32, heard: impl Fn(u32, usize) -> Option<bool>) -> Trip {
    let turns = [(60, 128), (200, 128), (128, 150)].map(|(east, north)| Cell { east, north, depth: 0 });
    let turns = turns.map(|cell| vec![cell; (slots / LEG) as usize + 2]).to_vec();
    let outcomes = (0..slots).map(|slot| (0..3).map(|receiver| heard(slot, receiver)).collect()).collect();
    let team = Team { track_off_max_m: 1e-6, tellings_max: 2, ..team(3, model()) };
    Trip { team: Arc::new(team), slots, turns, outcomes }
}

/// The bits of a vehicle's messages in all its slots, as it forms them under way.
fn messages(trip: &Trip, number: usize) -> Vec<Spare> {
    let mut agent = Agent::new(names(number + 1).remove(number), trip.team.clone());
    let mut messages = Vec::new();
    for slot in 0..trip.slots {
        let time_s = SLOT_S * f64::from(slot);
        if slot as usize % trip.members() == number {
            messages.extend(agent.recent(time_s, N_BITS).map(|bits| (number, time_s, bits)));
        }
        agent.observe_all(trip.event(slot, number)).unwrap();
    }
    messages
}

fn read(agent: &mut Agent, &(number, time_s, bits): &Spare) -> Receipt {
    agent.receive_recent(&names(number + 1)[number], time_s, bits, N_BITS)
}

proptest! {
    #![proptest_config(cases(16))]

    #[test]
    fn any_mixture_with_reports_in_any_order_tells_the_same_events(
        trip in trips(),
        order in any::<u64>(),
        lost in vec_of_lost(),
    ) {
        let spare: Vec<Spare> = (1..trip.members()).flat_map(|number| messages(&trip, number)).collect();
        let mut said: Vec<Result<Vec<u8>, Spare>> = trip.reports().into_iter().map(Ok).collect();
        said.extend(spare.into_iter().map(Err));
        let said: Vec<_> = said.into_iter().zip(lost.iter().cycle()).filter(|(_, lost)| !**lost).map(|(said, _)| said).collect();
        let hear = |agent: &mut Agent, one: &Result<Vec<u8>, Spare>| match one {
            Ok(report) => agent.receive(report, 0.0),
            Err(spare) => read(agent, spare),
        };
        let mut one = trip.vehicle(0);
        said.iter().for_each(|said| drop(hear(&mut one, said)));
        let mut other = trip.vehicle(0);
        let mut again: Vec<_> = said.iter().chain(&said).collect();
        let mut state = order | 1;
        again.sort_by_cached_key(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            state
        });
        for (n, said) in again.into_iter().enumerate() {
            hear(&mut other, said);
            if n == 3 {
                other.probability(somewhere()[0]).unwrap();
                other.refit().unwrap();
            }
        }
        prop_assert_eq!(one.told_events(), other.told_events());
        prop_assert_eq!(one.snapshot(), other.snapshot());
        let restored = restored(&one, &one.snapshot());
        prop_assert_eq!(restored.told_events(), one.told_events());
        one.rebuild_posteriors().unwrap();
        other.rebuild_posteriors().unwrap();
        let mean = |agent: &mut Agent| bits(&agent.probabilities(somewhere()).unwrap());
        prop_assert_eq!(mean(&mut one), mean(&mut other));
    }

    #[test]
    fn who_hears_every_message_knows_what_everything_in_one_place_says(
        outcomes in prop::collection::vec(any::<[bool; 3]>(), 60),
    ) {
        let trip = still(60, |slot, receiver| Some(outcomes[slot as usize][receiver]));
        let mut agent = trip.vehicle(0);
        for spare in (1..3).flat_map(|number| messages(&trip, number)) {
            read(&mut agent, &spare);
        }
        // What it said, and nothing else: of late it may have told something else first. Before vehicle 1 sent in slot 1 and vehicle 2
        // in slot 2 nobody knows where they were.
        let mut others: Vec<Event> = Vec::new();
        for number in 1..3 {
            let spoken = messages(&trip, number);
            let spoken = spoken.iter().flat_map(|&(_, time_s, bits)| spoken_of(number, (time_s / SLOT_S) as u32, bits));
            let told: BTreeSet<u32> = spoken.map(|(slot, _)| slot).collect();
            let could_hear = |slot: &u32| *slot as usize % 3 != number;
            prop_assert!((0..30).filter(could_hear).all(|slot| told.contains(&slot)), "{number}: {told:?}");
            let with_place = told.into_iter().filter(|&slot| slot as usize >= number);
            others.extend(with_place.filter_map(|slot| trip.event(slot, number)));
        }
        prop_assert_eq!(agent.told_events(), (others.len(), 3));
        agent.rebuild_posteriors().unwrap();
        let mut all = Agent::new(VehicleId::new("shore"), trip.team.clone()).owning_all_events();
        all.observe_all(trip.events(0).into_iter().chain(others)).unwrap();
        all.rebuild_posteriors().unwrap();
        let [one, all] = [&mut agent, &mut all].map(|agent| agent.probabilities(somewhere()).unwrap());
        prop_assert!(largest_difference(&one, &all) < 1e-9, "{one:?} {all:?}");
    }
}

fn vec_of_lost() -> impl Strategy<Value = Vec<bool>> {
    prop::collection::vec(prop::bool::weighted(0.3), 7)
}

/// What a vehicle says in its spare bits in a slot: of which slots, and whether it heard what was sent in them, the newest first.
fn said(agent: &mut Agent, number: usize, slot: u32) -> Option<Vec<(u32, bool)>> {
    let bits = agent.recent(SLOT_S * f64::from(slot), N_BITS)?;
    assert_eq!(agent.recent(SLOT_S * f64::from(slot), N_BITS), Some(bits), "asked again in slot {slot}");
    Some(spoken_of(number, slot, bits))
}

/// What such bits of one of three vehicles mean in a slot.
fn spoken_of(number: usize, slot: u32, bits: u64) -> Vec<(u32, bool)> {
    let Recent { newest, outcomes } = Recent::decode(bits, N_BITS).unwrap();
    let number_of = |slot: &u32| (slot / Recent::SLOTS_PER_NUMBER) % Recent::NUMBERS == u32::from(newest);
    let newest = (0..=slot).rev().find(number_of).unwrap() / Recent::SLOTS_PER_NUMBER;
    let slots = (0..=Recent::last_slot(newest)).rev().filter(|slot| *slot as usize % 3 != number);
    slots.zip(outcomes).collect()
}

/// What spare bits say that speak of ten slots back from this one.
fn about(number: usize, newest: u32, is_heard: impl Fn(u32) -> bool) -> u64 {
    let number_of = (newest / Recent::SLOTS_PER_NUMBER) % Recent::NUMBERS;
    let slots = (0..=newest).rev().filter(|slot| *slot as usize % 3 != number);
    Recent { newest: number_of as u8, outcomes: slots.take(10).map(is_heard).collect() }.encode()
}

#[test]
fn what_was_not_listened_to_is_never_told() {
    // Vehicle 1 slept through slots 40 to 44, of which it could hear 41, 42 and 44.
    let was_heard = |slot: u32| slot.is_multiple_of(2);
    let trip = still(60, |slot, receiver| (receiver != 1 || !(40..45).contains(&slot)).then_some(was_heard(slot)));
    let mut agent = trip.vehicle(1);
    let mut told = BTreeSet::new();
    for slot in (61..153).step_by(3) {
        let said = said(&mut agent, 1, slot).unwrap();
        assert!(said.len() == 10 || said.last().unwrap().0 == 0, "nothing was before slot 0: {said:?}");
        for (about, heard) in said {
            assert!(!(40..45).contains(&about) && about < 60, "{about}");
            assert_eq!(heard, was_heard(about), "{about}");
            told.insert(about);
        }
    }
    // All that there is but for what is in no run of ten, from 45 to 59 and up to 39.
    let first = told.first().copied().unwrap();
    assert_eq!(told.len(), trip.events(1).iter().filter(|event| event.time_s >= SLOT_S * f64::from(first)).count());
    assert!(first <= 3, "{first}");
    // Slots 58 and 59 have number 29: 47 numbers later it says nothing of them any more.
    assert_eq!(agent.recent(SLOT_S * 154.0, N_BITS), None);
    agent.refit().unwrap();
}

#[test]
fn a_message_that_waits_speaks_of_the_same_slots() {
    let trip = still(200, |slot, receiver| Some(!(slot as usize * 7 + receiver).is_multiple_of(3)));
    for (number, time_s, bits) in (1..3).flat_map(|number| messages(&trip, number)) {
        let after = |slots: u32| {
            let mut listener = trip.vehicle(0);
            read(&mut listener, &(number, time_s + SLOT_S * f64::from(slots), bits));
            listener.snapshot()
        };
        let at_once = after(0);
        assert!([1, 2, 3, 29, 30].into_iter().all(|slots| after(slots) == at_once), "{number} {time_s}");
    }
}

#[test]
fn a_clock_that_is_a_moment_behind_reads_the_same() {
    // Turns of two slots each: vehicle 1 begins in even ones, behind which nobody else does.
    let order = [&names(2)[1], &VehicleId::new(""), &names(2)[0], &VehicleId::new("")].map(VehicleId::clone).to_vec();
    let team = Arc::new(Team { slots: Slots::in_turn(SLOT_S, order), ..team(2, model()) });
    let mut agent = vehicle(&team, 1, []);
    let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(300.0, 0.0) };
    for slot in (2..120).step_by(4) {
        let event = event_at(1, SLOT_S * f64::from(slot), link, slot % 3 == 0);
        agent.observe(Event { transmitter_id: names(1).remove(0), ..event }).unwrap();
    }
    for slot in (48..120).step_by(4) {
        let time_s = SLOT_S * f64::from(slot);
        let bits = agent.recent(time_s, N_BITS).unwrap();
        let after = |time_s: f64| {
            let mut listener = vehicle(&team, 0, []);
            read(&mut listener, &(1, time_s, bits));
            listener.snapshot()
        };
        assert_eq!(after(time_s - 1e-3), after(time_s), "{slot}");
    }
}

#[test]
fn what_was_lost_is_told_again_when_others_hear_again() {
    // Nobody hears anybody for longer than ten outcomes reach back.
    let heard = |slot: u32| !(20..80).contains(&slot);
    let trip = still(120, |slot, _| Some(heard(slot)));
    let mut agents: Vec<Agent> = (0..3).map(|number| Agent::new(names(3).remove(number), trip.team.clone())).collect();
    for slot in 0..trip.slots {
        let (sender, time_s) = (slot as usize % 3, SLOT_S * f64::from(slot));
        let bits = agents[sender].recent(time_s, N_BITS);
        for receiver in (0..3).filter(|&receiver| receiver != sender) {
            agents[receiver].observe_all(trip.event(slot, receiver)).unwrap();
            if let Some(bits) = bits.filter(|_| heard(slot)) {
                read(&mut agents[receiver], &(sender, time_s, bits));
            }
        }
    }
    for (number, agent) in agents.iter().enumerate() {
        let (told, waiting) = agent.told_events();
        let all: usize = (0..3).filter(|&other| other != number).map(|other| trip.events(other).len()).sum();
        // What they heard last they have not said. Ten outcomes of each would leave sixty untold.
        assert!((all - 8..=all).contains(&(told + waiting)), "{number}: {told} and {waiting} of {all}");
    }
}

#[test]
fn what_nobody_says_that_it_heard_is_told_first() {
    let trip = still(60, |_, _| Some(true));
    let slots = [61, 64, 67, 70];
    for lost in slots {
        let mut agent = trip.vehicle(1);
        let mut windows = Vec::new();
        for slot in slots {
            windows.push(said(&mut agent, 1, slot).unwrap());
            for other in [0, 2] {
                let bits = about(other, slot + 1, |slot| slot != lost);
                agent.receive_recent(&names(other + 1)[other], SLOT_S * f64::from(slot + 2), bits, N_BITS);
            }
        }
        // Each of them says what none before it did. One slot is between two of them, because two have one number.
        let all: BTreeSet<u32> = windows.iter().flatten().map(|&(slot, _)| slot).collect();
        assert!(all.len() >= 38, "{windows:?}");
        let place = slots.iter().position(|slot| *slot == lost).unwrap();
        let again = said(&mut agent, 1, 73).unwrap();
        let of_lost = again.iter().filter(|said| windows[place].contains(said)).count();
        assert!(of_lost >= 8, "{lost}: {again:?} {windows:?}");
    }
}

#[test]
fn a_report_counts_before_spare_bits_and_contradictions_count_as_neither() {
    let trip = still(24, |_, _| Some(true));
    let spare = messages(&trip, 1).pop().unwrap();
    let wrong = (1, spare.1, spare.2 ^ (0x3ff << 6));
    let reports = sent(&mut trip.vehicle(1), 20);
    let [mut right, mut both, mut doubtful] = [0, 0, 0].map(|number| trip.vehicle(number));
    for report in reports.iter().chain(&sent(&mut trip.vehicle(2), 20)) {
        right.receive(report, 0.0);
        both.receive(report, 0.0);
    }
    read(&mut both, &wrong);
    assert_eq!(both.told_events(), right.told_events());
    let [one, other] = [&mut right, &mut both].map(|agent| {
        agent.rebuild_posteriors().unwrap();
        bits(&agent.probabilities(somewhere()).unwrap())
    });
    assert_eq!(one, other);
    read(&mut doubtful, &spare);
    assert_eq!(doubtful.told_events(), (10, 0));
    read(&mut doubtful, &wrong);
    assert_eq!(doubtful.told_events(), (0, 0));
    assert_eq!(restored(&doubtful, &doubtful.snapshot()).snapshot(), doubtful.snapshot());
}

#[test]
fn map_messages_of_the_same_events_count_for_what_they_say_beyond() {
    let trip = still(120, |slot, _| Some(slot % 4 != 0));
    let points = Telling { points: true, reports: false };
    let packets = sent(&mut trip.vehicle(1).telling(points), 6);
    assert!(!packets.is_empty());
    let mut listener = trip.vehicle(0);
    messages(&trip, 1).iter().for_each(|spare| drop(read(&mut listener, spare)));
    listener.rebuild_posteriors().unwrap();
    let by_bits = variances(&mut listener, &somewhere());
    packets.iter().for_each(|packet| drop(listener.receive(packet, 0.0)));
    let both = variances(&mut listener, &somewhere());
    // All that is known was told by bits: the packets add next to nothing, where alone they say much.
    let mut alone = trip.vehicle(0);
    let before = variances(&mut alone, &somewhere());
    packets.iter().for_each(|packet| drop(alone.receive(packet, 0.0)));
    let after = variances(&mut alone, &somewhere());
    let gain = |before: &[f64], after: &[f64]| before.iter().zip(after).map(|(a, b)| a - b).sum::<f64>();
    let (second, first) = (gain(&by_bits, &both), gain(&before, &after));
    assert!(first > 0.1 && second < 0.1 * first, "{second} {first}");
}

#[test]
fn spare_bits_are_for_teams_without_a_key_and_for_members() {
    let trip = still(30, |_, _| Some(true));
    let spare = messages(&trip, 1).pop().unwrap();
    let sealed = Team { key: Some(key(1)), ..(*trip.team).clone() };
    let willing = Team { spare_bits: Some(true), ..sealed.clone() };
    let wary = Team { spare_bits: Some(false), ..(*trip.team).clone() };
    for (team, takes) in [(sealed, false), (willing, true), (wary, false)] {
        let trip = Trip { team: Arc::new(team), ..trip.clone() };
        let mut agent = trip.vehicle(0);
        assert_eq!(agent.recent(300.0, N_BITS).is_some(), takes);
        let receipt = read(&mut agent, &spare);
        let expected = if takes { Receipt::Accepted } else { Receipt::Refused(Refusal::SpareBits) };
        assert_eq!(receipt, expected);
    }
    let mut agent = trip.vehicle(0);
    let refused = |receipt: Receipt| match receipt {
        Receipt::Refused(refusal) => refusal,
        Receipt::Accepted => panic!("accepted"),
    };
    let (time_s, bits) = (spare.1, spare.2);
    let stranger = VehicleId::new("a ship");
    assert_eq!(refused(agent.receive_recent(&stranger, time_s, bits, 16)), Refusal::NoMember { id: stranger });
    assert_eq!(refused(agent.receive_recent(&names(1)[0], time_s, bits, 16)), Refusal::OwnReport);
    assert_eq!(refused(agent.receive_recent(&names(2)[1], -5.0, bits, 16)), Refusal::NoSlot { time_s: -5.0 });
    for (bits, n_bits) in [(bits, 6), (bits, 65), (1 << 16, 16)] {
        assert!(matches!(refused(agent.receive_recent(&names(2)[1], time_s, bits, n_bits)), Refusal::Malformed(_)));
    }
    assert_eq!(agent.recent(300.0, 6), None);
    assert_eq!(agent.recent(f64::NAN, 16), None);
    assert_eq!(agent.told_events(), (0, 0));
    assert_eq!(read(&mut agent, &spare), Receipt::Accepted);
    assert_eq!(refused(read(&mut agent, &spare)), Refusal::Duplicate);
}
