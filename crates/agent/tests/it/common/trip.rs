//! Missions with a schedule, of vehicles that move along straight legs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pingmap_agent::*;
use pingmap_packet::{Cell, Outcome};
use proptest::prelude::*;

use super::*;

pub const SLOT_S: f64 = 10.0;

/// Slots of a leg.
pub const LEG: u32 = 8;

/// The beginning of a slot, in seconds.
pub fn slot_s(slot: u32) -> f64 {
    SLOT_S * f64::from(slot)
}

/// A mission in which members transmit in the order of their numbers. Every vehicle moves straight from one corner to
/// the next. Corners are centres of waypoint cells, so that reported tracks are exact.
#[derive(Debug, Clone)]
pub struct Trip {
    pub team: Arc<Team>,
    pub slots: u32,
    /// For every vehicle the cell of each corner.
    pub corners: Vec<Vec<Cell>>,
    /// By slot and receiver: heard, missed, or not recorded.
    pub outcomes: Vec<Vec<Option<bool>>>,
}

impl Trip {
    /// Vehicles that do not move, one for each cell. Every receiver records this outcome of a slot.
    pub fn stationary(cells: &[(u8, u8)], slots: u32, outcome: impl Fn(u32, usize) -> Option<bool>) -> Trip {
        let outcomes = (0..slots).map(|slot| (0..cells.len()).map(|receiver| outcome(slot, receiver)).collect());
        let corners = cells.iter().map(|&(east, north)| {
            let corner = Cell { east, north, depth: 0 };
            vec![corner; (slots / LEG) as usize + 2]
        });
        let team = Team { track_tolerance_m: 1e-6, ..team(cells.len(), model()) };
        Trip { team: Arc::new(team), slots, corners: corners.collect(), outcomes: outcomes.collect() }
    }

    /// Returns the mission of another team.
    pub fn with_team(&self, change: impl FnOnce(&mut Team)) -> Trip {
        let mut team = (*self.team).clone();
        change(&mut team);
        Trip { team: Arc::new(team), ..self.clone() }
    }

    /// This trip with an explicit schedule in place of the cycle. Every other member may listen to a transmission.
    pub fn with_explicit_schedule(&self) -> Trip {
        let scheduled = |slot| ScheduledTransmission {
            time_s: slot_s(slot),
            sender: name(self.sender(slot)),
            listeners: (0..self.members()).filter(|&number| number != self.sender(slot)).map(name).collect(),
        };
        // The last corner is at the slot after the mission.
        let explicit: Vec<ScheduledTransmission> = (0..=self.slots).map(scheduled).collect();
        self.with_team(|team| team.slots.explicit = Some(explicit.into()))
    }

    /// This trip for a team that excludes no member. Random outcomes may contradict those of all others.
    pub fn without_exclusion(&self) -> Trip {
        self.with_team(|team| team.exclusion_threshold_sd = 1e9)
    }

    pub fn members(&self) -> usize {
        self.corners.len()
    }

    pub fn sender(&self, slot: u32) -> usize {
        slot as usize % self.members()
    }

    pub fn at(&self, vehicle: usize, slot: u32) -> Position {
        let corner = |leg: u32| {
            self.team.grid.waypoint_position(&self.team.model.chart, self.corners[vehicle][leg as usize], false)
        };
        let leg = slot / LEG;
        let (from, to) = (corner(leg), corner(if slot.is_multiple_of(LEG) { leg } else { leg + 1 }));
        let share = f64::from(slot % LEG) / f64::from(LEG);
        let along = |a: f64, b: f64| a + share * (b - a);
        Position::new(along(from.east_m, to.east_m), along(from.north_m, to.north_m))
    }

    pub fn event(&self, slot: u32, receiver: usize) -> Option<Event> {
        let transmitter = self.sender(slot);
        let success = self.outcomes[slot as usize][receiver].filter(|_| transmitter != receiver)?;
        let link = Link { transmitter: self.at(transmitter, slot), receiver: self.at(receiver, slot) };
        let (transmitter_id, receiver_id) = (name(transmitter), name(receiver));
        Some(Event { time_s: slot_s(slot), transmitter_id, receiver_id, link, kind: None, success })
    }

    pub fn events(&self, receiver: usize) -> Vec<Event> {
        (0..self.slots).filter_map(|slot| self.event(slot, receiver)).collect()
    }

    /// Events that the host of vehicle 0 records by its own clock and schedule. Messages of a member arrive `late`
    /// slots after their slot. The host records a miss in every slot in which it does not receive the member that the
    /// slot belongs to.
    pub fn recorded(&self, late: impl Fn(usize, u32) -> i64) -> Vec<Event> {
        let mut receptions = Vec::new();
        for slot in 0..self.slots {
            let sender = self.sender(slot);
            let arrival = u32::try_from(i64::from(slot) + late(sender, slot));
            if let (Some(event), Ok(arrival)) = (self.event(slot, 0).filter(|event| event.success), arrival) {
                receptions.push(((sender, arrival), Event { time_s: slot_s(arrival), ..event }));
            }
        }
        let received: BTreeSet<(usize, u32)> = receptions.iter().map(|(key, _)| *key).collect();
        let is_missed = |slot: &u32| self.sender(*slot) != 0 && !received.contains(&(self.sender(*slot), *slot));
        let missed = (0..self.slots).filter(is_missed).filter_map(|slot| self.event(slot, 0));
        let mut all: Vec<Event> = missed.map(|event| Event { success: false, ..event }).collect();
        all.extend(receptions.into_iter().map(|(_, event)| event));
        all.sort_by(Event::canonical_order);
        all
    }

    /// Events of all vehicles.
    pub fn all_events(&self) -> Vec<Event> {
        (0..self.members()).flat_map(|number| self.events(number)).collect()
    }

    /// Number of events of all other vehicles.
    pub fn remote_event_count(&self, number: usize) -> usize {
        (0..self.members()).filter(|&other| other != number).map(|other| self.events(other).len()).sum()
    }

    /// Positions of a vehicle in all slots.
    pub fn positions(&self, number: usize) -> impl Iterator<Item = (f64, Position)> {
        (0..=self.slots).map(move |slot| (slot_s(slot), self.at(number, slot)))
    }

    /// A vehicle that sends reports, with its events and positions.
    pub fn vehicle(&self, number: usize) -> Agent {
        self.vehicle_with_events(number, self.events(number))
    }

    /// A vehicle with other events.
    pub fn vehicle_with_events(&self, number: usize, events: impl IntoIterator<Item = Event>) -> Agent {
        let mut agent = vehicle_with(&self.team, number, reports_alone(), events);
        agent.record_positions(self.positions(number)).unwrap();
        agent
    }

    /// Reports that a vehicle sends during the mission, in every fifth slot.
    pub fn reports_under_way(&self, number: usize) -> Vec<Vec<u8>> {
        let mut agent = vehicle_with(&self.team, number, reports_alone(), []);
        let reports = (0..self.slots).filter_map(|slot| {
            agent.record_positions([(slot_s(slot), self.at(number, slot))]).unwrap();
            agent.record(self.event(slot, number)).unwrap();
            let is_due = slot % 5 == 4;
            is_due
                .then(|| {
                    agent.next_frame(Some(slot_s(slot)), agent.team().frame_bytes).unwrap().map(|frame| frame.bytes)
                })
                .flatten()
        });
        reports.collect()
    }

    /// Reports that a vehicle sends after the mission.
    pub fn reports_of(&self, number: usize) -> Vec<Vec<u8>> {
        frames(&mut self.vehicle(number), 100)
    }

    /// Reports that all vehicles send after the mission.
    pub fn reports(&self) -> Vec<Vec<u8>> {
        (0..self.members()).flat_map(|number| self.reports_of(number)).collect()
    }

    /// A station with the events of all vehicles.
    pub fn station(&self) -> Agent {
        station(&self.team, self.all_events())
    }
}

/// Whether the track turns at the second of three corners by at least a cell in a slot. Otherwise the waypoint could be
/// left out.
fn has_turn(corners: &[Cell]) -> bool {
    let off = |along: fn(&Cell) -> u8| {
        let [before, at, after] = [0, 1, 2].map(|corner| i32::from(along(&corners[corner])));
        (after - 2 * at + before).unsigned_abs() >= LEG
    };
    off(|cell| cell.east) || off(|cell| cell.north)
}

pub fn trips() -> impl Strategy<Value = Trip> {
    (2..5usize, 3..7u32).prop_flat_map(|(members, legs)| {
        let slots = legs * LEG;
        // Neighbouring corners are near, as at the speed of a vehicle.
        let cell = (64..192u8, 64..192u8).prop_map(|(east, north)| Cell { east, north, depth: 0 });
        let corners = prop::collection::vec(cell, legs as usize + 1)
            .prop_filter("a turn at every corner", |corners| corners.windows(3).all(has_turn));
        let corners = prop::collection::vec(corners, members);
        let outcome = prop_oneof![3 => Just(Some(true)), 3 => Just(Some(false)), 1 => Just(None)];
        let outcomes = prop::collection::vec(prop::collection::vec(outcome, members), slots as usize);
        (corners, outcomes).prop_map(move |(corners, outcomes)| {
            let team = Team { track_tolerance_m: 1e-6, transmissions_max: 2, ..team(members, model()) };
            Trip { team: Arc::new(team), slots, corners, outcomes }
        })
    })
}

/// Mean and variance of the log-odds of [`test_links`].
pub fn test_latent(agent: &mut Agent) -> (Vec<f64>, Vec<f64>) {
    latent(agent, &test_links())
}

/// Largest difference of means and variances of the log-odds of [`test_links`].
pub fn latent_difference(one: &mut Agent, other: &mut Agent) -> f64 {
    let ((mean, variance), (other_mean, other_variance)) = (test_latent(one), test_latent(other));
    largest_difference(&mean, &other_mean).max(largest_difference(&variance, &other_variance))
}

/// The outcomes in a report, by slot.
pub fn reported_outcomes(agent: &Agent, report: &[u8]) -> BTreeMap<u32, bool> {
    let (_, report, _) = agent.codec().read_report(report).unwrap();
    let slots = &agent.team().slots;
    let reporter = &agent.team().members[&report.sender];
    let is_listed = |&slot: &u32| report.includes_own_slots || slots.is_heard_by(slot, reporter);
    let listed = (report.first..).filter(is_listed).zip(&report.outcomes);
    let receptions = listed.filter(|(slot, _)| slots.is_heard_by(*slot, reporter));
    let reported = receptions.filter(|(_, outcome)| **outcome != Outcome::Unreported);
    reported.map(|(slot, outcome)| (slot, *outcome == Outcome::Heard)).collect()
}
