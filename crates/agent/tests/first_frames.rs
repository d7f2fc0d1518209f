//! What goes first of a mission that was not shared: few frames may follow.

#![allow(clippy::unwrap_used)]

mod common;

use std::ops::Range;
use std::sync::Arc;

use common::trip::SLOT_S;
use common::*;
use pingmap_agent::*;
use pingmap_packet::{Outcome, ReportLayout};

/// Slots of a leg.
const LEG: u32 = 20;

/// Two vehicles that send in turn, a team of their own. One lies still. The other goes to and fro near it, but for an excursion to
/// where nothing is heard.
struct Pair {
    team: Arc<Team>,
    slots: u32,
    far: Range<u32>,
}

impl Pair {
    fn new(slots: u32, far: Range<u32>) -> Self {
        Self { team: Arc::new(Team { tellings_max: 1, ..team(2, model()) }), slots, far }
    }

    /// The middle of a cell, so that what is told of it is exact.
    fn place(&self, east_m: f64, north_m: f64) -> Position {
        let cell = self.team.grid.knot_cell(&self.team.model.chart, &Position::new(east_m, north_m)).unwrap();
        self.team.grid.knot_position(&self.team.model.chart, cell, false)
    }

    fn near(&self) -> Position {
        self.place(-500.0, 0.0)
    }

    fn at(&self, vehicle: usize, slot: u32) -> Position {
        if vehicle == 1 {
            return self.near();
        }
        let turn = |leg: u32| {
            let east_m = if self.far.contains(&(leg * LEG)) { 500.0 } else { -500.0 };
            self.place(east_m, if leg.is_multiple_of(2) { 0.0 } else { 100.0 })
        };
        let (from, to) = (turn(slot / LEG), turn(slot / LEG + 1));
        let share = f64::from(slot % LEG) / f64::from(LEG);
        let along = |a: f64, b: f64| a + share * (b - a);
        Position::new(along(from.east_m, to.east_m), along(from.north_m, to.north_m))
    }

    /// A vehicle with all that it heard and missed, and everywhere it was.
    fn vehicle(&self, receiver: usize) -> Agent {
        let heard = (0..self.slots).filter(|&slot| slot as usize % 2 != receiver).map(|slot| {
            let [transmitter_id, receiver_id] = [1 - receiver, receiver].map(|number| names(2).remove(number));
            let link = Link { transmitter: self.at(1 - receiver, slot), receiver: self.at(receiver, slot) };
            let time_s = SLOT_S * f64::from(slot);
            Event { time_s, transmitter_id, receiver_id, link, kind: None, success: link.range_m() < 500.0 }
        });
        let mut agent = vehicle(&self.team, receiver, heard);
        agent.navigate((0..=self.slots).map(|slot| (SLOT_S * f64::from(slot), self.at(receiver, slot)))).unwrap();
        agent
    }
}

#[test]
fn what_is_unlike_the_rest_is_in_the_first_report() {
    for far in [200..260, 400..460, 560..620] {
        let pair = Pair::new(800, far.clone());
        let reports = Telling { points: false, reports: true };
        let [one, other] = [0, 1].map(|number| sent(&mut pair.vehicle(number).telling(reports), 20));
        let mut listener = Agent::new(VehicleId::new("shore"), pair.team.clone());
        let (_, report, _) = listener.read_report(&one[0]).unwrap();
        let count = |outcome: Outcome| report.outcomes.iter().filter(|&&told| told == outcome).count();
        let (heard, missed) = (count(Outcome::Heard), count(Outcome::Missed));
        assert!(heard >= 10 && missed >= 10, "{far:?}: {heard} heard, {missed} missed from {} on", report.first);
        // So whoever knows where the other one was knows of both, which either end of the mission would not have told.
        one[..1].iter().chain(&other).for_each(|bytes| drop(listener.receive(bytes, 0.0)));
        let over = |receiver| Link { transmitter: pair.near(), receiver: pair.place(receiver, 0.0) };
        let [near, beyond] = [-500.0, 500.0].map(|place| listener.probability(over(place)).unwrap());
        assert!(near > 0.8 && beyond < 0.3, "{far:?}: {near} {beyond}");
    }
}

/// Map messages speak of everything, and where some went, frames do go: reports begin when they are done within three, and two more
/// for each that went.
#[test]
fn reports_begin_where_they_are_soon_done() {
    for (slots, needed, before) in [(100, 2, 0), (200, 3, 0), (300, 4, 1), (400, 5, 1), (600, 8, 3)] {
        let pair = Pair::new(slots, slots / 3..slots / 2);
        let frames = |telling| sent(&mut pair.vehicle(0).telling(telling), 40).into_iter();
        assert_eq!(frames(Telling { points: false, reports: true }).count(), needed, "{slots} slots");
        let is_map = |bytes: &Vec<u8>| ReportLayout::of(bytes).is_none();
        assert_eq!(frames(Telling::default()).take_while(is_map).count(), before, "{slots} slots");
    }
}
