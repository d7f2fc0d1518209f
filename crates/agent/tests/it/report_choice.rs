//! The choice of reports: the first frames of a mission that was not shared hold what is unlike the rest.

use std::ops::Range;
use std::sync::Arc;

use crate::common::trip::slot_s;
use crate::common::*;
use pingmap_agent::*;
use pingmap_packet::{Outcome, ReportLayout};

/// Slots of a leg.
const LEG: u32 = 20;

/// Two vehicles that transmit in turn. Vehicle 1 does not move. Vehicle 0 moves to and fro near it, except on an
/// excursion beyond its range.
struct Pair {
    team: Arc<Team>,
    slots: u32,
    far: Range<u32>,
}

impl Pair {
    fn new(slots: u32, far: Range<u32>) -> Self {
        Self { team: Arc::new(Team { transmissions_max: 1, ..team(2, model()) }), slots, far }
    }

    /// The centre of a waypoint cell.
    fn place(&self, east_m: f64, north_m: f64) -> Position {
        let cell = self.team.grid.waypoint_cell(&self.team.model.chart, &Position::new(east_m, north_m)).unwrap();
        self.team.grid.waypoint_position(&self.team.model.chart, cell, false)
    }

    fn near(&self) -> Position {
        self.place(-500.0, 0.0)
    }

    fn at(&self, vehicle: usize, slot: u32) -> Position {
        if vehicle == 1 {
            return self.near();
        }
        let corner = |leg: u32| {
            let east_m = if self.far.contains(&(leg * LEG)) { 500.0 } else { -500.0 };
            self.place(east_m, if leg.is_multiple_of(2) { 0.0 } else { 100.0 })
        };
        let (from, to) = (corner(slot / LEG), corner(slot / LEG + 1));
        let share = f64::from(slot % LEG) / f64::from(LEG);
        let along = |a: f64, b: f64| a + share * (b - a);
        Position::new(along(from.east_m, to.east_m), along(from.north_m, to.north_m))
    }

    /// A vehicle with all its outcomes and positions.
    fn vehicle(&self, receiver: usize, sharing: Sharing) -> Agent {
        let events = (0..self.slots).filter(|&slot| slot as usize % 2 != receiver).map(|slot| {
            let link = Link { transmitter: self.at(1 - receiver, slot), receiver: self.at(receiver, slot) };
            let event = event_at(receiver, slot_s(slot), link, link.range_m() < 500.0);
            Event { transmitter_id: name(1 - receiver), ..event }
        });
        let options = AgentOptions { sharing, ..AgentOptions::default() };
        let mut agent = vehicle_with(&self.team, receiver, options, events);
        agent.record_positions((0..=self.slots).map(|slot| (slot_s(slot), self.at(receiver, slot)))).unwrap();
        agent
    }
}

fn is_report(bytes: &[u8]) -> bool {
    ReportLayout::of(bytes).is_some()
}

#[test]
fn the_first_report_holds_outcomes_of_both_kinds() {
    for far in [200..260, 400..460, 560..620] {
        let pair = Pair::new(800, far.clone());
        let [one, other] = [0, 1].map(|number| frames(&mut pair.vehicle(number, Sharing::reports()), 20));
        let mut listener = Agent::new(VehicleId::new("shore"), pair.team.clone(), AgentOptions::default());
        let (_, report, _) = listener.codec().read_report(&one[0]).unwrap();
        let count = |outcome: Outcome| report.outcomes.iter().filter(|&&reported| reported == outcome).count();
        let (heard, missed) = (count(Outcome::Heard), count(Outcome::Missed));
        assert!(heard >= 10 && missed >= 10, "{far:?}: {heard} heard, {missed} missed from {} on", report.first);
        // A listener with the positions of vehicle 1 learns both. Neither end of the mission alone would show that.
        receive_all_at(&mut listener, one[..1].iter().chain(&other), slot_s(800));
        let over = |receiver| Link { transmitter: pair.near(), receiver: pair.place(receiver, 0.0) };
        let [near, beyond] = [-500.0, 500.0].map(|place| listener.probability(over(place)).unwrap());
        assert!(near > 0.8 && beyond < 0.3, "{far:?}: {near} {beyond}");
    }
}

#[test]
fn without_candidates_the_first_report_holds_most_outcomes() {
    let pair = Pair::new(800, 400..460);
    let sharing = Sharing { report_candidates: false, ..Sharing::reports() };
    let count = |sharing| {
        let mut agent = pair.vehicle(0, sharing);
        let report = frames(&mut agent, 1).remove(0);
        agent.codec().read_report(&report).unwrap().1.outcomes.len()
    };
    assert!(count(sharing) >= count(Sharing::reports()));
}

#[test]
fn reports_come_before_summaries() {
    let pair = Pair::new(300, 100..150);
    let needed = frames(&mut pair.vehicle(0, Sharing::reports()), 40).len();
    let both = frames(&mut pair.vehicle(0, Sharing::default()), 40);
    let first = both.iter().take_while(|bytes| is_report(bytes)).count();
    assert_eq!((first, both.len()), (needed, needed), "every event has a slot in the report window");
}

#[test]
fn the_number_of_reports_grows_with_the_mission() {
    for (slots, needed) in [(100, 2), (200, 3), (300, 4), (400, 5), (600, 8)] {
        let pair = Pair::new(slots, slots / 3..slots / 2);
        assert_eq!(frames(&mut pair.vehicle(0, Sharing::reports()), 40).len(), needed, "{slots} slots");
    }
}

#[test]
fn summaries_describe_only_events_that_no_report_carries() {
    let pair = Pair::new(100, 0..0);
    // Events of a buoy have no slots.
    let west = |n: u32| event_at(0, 1000.0 + f64::from(n), link([500.0, 500.0, 400.0, 500.0 + f64::from(n)]), true);
    let mut agent = pair.vehicle(0, Sharing::default());
    agent.record((0..30).map(west)).unwrap();
    let all = frames(&mut agent, 40);
    let reports = all.iter().take_while(|bytes| is_report(bytes)).count();
    assert!(reports > 0 && reports < all.len() && all[reports..].iter().all(|bytes| !is_report(bytes)));
    let described = summarised_links(&agent, 0).concat();
    assert!(!described.is_empty() && described.iter().all(|link| link.receiver.north_m > 300.0), "{described:?}");
}

#[test]
fn summaries_describe_events_before_the_report_window() {
    let mut pair = Pair::new(400, 0..200);
    // Vehicle 0 is far away in the first half of the mission, which the window does not reach.
    let mut team = (*pair.team).clone();
    team.limits.report_window_slots = 150;
    pair.team = Arc::new(team);
    let mut agent = pair.vehicle(0, Sharing::default());
    let all = frames(&mut agent, 40);
    let described = summarised_links(&agent, 0).concat();
    assert!(all.iter().any(|bytes| is_report(bytes)) && !described.is_empty());
    assert!(described.iter().any(|link| link.range_m() > 800.0), "{described:?}");
}

#[test]
fn events_without_slots_are_sent_in_summaries_alone() {
    let mut agent = Pair::new(0, 0..0).vehicle(0, Sharing::default());
    agent.record(walk(0, 40, 0.0)).unwrap();
    let all = frames(&mut agent, 40);
    assert!(!all.is_empty() && all.iter().all(|bytes| !is_report(bytes)));
}

#[test]
fn without_reports_summaries_describe_events_in_slots_too() {
    let pair = Pair::new(100, 0..0);
    let mut agent = pair.vehicle(0, Sharing::summaries());
    let all = frames(&mut agent, 40);
    assert!(!all.is_empty() && all.iter().all(|bytes| !is_report(bytes)));
    assert!(!summarised_links(&agent, 0).concat().is_empty());
}
