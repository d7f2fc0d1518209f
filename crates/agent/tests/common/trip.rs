//! Missions in slots, of vehicles that go straight from corner to corner.

use std::sync::Arc;

use pingmap_agent::*;
use pingmap_packet::Cell;
use proptest::prelude::*;

use super::*;

pub const SLOT_S: f64 = 10.0;

/// A mission in slots: every vehicle goes straight from corner to corner, and is in the middle of a cell whenever it turns.
#[derive(Debug, Clone)]
pub struct Trip {
    pub team: Arc<Team>,
    pub slots: u32,
    /// For every vehicle the cell of knots at every eighth slot.
    pub turns: Vec<Vec<Cell>>,
    /// By slot and receiver: heard, missed, or not listened.
    pub outcomes: Vec<Vec<Option<bool>>>,
}

/// Slots of a leg.
pub const LEG: u32 = 8;

impl Trip {
    /// Three that lie still for 48 slots, in which everybody hears or misses alike.
    pub fn of_three(is_heard: impl Fn(u32) -> bool) -> Trip {
        let outcomes = (0..48).map(|slot| vec![Some(is_heard(slot)); 3]).collect();
        let turns = [60, 128, 200].map(|east| vec![Cell { east, north: 128, depth: 0 }; 7]).to_vec();
        let team = Team { track_off_max_m: 1e-6, ..team(3, model()) };
        Trip { team: Arc::new(team), slots: 48, turns, outcomes }
    }

    /// What the host of vehicle 0 records of its events if it takes a slot for this one, of this vehicle: what it hears comes in the
    /// turn of another one, and whose turn it takes it to be it misses, but for itself. Where that one was it knows as little as who it
    /// was.
    pub fn misread(&self, reckon: impl Fn(u32) -> (i64, usize)) -> Vec<Event> {
        let mut recorded = Vec::new();
        for event in self.events(0) {
            let (slot, expected) = reckon((event.time_s / SLOT_S).round() as u32);
            let time_s = SLOT_S * slot as f64;
            let expected_id = names(self.members()).remove(expected);
            if expected != 0 && (expected_id != event.transmitter_id || !event.success) {
                let link = Link { transmitter: Position::new(-77.0, 33.0), ..event.link };
                let missed = Event { transmitter_id: expected_id, link, success: false, ..event.clone() };
                recorded.push(Event { time_s, ..missed });
            }
            if event.success {
                recorded.push(Event { time_s, ..event });
            }
        }
        recorded
    }

    pub fn at(&self, vehicle: usize, slot: u32) -> Position {
        let place =
            |leg: u32| self.team.grid.knot_position(&self.team.model.chart, self.turns[vehicle][leg as usize], false);
        let leg = slot / LEG;
        let (from, to) = (place(leg), place(if slot.is_multiple_of(LEG) { leg } else { leg + 1 }));
        let share = f64::from(slot % LEG) / f64::from(LEG);
        let along = |a: f64, b: f64| a + share * (b - a);
        Position::new(along(from.east_m, to.east_m), along(from.north_m, to.north_m))
    }

    /// The same where everybody is believed: outcomes are any, so that somebody may well contradict all others.
    pub fn trusting(self) -> Trip {
        Trip { team: Arc::new(Team { surprise_max: 1e9, ..(*self.team).clone() }), ..self }
    }

    pub fn members(&self) -> usize {
        self.turns.len()
    }

    pub fn event(&self, slot: u32, receiver: usize) -> Option<Event> {
        let transmitter = slot as usize % self.members();
        let success = self.outcomes[slot as usize][receiver].filter(|_| transmitter != receiver)?;
        let id = |number: usize| names(number + 1).remove(number);
        let link = Link { transmitter: self.at(transmitter, slot), receiver: self.at(receiver, slot) };
        let time_s = SLOT_S * f64::from(slot);
        Some(Event { time_s, transmitter_id: id(transmitter), receiver_id: id(receiver), link, kind: None, success })
    }

    pub fn events(&self, receiver: usize) -> Vec<Event> {
        (0..self.slots).filter_map(|slot| self.event(slot, receiver)).collect()
    }

    pub fn vehicle(&self, number: usize) -> Agent {
        let fixes = (0..=self.slots).map(|slot| (SLOT_S * f64::from(slot), self.at(number, slot)));
        let reports = Telling { points: false, reports: true };
        let mut agent = vehicle(&self.team, number, self.events(number)).telling(reports);
        agent.navigate(fixes).unwrap();
        agent
    }

    /// What a vehicle reports in every fifth slot of what it knows so far.
    pub fn reports_under_way(&self, number: usize) -> Vec<Vec<u8>> {
        let mut agent = vehicle(&self.team, number, Vec::new()).telling(Telling { points: false, reports: true });
        let reports = (0..self.slots).filter_map(|slot| {
            agent.navigate([(SLOT_S * f64::from(slot), self.at(number, slot))]).unwrap();
            agent.observe_all(self.event(slot, number)).unwrap();
            if slot % 5 == 4 {
                agent.next_packet(SLOT_S * f64::from(slot), agent.team().frame_bytes).unwrap()
            } else {
                None
            }
        });
        reports.collect()
    }

    pub fn reports(&self) -> Vec<Vec<u8>> {
        (0..self.members()).flat_map(|number| sent(&mut self.vehicle(number), 100)).collect()
    }

    /// Somebody with everybody's events.
    pub fn all_in_one_place(&self) -> Agent {
        let mut all = Agent::new(VehicleId::new("shore"), self.team.clone()).owning_all_events();
        all.observe_all((0..self.members()).flat_map(|number| self.events(number))).unwrap();
        all.rebuild_posteriors().unwrap();
        all
    }
}

/// Whether it turns so much at the second of three corners that it is a cell off after a slot, where it went straight on: else that
/// corner need not be told.
fn turns_off(corners: &[Cell]) -> bool {
    let off = |along: fn(&Cell) -> u8| {
        let [before, at, after] = [0, 1, 2].map(|corner| i32::from(along(&corners[corner])));
        (after - 2 * at + before).unsigned_abs() >= LEG
    };
    off(|cell| cell.east) || off(|cell| cell.north)
}

pub fn trips() -> impl Strategy<Value = Trip> {
    (2..5usize, 3..7u32).prop_flat_map(|(members, legs)| {
        let slots = legs * LEG;
        // No faster than a vehicle: neighbouring turns are near.
        let cell = (64..192u8, 64..192u8).prop_map(|(east, north)| Cell { east, north, depth: 0 });
        let turns = prop::collection::vec(cell, legs as usize + 1)
            .prop_filter("straight on", |turns| turns.windows(3).all(turns_off));
        let turns = prop::collection::vec(turns, members);
        let outcome = prop_oneof![3 => Just(Some(true)), 3 => Just(Some(false)), 1 => Just(None)];
        let outcomes = prop::collection::vec(prop::collection::vec(outcome, members), slots as usize);
        (turns, outcomes).prop_map(move |(turns, outcomes)| {
            let team = team(members, model());
            // Every turn is told, and in the middle of its cell: tracks are exact.
            let team = Team { track_off_max_m: 1e-6, tellings_max: 2, ..team };
            Trip { team: Arc::new(team), slots, turns, outcomes }
        })
    })
}

pub fn latent(agent: &mut Agent) -> (Vec<f64>, Vec<f64>) {
    let inputs = agent.model().inputs(somewhere()).unwrap();
    let latent = agent.posterior().unwrap().latent(&inputs).unwrap();
    (latent.mean, latent.variance)
}
