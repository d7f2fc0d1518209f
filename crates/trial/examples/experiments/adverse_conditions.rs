//! Reports under adverse conditions.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::sync::Arc;

use clap::Args;
use pingmap_agent::{
    Agent, AgentError, AgentOptions, Event, Learning, LinkQuery, Position, Sharing, Slots, Team, VehicleId,
};
use pingmap_trial::{EventLog, Mission, Plan, Split, probabilities, send_frames};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::agents::{agent_of_all_receivers, receive_from_others};
use crate::arguments::Exchange;
use crate::statistics::{column_means, columns, nll};

/// Measures reports under adverse conditions.
///
/// The table has the NLL of held-out events by own events, by the team after the packets of each vehicle, and by all
/// events in one place. They are means over vehicles and splits. Four more columns are the mean predicted probability
/// minus the share of received messages, for these three and for the true probabilities. The last column is the share
/// of splits in which the last vehicle detects its clock offset. Unused slots are neither training nor held-out events.
///
/// Vehicles send in turn, in slots of ten seconds from second 10 on, as in the logs of this repository.
///
/// * A position error is a vector of fixed length that turns once in half an hour, in different directions for
///   different vehicles.
///
/// * With a clock offset the last vehicle attributes slots to wrong senders. It records a miss of each sender that it
///   expected and did not receive, and wrong times for received messages.
///
/// * Unused slots are one in ten. Without a report of its sender, each listener records an unused slot as a miss.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    exchange: Exchange,
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let (log, splits) = self.exchange.log.read()?;
        let positions = positions(&log);
        let plan = Plan::new(Learning::default(), 1);
        let prepare = |split: &Split| Ok(Mission::prepare(&log, split, &plan, 0)?);
        let missions = splits.par_iter().map(prepare).collect::<anyhow::Result<Vec<_>>>()?;
        writeln!(out, "{:26}     own    team     all  bias:  own    team     all   truth  offset detected", "")?;
        for (name, condition) in CONDITIONS {
            let scores = splits.par_iter().zip(&missions).enumerate().map(|(number, (split, mission))| {
                let unused = unused_slots(condition, &log, number as u64);
                let (log, positions, ids) = (&log, &positions, log.vehicles());
                AdverseMission { condition, log, split, positions, ids, unused }.scores(mission, self.exchange.packets)
            });
            let scores = scores.collect::<anyhow::Result<Vec<_>>>()?;
            let column = |values: fn(&Scores) -> [f64; 3]| column_means(&scores.iter().map(values).collect::<Vec<_>>());
            let (nll, bias) = (columns(&column(|scores| scores.nll), 4), column(|scores| scores.bias));
            let bias = bias.map(|bias| format!("{bias:+.3}")).join("  ");
            let [truth, detected] =
                column_means(&scores.iter().map(|one| [one.true_bias, one.detected]).collect::<Vec<_>>());
            writeln!(out, "{name:26}  {nll}      {bias}  {truth:+.3}  {detected:15.2}")?;
        }
        Ok(())
    }
}

const SLOT_S: f64 = 10.0;

/// Share of slots that are not used.
const UNUSED_SHARE: f64 = 0.1;

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

/// Results of one split, means over vehicles.
struct Scores {
    /// NLL by own events, by the team, and by all events in one place.
    nll: [f64; 3],
    /// Mean predicted probability minus the share of received messages, for these three.
    bias: [f64; 3],
    true_bias: f64,
    /// 1 if the last vehicle detects its clock offset.
    detected: f64,
}

/// Draws the slots that are not used.
fn unused_slots(condition: Condition, log: &EventLog, seed: u64) -> BTreeSet<u64> {
    if !matches!(condition, Condition::UnusedSlots { .. }) {
        return BTreeSet::new();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let last = log.events.iter().map(|event| slot(event.time_s)).max().unwrap_or_default();
    (1..=last).filter(|_| rng.random::<f64>() < UNUSED_SHARE).collect()
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

    fn vehicle(&self, team: &Team, id: &VehicleId) -> anyhow::Result<Agent> {
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
        agent.record(self.recorded(id))?;
        if self.condition == (Condition::UnusedSlots { reported: true }) {
            let own = self.unused.iter().filter(|&&slot| self.sender(slot) == *id);
            agent.record_unused_slots(own.map(|&slot| SLOT_S * slot as f64))?;
        }
        agent.rebuild()?;
        Ok(agent)
    }

    fn scores(&self, mission: &Mission, packets: usize) -> anyhow::Result<Scores> {
        let mut agents =
            self.ids.iter().map(|id| self.vehicle(&mission.team, id)).collect::<anyhow::Result<Vec<_>>>()?;
        let frames = agents.iter().map(|agent| send_frames(&mut agent.clone(), packets));
        let frames = frames.collect::<Result<Vec<_>, _>>()?;
        let is_used = |event: &Event| !self.unused.contains(&slot(event.time_s));
        let mut all = agent_of_all_receivers("shore", &mission.team, Sharing::default());
        all.record(self.training().filter(is_used))?;
        all.rebuild()?;
        let (queries, outcomes) = self.queries(mission);
        let received = outcomes.iter().filter(|received| **received).count() as f64;
        let bias = |predicted: &[f64]| (predicted.iter().sum::<f64>() - received) / outcomes.len() as f64;
        // NLL and bias of each vehicle, alone and as a member of the team.
        let (mut own, mut team, mut detected) = (Vec::new(), Vec::new(), 0.0);
        let score = |agent: &mut Agent| {
            let predicted = probabilities(agent, &queries)?;
            Ok::<_, AgentError>([nll(&predicted, &outcomes), bias(&predicted)])
        };
        for (number, agent) in agents.iter_mut().enumerate() {
            own.push(score(agent)?);
            receive_from_others(agent, number, frames.len(), |sender| &frames[sender], mission.end_s)?;
            team.push(score(agent)?);
            if agent.status().own_clock_offset_slots == Some(1) {
                detected += 1.0;
            }
        }
        let [own, team, all] = [column_means(&own), column_means(&team), score(&mut all)?];
        let truth = self.log.true_probability.as_ref();
        let true_bias = truth.map(|truth| bias(&self.held_out().map(|n| truth[n]).collect::<Vec<_>>()));
        Ok(Scores {
            nll: [own[0], team[0], all[0]],
            bias: [own[1], team[1], all[1]],
            true_bias: true_bias.unwrap_or(f64::NAN),
            detected,
        })
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
