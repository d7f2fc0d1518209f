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
        let [first, last] = turns.next_told(&mut agent, 2 * PART + 2);
        assert!(first <= part.start + 1 && last >= part.end - 1, "{first} to {last}, lost in {lost}");
    }
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
