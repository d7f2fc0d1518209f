//! What is told again, and what is not: who reports what it heard says which frames it has.

#![allow(clippy::unwrap_used)]

mod common;

use std::ops::Range;
use std::sync::Arc;

use common::trip::SLOT_S;
use common::*;
use pingmap_agent::*;

/// Slots of a part of a mission: what is heard in them fits into one frame, what is heard in two of them does not.
const PART: u32 = 160;

/// What a vehicle hears of those who send in turn, itself among them.
struct Turns {
    team: Arc<Team>,
}

impl Turns {
    fn new(members: usize) -> Self {
        Self { team: Arc::new(team(members, model())) }
    }

    fn telling_once() -> Self {
        Self { team: Arc::new(Team { tellings_max: 1, ..team(2, model()) }) }
    }

    fn time_s(slot: u32) -> f64 {
        SLOT_S * f64::from(slot)
    }

    /// Where a vehicle lies: in the middle of a cell.
    fn place(&self, number: usize) -> Position {
        let at = Position::new(200.0 * number as f64, 0.0);
        let cell = self.team.grid.knot_cell(&self.team.model.chart, &at).unwrap();
        self.team.grid.knot_position(&self.team.model.chart, cell, false)
    }

    /// A vehicle after these slots, of which it listened to those of the others.
    fn vehicle(&self, number: usize, slots: Range<u32>, is_heard: impl Fn(u32) -> bool) -> Agent {
        let mut agent = vehicle(&self.team, number, []).telling(Telling { points: false, reports: true });
        self.go_on(&mut agent, number, slots, is_heard);
        agent
    }

    fn go_on(&self, agent: &mut Agent, number: usize, slots: Range<u32>, is_heard: impl Fn(u32) -> bool) {
        agent.navigate(slots.clone().map(|slot| (Self::time_s(slot), self.place(number)))).unwrap();
        for slot in slots {
            let sender = slot as usize % self.team.members.len();
            if sender != number {
                let link = Link { transmitter: self.place(sender), receiver: self.place(number) };
                let event = event_at(number, Self::time_s(slot), link, is_heard(slot));
                let transmitter_id = names(sender + 1).remove(sender);
                agent.observe(Event { transmitter_id, ..event }).unwrap();
            }
        }
    }

    /// The first slot and the last one that the next report tells.
    fn next_told(&self, agent: &mut Agent, slot: u32) -> [u32; 2] {
        let frame = agent.next_packet(Self::time_s(slot), 32).unwrap().unwrap();
        let (_, report, _) = agent.read_report(&frame).unwrap();
        let id = agent.id().clone();
        let told = (report.first..).filter(|&slot| self.team.slots.is_heard_by(slot, &id));
        [report.first, told.take(report.outcomes.len()).last().unwrap()]
    }
}

#[test]
fn what_another_one_says_it_missed_is_told_again() {
    for (lost, part) in [(PART, 0..PART), (2 * PART, PART..2 * PART)] {
        let turns = Turns::new(2);
        let mut agent = turns.vehicle(0, 0..PART, |_| true);
        let [first, last] = turns.next_told(&mut agent, PART);
        assert!(first <= 1 && last == PART - 1, "{first} to {last}");
        turns.go_on(&mut agent, 0, PART..2 * PART, |_| true);
        let [first, last] = turns.next_told(&mut agent, 2 * PART);
        assert!(first > 1 && last == 2 * PART - 1, "{first} to {last}");
        let mut other = turns.vehicle(1, 0..2 * PART + 8, |slot| slot != lost);
        sent(&mut other, 8).iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
        let mut again = restored(&agent, &agent.snapshot()).telling(Telling { points: false, reports: true });
        let [first, last] = turns.next_told(&mut agent, 2 * PART + 2);
        assert!(first <= part.start + 1 && last >= part.end - 1, "{first} to {last}, lost in {lost}");
        assert_eq!(turns.next_told(&mut again, 2 * PART + 2), [first, last]);
    }
}

#[test]
fn who_has_told_everything_tells_again_what_others_say_they_missed() {
    for is_heard in [true, false] {
        let turns = Turns::telling_once();
        let mut agent = turns.vehicle(0, 0..PART, |_| true);
        turns.next_told(&mut agent, PART);
        assert_eq!(agent.next_packet(Turns::time_s(PART + 2), 32).unwrap(), None);
        let mut other = turns.vehicle(1, 0..PART + 8, |slot| is_heard || slot != PART);
        sent(&mut other, 8).iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
        let again = agent.next_packet(Turns::time_s(PART + 4), 32).unwrap();
        assert_eq!(again.is_some(), !is_heard);
        // Not forever, though.
        let more = (0..40).map_while(|_| agent.next_packet(f64::INFINITY, 32).unwrap()).count();
        assert!(more < 20, "{more}");
    }
}

#[test]
fn who_is_muted_says_nothing_of_what_it_has() {
    let turns = Turns::telling_once();
    let mut agent = turns.vehicle(0, 0..PART, |_| true);
    turns.next_told(&mut agent, PART);
    let mut other = turns.vehicle(1, 0..PART + 8, |slot| slot != PART);
    sent(&mut other, 8).iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
    agent.mute(&names(2)[1]);
    assert_eq!(agent.next_packet(Turns::time_s(PART + 2), 32).unwrap(), None);
}

#[test]
fn a_frame_of_a_slot_that_is_not_its_own_went_in_none() {
    let turns = Turns::new(2);
    let frame = turns.vehicle(0, 0..PART, |_| true).next_packet(Turns::time_s(PART), 32).unwrap().unwrap();
    let after = |slot: Option<u32>| {
        let mut agent = turns.vehicle(0, 0..PART, |_| true);
        agent.apply(Entry::Sent { number: 0, slot, bytes: frame.clone() }).unwrap();
        let mut other = turns.vehicle(1, 0..PART + 8, |_| true);
        sent(&mut other, 8).iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
        agent.next_packet(Turns::time_s(PART), 32).unwrap();
        agent.snapshot()
    };
    let nowhere = after(None);
    assert!([1, 1 << 18, u32::MAX - 1, u32::MAX].iter().all(|&slot| after(Some(slot)) == nowhere));
    assert_ne!(after(Some(PART)), nowhere);
    // Of two words the one that says something holds, whichever came first.
    let twice = |slots: [Option<u32>; 2]| {
        let mut agent = turns.vehicle(0, 0..PART, |_| true);
        slots.into_iter().for_each(|slot| {
            agent.apply(Entry::Sent { number: 0, slot, bytes: frame.clone() }).unwrap();
        });
        agent.snapshot()
    };
    assert_eq!(twice([None, Some(PART)]), twice([Some(PART), Some(PART)]));
    assert_eq!(twice([None, Some(PART)]), twice([Some(PART), None]));
}

#[test]
fn what_went_when_the_other_one_was_not_heard_was_probably_lost() {
    for is_heard in [true, false] {
        let turns = Turns::new(2);
        let mut agent = turns.vehicle(0, 0..PART, |slot| is_heard || slot < PART - 20);
        turns.next_told(&mut agent, PART);
        turns.go_on(&mut agent, 0, PART..2 * PART, |slot| is_heard || slot > PART + 20);
        let [first, last] = turns.next_told(&mut agent, 2 * PART);
        let is_anew = first <= 1 || last < 2 * PART - 1;
        assert_eq!(is_anew, !is_heard, "{first} to {last}");
    }
}

#[test]
fn who_is_never_in_reach_does_not_keep_others_from_news() {
    let turns = Turns::new(3);
    // The third one is never heard, and it says by way of others that it hears nothing.
    let is_heard = |slot: u32| slot % 3 != 2;
    let mut agent = turns.vehicle(0, 0..PART, is_heard);
    turns.next_told(&mut agent, PART);
    for (number, hears) in [(1, true), (2, false)] {
        let mut other = turns.vehicle(number, 0..PART + 8, |_| hears);
        sent(&mut other, 8).iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
    }
    turns.go_on(&mut agent, 0, PART..PART + 30, is_heard);
    let [_, last] = turns.next_told(&mut agent, PART + 30);
    assert_eq!(last, PART + 28);
}

#[test]
fn a_slot_in_which_it_was_silent_is_not_told_before_it_says_so() {
    // Slots of its own cost a bit each where it may be silent.
    for (may_be_silent, part) in [(false, PART), (true, PART / 2)] {
        let mut turns = Turns::telling_once();
        if may_be_silent {
            let slots = Slots { may_be_silent: names(1).into_iter().collect(), ..turns.team.slots.clone() };
            turns.team = Arc::new(Team { slots, ..(*turns.team).clone() });
        }
        let mut agent = turns.vehicle(0, 0..part, |_| true);
        turns.next_told(&mut agent, part);
        assert_eq!(agent.next_packet(Turns::time_s(part + 2), 32).unwrap(), None);
        // Its host finds out late, also of the last slot that the report reached.
        for slot in [part / 2, part - 2] {
            agent.stay_silent([Turns::time_s(slot)]).unwrap();
            let frame = agent.next_packet(Turns::time_s(part + 4), 32).unwrap().unwrap();
            let (_, report, _) = agent.read_report(&frame).unwrap();
            assert_eq!((report.first, report.tells_own), (slot, true));
            assert_eq!(report.outcomes, [pingmap_packet::Outcome::Missed]);
            assert_eq!(agent.next_packet(Turns::time_s(part + 6), 32).unwrap(), None);
        }
    }
}

#[test]
fn a_frame_of_a_slot_in_which_it_was_silent_never_left() {
    let turns = Turns::telling_once();
    let mut agent = turns.vehicle(0, 0..PART, |_| true);
    turns.next_told(&mut agent, PART);
    assert_eq!(agent.next_packet(Turns::time_s(PART + 2), 32).unwrap(), None);
    agent.stay_silent([Turns::time_s(PART)]).unwrap();
    let [first, last] = turns.next_told(&mut agent, PART + 4);
    assert!(first <= 1 && last >= PART - 1, "{first} to {last}");
}

#[test]
fn what_was_heard_at_will_a_stretch_late_was_heard() {
    let slots = Slots::at_will(SLOT_S / 2.0, names(2));
    let turns = Turns { team: Arc::new(Team { slots, ..team(2, model()) }) };
    let reports = Telling { points: false, reports: true };
    let after = |heard: Range<u32>| {
        // It says what it sent in two frames, one after each half.
        let mut agent = vehicle(&turns.team, 0, []).telling(reports);
        for half in [0..17, 17..34] {
            agent.navigate(half.clone().map(|n| (Turns::time_s(n), turns.place(0)))).unwrap();
            agent.sent(&names(1)[0], half.clone().map(Turns::time_s)).unwrap();
            agent.next_packet(Turns::time_s(half.end - 1), 32).unwrap().unwrap();
        }
        let mut other = vehicle(&turns.team, 1, []).telling(reports);
        other.navigate((0..34).map(|n| (Turns::time_s(n), turns.place(1)))).unwrap();
        let link = Link { transmitter: turns.place(0), receiver: turns.place(1) };
        for n in heard {
            let late = event_at(1, Turns::time_s(n) + SLOT_S / 2.0, link, true);
            other.observe(Event { transmitter_id: names(1).remove(0), ..late }).unwrap();
        }
        sent(&mut other, 8).iter().for_each(|frame| drop(agent.receive(frame, 0.0)));
        let frame = agent.next_packet(Turns::time_s(40), 32).unwrap().unwrap();
        let (_, report, _) = agent.read_report(&frame).unwrap();
        report.first == 0
    };
    assert!(after(33..34) && !after(16..17));
}
