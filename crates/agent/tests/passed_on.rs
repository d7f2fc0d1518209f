//! What is passed on, and what is not: the reports of those whom others do not hear.

#![allow(clippy::unwrap_used)]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use common::trip::*;
use common::*;
use pingmap_agent::*;
use pingmap_packet::Cell;
use proptest::prelude::*;

const SLOTS: u32 = 240;

/// Three vehicles that lie still and send in turn, each of its messages with a frame.
struct Fleet {
    trip: Trip,
    agents: Vec<Agent>,
    frame_bytes: [usize; 3],
    /// What went over the water: the slot, the number of whose report it is, and its bytes.
    went: Vec<(u32, usize, Vec<u8>)>,
}

impl Fleet {
    /// Those that hear each other as it is said, of sender and receiver in a slot.
    fn new(hears: impl Fn(usize, usize, u32) -> bool) -> Self {
        let cells = [(60, 128), (200, 128), (128, 150)].map(|(east, north)| Cell { east, north, depth: 0 });
        let turns = cells.map(|cell| vec![cell; (SLOTS / LEG) as usize + 2]).to_vec();
        let heard = |slot: u32, receiver| Some(hears(slot as usize % 3, receiver, slot));
        let outcomes = (0..SLOTS).map(|slot| (0..3).map(|receiver| heard(slot, receiver)).collect()).collect();
        let trip = Trip { team: Arc::new(team(3, model())), slots: SLOTS, turns, outcomes };
        let agents = (0..3).map(|number| vehicle(&trip.team, number, []));
        let agents = agents.map(|agent| agent.telling(Telling { points: false, reports: true })).collect();
        Self { trip, agents, frame_bytes: [32; 3], went: Vec::new() }
    }

    /// 0 and 2 hear nothing of each other.
    fn chain() -> Self {
        Self::new(|sender, receiver, _| sender.abs_diff(receiver) == 1)
    }

    fn go_on(&mut self, slots: std::ops::Range<u32>) {
        for slot in slots {
            let (sender, time_s) = (slot as usize % 3, SLOT_S * f64::from(slot));
            let agent = &mut self.agents[sender];
            agent.navigate([(time_s, self.trip.at(sender, slot))]).unwrap();
            let frame = agent.next_packet(time_s, self.frame_bytes[sender]).unwrap();
            if let Some(frame) = &frame {
                assert!(frame.len() <= self.frame_bytes[sender]);
                let (_, report, _) = agent.read_report(frame).unwrap();
                let number = (0..3).find(|&number| self.trip.team.number(&names(3)[number]) == Some(report.sender));
                self.went.push((slot, number.unwrap(), frame.clone()));
            }
            for receiver in 0..3 {
                let Some(event) = self.trip.event(slot, receiver) else { continue };
                if event.success
                    && let Some(frame) = &frame
                {
                    self.agents[receiver].receive(frame, time_s);
                }
                self.agents[receiver].observe(event).unwrap();
            }
        }
    }

    /// The frames that somebody else sent than whose report it is.
    fn passed(&self) -> Vec<(u32, usize, Vec<u8>)> {
        self.went.iter().filter(|(slot, number, _)| *slot as usize % 3 != *number).cloned().collect()
    }

    /// The events of others that a vehicle knows of, placed or not, and all that there are.
    fn known(&self, number: usize) -> (usize, usize, usize) {
        let (told, waiting) = self.agents[number].told_events();
        (told, waiting, (0..3).filter(|&other| other != number).map(|other| self.trip.events(other).len()).sum())
    }
}

#[test]
fn who_does_not_hear_somebody_knows_what_that_one_heard_by_a_third_one() {
    let mut fleet = Fleet::chain();
    fleet.go_on(0..SLOTS);
    for end in [0, 2] {
        let (told, waiting, all) = fleet.known(end);
        assert!(told + waiting <= all && told * 10 >= all * 9, "{end}: {told} and {waiting} of {all}");
    }
    // As they came, and each about once, as soon as it is known that it did not come.
    let passed = fleet.passed();
    for (slot, number, bytes) in &passed {
        assert!(*slot % 3 == 1 && *number != 1);
        assert!(fleet.went.iter().any(|(at, _, own)| at < slot && *at as usize % 3 == *number && own == bytes));
    }
    let different: BTreeSet<&Vec<u8>> = passed.iter().map(|(.., bytes)| bytes).collect();
    assert!(passed.len() <= different.len() * 5 / 4, "{} of {}", passed.len(), different.len());
    // Its own are not forgotten over that.
    let own = fleet.went.len() - passed.len() - fleet.went.iter().filter(|(slot, ..)| slot % 3 != 1).count();
    assert!(own > 10, "{own} of its own, {} of others", passed.len());
}

#[test]
fn nothing_is_passed_on_where_everybody_hears_everybody_or_nobody_says_what_it_missed() {
    let mut fleet = Fleet::new(|_, _, _| true);
    fleet.go_on(0..SLOTS);
    assert_eq!(fleet.passed(), []);
    // 0 is heard by nobody, so that nobody knows what it has.
    let mut fleet = Fleet::new(|sender, _, _| sender != 0);
    fleet.go_on(0..SLOTS);
    assert_eq!(fleet.passed(), []);
}

#[test]
fn nothing_is_passed_on_of_those_who_do_not_count_nor_to_them() {
    for muted in [0, 2] {
        let mut fleet = Fleet::chain();
        fleet.agents[1].mute(&names(3)[muted]);
        fleet.go_on(0..SLOTS);
        assert_eq!(fleet.passed(), [], "{muted}");
    }
}

#[test]
fn what_is_too_long_for_the_frame_is_not_passed_on() {
    let mut fleet = Fleet::chain();
    fleet.trip.team = Arc::new(Team { frame_bytes: 64, ..(*fleet.trip.team).clone() });
    let agents = (0..3).map(|number| vehicle(&fleet.trip.team, number, []));
    fleet.agents = agents.map(|agent| agent.telling(Telling { points: false, reports: true })).collect();
    fleet.frame_bytes = [64, 32, 64];
    fleet.go_on(0..SLOTS);
    assert!(fleet.went.iter().any(|(.., bytes)| bytes.len() > 32));
    assert!(fleet.passed().iter().all(|(.., bytes)| bytes.len() <= 32));
}

#[test]
fn who_lost_its_memory_of_what_went_when_passes_on_what_comes_then() {
    let mut fleet = Fleet::chain();
    fleet.go_on(0..SLOTS / 2);
    let before = fleet.passed().len();
    let reports = Telling { points: false, reports: true };
    fleet.agents[1] = restored(&fleet.agents[1], &fleet.agents[1].snapshot()).telling(reports);
    fleet.go_on(SLOTS / 2..SLOTS);
    let passed = fleet.passed();
    assert!(passed.len() > before);
    // Each once more at the most.
    let mut times: BTreeMap<&Vec<u8>, usize> = BTreeMap::new();
    passed.iter().for_each(|(.., bytes)| *times.entry(bytes).or_default() += 1);
    assert!(times.values().all(|times| *times <= 3), "{:?}", times.values());
}

proptest! {
    #![proptest_config(cases(8))]

    #[test]
    fn whatever_is_heard_what_is_passed_on_is_what_was_sent_and_tells_nothing_twice(seed in any::<u64>()) {
        let hash = |number: u64| {
            let mixed = (number ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40
        };
        // Links of their own, from such that never work to such that always do.
        let works = |sender: usize, receiver: usize| hash((3 * sender + receiver) as u64) % 5;
        let hears = |sender: usize, receiver: usize, slot: u32| {
            hash(u64::from(slot) << 8 | (3 * sender + receiver) as u64) % 4 < works(sender, receiver)
        };
        let mut fleet = Fleet::new(hears);
        fleet.go_on(0..SLOTS);
        for (slot, number, bytes) in fleet.passed() {
            let was_sent = |(at, _, own): &(u32, usize, Vec<u8>)| {
                *at < slot && *at as usize % 3 == number && *own == bytes
            };
            prop_assert!(fleet.went.iter().any(was_sent));
        }
        for number in 0..3 {
            let (told, waiting, all) = fleet.known(number);
            prop_assert!(told + waiting <= all);
        }
    }
}
