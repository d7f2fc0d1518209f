//! Measures the benefit of frames and piggybacked outcomes during a mission.
//!
//! The program predicts every event from the vehicle's own earlier events, and from all earlier events of all vehicles
//! without delay. It prints both mean NLLs, and the share of their gap that three kinds of sharing close: frames, ideal
//! frames, and two piggybacked bytes on every transmission. An ideal frame carries all earlier events of its sender at
//! exact positions. The last two columns contain the share of remote events that is known when a frame is received, and
//! the same for piggybacked bytes.
//!
//! A vehicle sends a frame of 32 bytes on every n-th of its transmissions. Vehicles that heard the transmission by the
//! log receive it. Shares have jackknife standard errors: between tenths of a mission, or between missions.
//!
//! `cargo run --release -p pingmap-trial --example under_way -- n model.toml [without=FEATURE,…] events.csv…` (`-` for
//! no model; a feature is a field of `Sharing`)

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentOptions, Event, Learning, ModelFile, PredictOptions, Team, VehicleId};
use pingmap_trial::{Agreed, EventLog, Plan, Score, schedule};

mod common;

type Failure = Box<dyn Error + Send + Sync>;

const FRAME_BYTES: usize = 32;

const PIGGYBACK_BITS: usize = 16;

/// Number of parts of a mission for standard errors.
const TENTHS: usize = 10;

/// A vehicle with three agents: one receives frames, one ideal frames, and one piggybacked bytes alone.
struct Vehicle {
    agent: Agent,
    ideal: Agent,
    piggyback: Agent,
    /// Own events so far.
    events: Vec<Event>,
    /// Number of events of each other vehicle that ideal frames brought.
    known: BTreeMap<VehicleId, usize>,
    /// Number of events of each other vehicle at its last received transmission.
    had: BTreeMap<VehicleId, usize>,
    transmissions: usize,
}

/// Sums of the NLL of events.
#[derive(Default, Clone, Copy)]
struct Scores {
    own: f64,
    team: f64,
    ideal: f64,
    piggyback: f64,
    all: f64,
    count: f64,
}

impl Scores {
    /// Returns the percentages of the gap between own and all events that frames, ideal frames and piggybacked bytes
    /// close.
    fn closed(&self) -> [f64; 3] {
        [self.team, self.ideal, self.piggyback].map(|nll| 100.0 * (self.own - nll) / (self.own - self.all))
    }

    /// Returns the sum of all parts, without one part if it is given.
    fn sum(parts: &[Self], without: Option<usize>) -> Self {
        let counted = parts.iter().enumerate().filter(|(nth, _)| Some(*nth) != without);
        counted.fold(Self::default(), |sum, (_, one)| Self {
            own: sum.own + one.own,
            team: sum.team + one.team,
            ideal: sum.ideal + one.ideal,
            piggyback: sum.piggyback + one.piggyback,
            all: sum.all + one.all,
            count: sum.count + one.count,
        })
    }
}

struct Run {
    every: usize,
    vehicles: BTreeMap<VehicleId, Vehicle>,
    all: Agent,
    /// One entry for each tenth of the mission.
    scores: Vec<Scores>,
    /// The share of remote events that is known, for each received frame.
    shares: Vec<f64>,
    /// The share of remote events that is known, for each transmission with received piggybacked bytes.
    piggyback_shares: Vec<f64>,
}

impl Run {
    fn new(log: &EventLog, plan: &Plan, every: usize) -> Result<Self, Failure> {
        let slots = schedule(log).ok_or("the log has no schedule")?;
        let team = Arc::new(Team { slots, ..plan.team(log, None)?.0 });
        let options = AgentOptions { sharing: plan.sharing, ..AgentOptions::default() };
        let shore = AgentOptions { record_all_receivers: true, ..options };
        let ideal_agent = |id: &str| Agent::new(VehicleId::new(id), team.clone(), shore);
        let vehicle = |id: VehicleId| {
            let [agent, piggyback] = [(); 2].map(|()| Agent::new(id.clone(), team.clone(), options));
            let ideal = ideal_agent(id.as_str());
            (
                id,
                Vehicle {
                    agent,
                    ideal,
                    piggyback,
                    events: Vec::new(),
                    known: BTreeMap::new(),
                    had: BTreeMap::new(),
                    transmissions: 0,
                },
            )
        };
        let vehicles = log.vehicles().into_iter().map(vehicle).collect();
        Ok(Self {
            every,
            vehicles,
            all: ideal_agent("all"),
            scores: Vec::new(),
            shares: Vec::new(),
            piggyback_shares: Vec::new(),
        })
    }

    /// Runs one transmission: each listener predicts and records the event, and receives frame and piggybacked bytes.
    fn transmit(&mut self, events: &[Event]) -> Result<(), Failure> {
        let (sender, time_s) = (&events[0].transmitter_id, events[0].time_s);
        let (mut frame, mut bits) = (None, None);
        if let Some(vehicle) = self.vehicles.get_mut(sender) {
            for agent in [&mut vehicle.agent, &mut vehicle.piggyback] {
                agent.record_positions([(time_s, events[0].link.transmitter)])?;
            }
            vehicle.transmissions += 1;
            bits = vehicle.piggyback.piggyback(time_s, PIGGYBACK_BITS);
            if vehicle.transmissions.is_multiple_of(self.every) {
                // All three agents refit at the same time.
                for agent in [&mut vehicle.agent, &mut vehicle.ideal, &mut vehicle.piggyback] {
                    agent.refit()?;
                }
                frame = vehicle.agent.next_frame(Some(time_s), FRAME_BYTES)?;
            }
        }
        for event in events {
            self.predict(event)?;
        }
        for event in events {
            learn(&mut self.all, [event.clone()])?;
            let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { continue };
            for agent in [&mut vehicle.agent, &mut vehicle.ideal, &mut vehicle.piggyback] {
                learn(agent, [event.clone()])?;
            }
            vehicle.events.push(event.clone());
        }
        for event in events.iter().filter(|event| event.success) {
            if let Some(bits) = bits {
                self.deliver_piggyback(event, bits);
            }
            if let Some(frame) = &frame {
                self.deliver(event, frame)?;
            }
        }
        Ok(())
    }

    fn predict(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return Ok(()) };
        let nll = |p: f64| Score::new(&[p], &[event.success]).map_or(f64::NAN, |score| score.nll);
        let query = event.query();
        let Some(scores) = self.scores.last_mut() else { return Ok(()) };
        scores.own += nll(vehicle.agent.predict([query], PredictOptions::own())?[0].probability);
        scores.team += nll(vehicle.agent.probability(query)?);
        scores.ideal += nll(vehicle.ideal.probability(query)?);
        scores.piggyback += nll(vehicle.piggyback.probability(query)?);
        scores.all += nll(self.all.probability(query)?);
        scores.count += 1.0;
        Ok(())
    }

    fn deliver_piggyback(&mut self, event: &Event, bits: u64) {
        let sender = &event.transmitter_id;
        let had = self.vehicles.get(sender).map_or(0, |vehicle| vehicle.events.len());
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return };
        vehicle.piggyback.receive_piggyback(sender, event.time_s, bits, PIGGYBACK_BITS);
        vehicle.had.insert(sender.clone(), had);
        let possible = vehicle.had.values().sum::<usize>().max(1);
        self.piggyback_shares.push(vehicle.piggyback.status().located_events as f64 / possible as f64);
    }

    /// Delivers a frame, and to the ideal agent all earlier events of its sender.
    fn deliver(&mut self, event: &Event, frame: &[u8]) -> Result<(), Failure> {
        let sender = &event.transmitter_id;
        let events = self.vehicles.get(sender).map(|vehicle| vehicle.events.clone()).unwrap_or_default();
        let Some(vehicle) = self.vehicles.get_mut(&event.receiver_id) else { return Ok(()) };
        vehicle.agent.receive(frame, Some(event.time_s));
        let known = vehicle.known.insert(sender.clone(), events.len()).unwrap_or_default();
        learn(&mut vehicle.ideal, events[known..].iter().cloned())?;
        let possible = vehicle.known.values().sum::<usize>().max(1);
        self.shares.push(vehicle.agent.status().located_events as f64 / possible as f64);
        Ok(())
    }
}

fn learn(agent: &mut Agent, events: impl IntoIterator<Item = Event>) -> Result<(), Failure> {
    agent.record_all(events)?;
    if agent.refit_due() {
        agent.refit()?;
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [every, model, logs @ ..] = arguments.as_slice() else {
        return Err("expected: n model.toml [without=FEATURE,…] events.csv… (- for no model)".into());
    };
    let mut plan = Plan::new(Learning::default(), 1);
    if model != "-" {
        plan.agreed = Agreed::Model(ModelFile::parse(&std::fs::read_to_string(model)?)?.model);
    }
    let features = logs.first().and_then(|first| first.strip_prefix("without="));
    plan.sharing = common::sharing_without(features.unwrap_or_default())?;
    let logs = if features.is_some() { &logs[1..] } else { logs };
    println!("    own      all   frames    ideal  piggyb.  closed, %:  frames     ideal   piggyb.   known  piggyb.");
    let mut missions = Vec::new();
    for path in logs {
        let run = mission(&EventLog::open(Path::new(path))?, &plan, every.parse::<usize>()?.max(1))?;
        let [frames, piggyback] = [&run.shares, &run.piggyback_shares].map(|shares| mean(shares.iter().copied()));
        println!("{}  {frames:6.3}  {piggyback:7.3}  {path}", row(&run.scores));
        missions.push(Scores::sum(&run.scores, None));
    }
    if missions.len() > 1 {
        println!("{}  all together", row(&missions));
    }
    Ok(())
}

fn mean(shares: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = shares.len().max(1) as f64;
    shares.sum::<f64>() / count
}

/// Formats the mean NLLs of all parts together, and the closed shares of the gap.
fn row(parts: &[Scores]) -> String {
    let sum = Scores::sum(parts, None);
    let nlls = [sum.own, sum.all, sum.team, sum.ideal, sum.piggyback].map(|nll| format!("{:.5}", nll / sum.count));
    let [frames, ideal, piggyback] = [0, 1, 2].map(|nth| with_error(parts, nth));
    format!("{}  {frames:>18} {ideal:>9} {piggyback:>9}", nlls.join("  "))
}

fn mission(log: &EventLog, plan: &Plan, every: usize) -> Result<Run, Failure> {
    let mut run = Run::new(log, plan, every)?;
    let mut events = log.events.clone();
    events.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then_with(|| a.transmitter_id.cmp(&b.transmitter_id)));
    let is_same = |a: &Event, b: &Event| a.time_s == b.time_s && a.transmitter_id == b.transmitter_id;
    let transmissions: Vec<&[Event]> = events.chunk_by(is_same).collect();
    for tenth in transmissions.chunks(transmissions.len().div_ceil(TENTHS)) {
        run.scores.push(Scores::default());
        for transmission in tenth {
            run.transmit(transmission)?;
        }
    }
    Ok(run)
}

/// Formats a closed share of all parts with its jackknife standard error.
fn with_error(parts: &[Scores], nth: usize) -> String {
    let count = parts.len() as f64;
    let without: Vec<f64> = (0..parts.len()).map(|one| Scores::sum(parts, Some(one)).closed()[nth]).collect();
    let mean = without.iter().sum::<f64>() / count;
    let squares = without.iter().map(|one| (one - mean).powi(2)).sum::<f64>();
    format!("{:.0} ± {:.0}", Scores::sum(parts, None).closed()[nth], (squares * (count - 1.0) / count).sqrt())
}
