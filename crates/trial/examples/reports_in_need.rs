//! Measures reports under adverse conditions.
//!
//! The program prints the NLL of held-out events by own events, by the team after ten packets of each vehicle, and by
//! all events in one place. They are means over vehicles and splits. Four more columns are the mean predicted
//! probability minus the share of received messages, for these three and for the true probabilities. The last column is
//! the share of splits in which the last vehicle detects its clock offset. Unused slots are neither training nor
//! held-out events.
//!
//! Vehicles send in turn, in slots of ten seconds from second 10 on, as in the logs of this repository.
//!
//! * A position error is a vector of fixed length that turns once in half an hour, in different directions for
//!   different vehicles.
//! * With a clock offset the last vehicle attributes slots to wrong senders. It records a miss of each sender that it
//!   expected and did not receive, and wrong times for received messages.
//! * Unused slots are one in ten. Without a report of its sender, each listener records an unused slot as a miss.
//!
//! `cargo run --release -p pingmap-trial --example reports_in_need -- events.csv splits.csv [packets]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use common::{Failure, log_splits_and_packets};
use pingmap_agent::{
    Agent, AgentError, AgentOptions, Event, Learning, LinkQuery, Position, PredictOptions, Sharing, Slots, Team,
    VehicleId,
};
use pingmap_trial::{EventLog, Mission, Plan, Score, Split};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

const SLOT_S: f64 = 10.0;

/// An adverse condition.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Condition {
    Normal,
    /// Vehicles have position errors of this length in metres. Queries are at true positions.
    PositionErrors(f64),
    /// Vehicles have position errors of this length in metres. Queries are at the positions that vehicles estimate.
    PositionErrorsInQueries(f64),
    /// The clock of the last vehicle is one slot ahead.
    ClockAhead,
    /// The last vehicle records nothing, so its events are missing for all.
    NoRecords,
    /// The team has no schedule and sends summaries.
    NoSchedule,
    /// One slot in ten is unused.
    UnusedSlots {
        reported: bool,
    },
}

const CONDITIONS: [(&str, Condition); 12] = [
    ("normal", Condition::Normal),
    ("position errors of 10 m", Condition::PositionErrors(10.0)),
    ("30 m", Condition::PositionErrors(30.0)),
    ("100 m", Condition::PositionErrors(100.0)),
    ("10 m, also in queries", Condition::PositionErrorsInQueries(10.0)),
    ("30 m", Condition::PositionErrorsInQueries(30.0)),
    ("100 m", Condition::PositionErrorsInQueries(100.0)),
    ("a clock one slot ahead", Condition::ClockAhead),
    ("a vehicle records nothing", Condition::NoRecords),
    ("no schedule: summaries", Condition::NoSchedule),
    ("unused slots, reported", Condition::UnusedSlots { reported: true }),
    ("unused slots, not reported", Condition::UnusedSlots { reported: false }),
];

/// Positions of every vehicle by slot.
type Positions = BTreeMap<VehicleId, BTreeMap<u64, Position>>;

fn slot(time_s: f64) -> u64 {
    (time_s / SLOT_S).round() as u64
}

fn positions(log: &EventLog) -> Positions {
    let mut positions = Positions::new();
    for event in &log.events {
        let ends = [(&event.transmitter_id, event.link.transmitter), (&event.receiver_id, event.link.receiver)];
        for (id, position) in ends {
            positions.entry(id.clone()).or_default().insert(slot(event.time_s), position);
        }
    }
    positions
}

/// Results of one split, mean over vehicles.
#[derive(Debug, Clone, Copy, Default)]
struct Scores {
    own_nll: f64,
    team_nll: f64,
    all_nll: f64,
    own_bias: f64,
    team_bias: f64,
    all_bias: f64,
    true_bias: f64,
    /// 1 if the last vehicle detects its clock offset.
    detected: f64,
}

/// A mission of this log under an adverse condition.
struct AdverseMission<'a> {
    condition: Condition,
    log: &'a EventLog,
    split: &'a Split,
    positions: &'a Positions,
    ids: Vec<VehicleId>,
    unused: BTreeSet<u64>,
}

impl AdverseMission<'_> {
    /// Returns the position that a vehicle estimates.
    fn estimated(&self, id: &VehicleId, time_s: f64, at: Position) -> Position {
        let (Condition::PositionErrors(error_m) | Condition::PositionErrorsInQueries(error_m)) = self.condition else {
            return at;
        };
        let number = self.ids.iter().position(|other| other == id).unwrap_or_default() as f64;
        let direction = if number % 2.0 == 0.0 { 1.0 } else { -1.0 };
        let angle = std::f64::consts::TAU * (time_s / 1800.0 * direction + number / 3.0);
        Position { east_m: at.east_m + error_m * angle.cos(), north_m: at.north_m + error_m * angle.sin(), ..at }
    }

    /// Returns an event with the positions that its vehicles estimate.
    fn with_estimates(&self, event: &Event) -> Event {
        let mut estimated = event.clone();
        estimated.link.transmitter = self.estimated(&event.transmitter_id, event.time_s, event.link.transmitter);
        estimated.link.receiver = self.estimated(&event.receiver_id, event.time_s, event.link.receiver);
        estimated
    }

    fn training(&self) -> impl Iterator<Item = Event> {
        let training = self.split.indices(false).into_iter().map(|n| self.with_estimates(&self.log.events[n]));
        training.filter(|event| self.condition != Condition::NoRecords || self.ids.last() != Some(&event.receiver_id))
    }

    fn sender(&self, slot: u64) -> VehicleId {
        self.ids[((slot - 1) % self.ids.len() as u64) as usize].clone()
    }

    fn has_clock_offset(&self, id: &VehicleId) -> bool {
        self.condition == Condition::ClockAhead && self.ids.last() == Some(id)
    }

    /// Returns the events that a vehicle records.
    fn recorded(&self, id: &VehicleId) -> Vec<Event> {
        let mut recorded = Vec::new();
        for event in self.training().filter(|event| event.receiver_id == *id) {
            let number = slot(event.time_s);
            if self.unused.contains(&number) {
                recorded.push(Event { success: false, ..event });
            } else if self.has_clock_offset(id) {
                let (expected, time_s) = (self.sender(number + 1), event.time_s + SLOT_S);
                if (!event.success || expected != event.transmitter_id) && expected != *id {
                    let mut missed =
                        Event { time_s, transmitter_id: expected.clone(), success: false, ..event.clone() };
                    missed.link.transmitter =
                        *self.positions[&expected].get(&number).unwrap_or(&event.link.transmitter);
                    recorded.push(missed);
                }
                if event.success {
                    recorded.push(Event { time_s, ..event });
                }
            } else {
                recorded.push(event);
            }
        }
        recorded
    }

    fn vehicle(&self, team: &Team, id: &VehicleId) -> Result<Agent, Failure> {
        let slots = Slots { start_s: SLOT_S, ..Slots::cycle(SLOT_S, self.ids.clone()) };
        let team = Arc::new(Team { slots, ..team.clone() });
        let sharing = if self.condition == Condition::NoSchedule { Sharing::summaries() } else { Sharing::default() };
        let mut agent = Agent::new(id.clone(), team, AgentOptions { sharing, ..AgentOptions::default() });
        let ahead_s = if self.has_clock_offset(id) { SLOT_S } else { 0.0 };
        let fix = |(&slot, &at): (&u64, &Position)| {
            let time_s = SLOT_S * slot as f64;
            (time_s + ahead_s, self.estimated(id, time_s, at))
        };
        agent.record_positions(self.positions[id].iter().map(fix))?;
        agent.record_all(self.recorded(id))?;
        if self.condition == (Condition::UnusedSlots { reported: true }) {
            let own = self.unused.iter().filter(|&&slot| self.sender(slot) == *id);
            agent.record_unused_slots(own.map(|&slot| SLOT_S * slot as f64))?;
        }
        agent.rebuild()?;
        Ok(agent)
    }

    fn scores(&self, mission: &Mission, packets: usize) -> Result<Scores, Failure> {
        let mut agents = self.ids.iter().map(|id| self.vehicle(&mission.team, id)).collect::<Result<Vec<_>, _>>()?;
        let mut sent: Vec<Vec<Vec<u8>>> = Vec::new();
        for agent in &agents {
            let (mut agent, mut frames) = (agent.clone(), Vec::new());
            while frames.len() < packets
                && let Some(frame) = agent.next_frame(None, 32)?
            {
                frames.push(frame);
            }
            sent.push(frames);
        }
        let is_used = |event: &Event| !self.unused.contains(&slot(event.time_s));
        let options = AgentOptions { record_all_receivers: true, ..AgentOptions::default() };
        let mut all = Agent::new(VehicleId::new("shore"), mission.team.clone(), options);
        all.record_all(self.training().filter(is_used))?;
        all.rebuild()?;
        let (queries, outcomes) = self.queries(mission);
        let nll = |predicted: &[f64]| Score::new(predicted, &outcomes).map_or(f64::NAN, |score| score.nll);
        let bias = |predicted: &[f64]| {
            let received = outcomes.iter().filter(|received| **received).count() as f64;
            (predicted.iter().sum::<f64>() - received) / outcomes.len() as f64
        };
        let (mut scores, count) = (Scores::default(), agents.len() as f64);
        for (number, agent) in agents.iter_mut().enumerate() {
            let predicted = probabilities(agent, &queries)?;
            scores.own_nll += nll(&predicted) / count;
            scores.own_bias += bias(&predicted) / count;
            let others = sent.iter().enumerate().filter(|&(sender, _)| sender != number);
            for frame in others.flat_map(|(_, frames)| frames) {
                agent.receive(frame, Some(mission.end_s));
            }
            agent.rebuild()?;
            let predicted = probabilities(agent, &queries)?;
            scores.team_nll += nll(&predicted) / count;
            scores.team_bias += bias(&predicted) / count;
            if agent.status().own_clock_offset_slots == Some(1) {
                scores.detected += 1.0;
            }
        }
        let predicted = probabilities(&mut all, &queries)?;
        (scores.all_nll, scores.all_bias) = (nll(&predicted), bias(&predicted));
        scores.true_bias = self.log.true_probability.as_ref().map_or(f64::NAN, |truth| {
            let truth: Vec<f64> = self.held_out().map(|n| truth[n]).collect();
            bias(&truth)
        });
        Ok(scores)
    }

    /// Returns the indices of held-out events in used slots.
    fn held_out(&self) -> impl Iterator<Item = usize> {
        let held_out = self.split.indices(true).into_iter();
        held_out.filter(|&n| !self.unused.contains(&slot(self.log.events[n].time_s)))
    }

    /// Returns the queries for these events, and their outcomes.
    fn queries(&self, mission: &Mission) -> (Vec<LinkQuery>, Vec<bool>) {
        let used: BTreeSet<usize> = self.held_out().collect();
        let held_out = self.split.indices(true).into_iter().zip(&mission.held_out).zip(&mission.outcomes);
        let used = held_out.filter(|((n, _), _)| used.contains(n));
        let queries = used.map(|((n, query), outcome)| match self.condition {
            Condition::PositionErrorsInQueries(_) => {
                (LinkQuery { link: self.with_estimates(&self.log.events[n]).link, ..*query }, *outcome)
            }
            _ => (*query, *outcome),
        });
        queries.unzip()
    }
}

fn probabilities(agent: &mut Agent, queries: &[LinkQuery]) -> Result<Vec<f64>, AgentError> {
    let predictions = agent.predict(queries, PredictOptions::default())?;
    Ok(predictions.into_iter().map(|prediction| prediction.probability).collect())
}

fn main() -> Result<(), Failure> {
    let (log, splits, packets) = log_splits_and_packets()?;
    let positions = positions(&log);
    let plan = Plan::new(Learning::default(), 1);
    let prepare = |split: &Split| Ok(Mission::prepare(&log, split, &plan, 0)?);
    let missions = splits.par_iter().map(prepare).collect::<Result<Vec<_>, Failure>>()?;
    println!("{:26}     own    team     all  bias:  own    team     all   truth  offset detected", "");
    for (name, condition) in CONDITIONS {
        let of_split = |(number, (split, mission)): (usize, (&Split, &Mission))| {
            let mut rng = ChaCha8Rng::seed_from_u64(number as u64);
            let last = log.events.iter().map(|event| slot(event.time_s)).max().unwrap_or_default();
            let is_unused = |_: &u64| matches!(condition, Condition::UnusedSlots { .. }) && rng.random::<f64>() < 0.1;
            let unused = (1..=last).filter(is_unused).collect();
            let (log, positions, ids) = (&log, &positions, log.vehicles());
            AdverseMission { condition, log, split, positions, ids, unused }.scores(mission, packets)
        };
        let pairs: Vec<_> = splits.iter().zip(&missions).enumerate().collect();
        let scores = pairs.into_par_iter().map(of_split).collect::<Result<Vec<_>, Failure>>()?;
        let mean = |value: fn(&Scores) -> f64| scores.iter().map(value).sum::<f64>() / scores.len() as f64;
        let nll = [mean(|scores| scores.own_nll), mean(|scores| scores.team_nll), mean(|scores| scores.all_nll)];
        let bias = [mean(|scores| scores.own_bias), mean(|scores| scores.team_bias), mean(|scores| scores.all_bias)];
        let nll = nll.map(|nll| format!("{nll:.4}")).join("  ");
        let bias = bias.map(|bias| format!("{bias:+.3}")).join("  ");
        let [truth, detected] = [mean(|scores| scores.true_bias), mean(|scores| scores.detected)];
        println!("{name:26}  {nll}      {bias}  {truth:+.3}  {detected:15.2}");
    }
    Ok(())
}
