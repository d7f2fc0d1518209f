//! Two hard missions: with a deaf member, and with noise that rises during the mission.

use std::io::Write;

use anyhow::Context;
use clap::Args;
use pingmap_agent::{Event, Learning, VehicleId};
use pingmap_trial::{EventLog, Mission, Plan, Preshared, Split, Step, TrafficPlan, learn, online};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::arguments::Exchange;
use crate::statistics::{column_means, columns, mean, nll};

/// Distance of the deaf vehicle from its neighbour.
const DISTANCE_M: f64 = 50.0;

/// Name of the deaf vehicle.
const DEAF: &str = "deaf";

/// Decrease of the log-odds at half time.
const NOISE: f64 = 2.5;

/// Number of events after half time.
const NEXT: usize = 35;

/// Number of draws of the outcomes.
const DRAWS: u64 = 10;

/// Measures a team with a deaf member, and a team whose noise rises during the mission.
///
/// * A deaf vehicle travels 50 m from the last receiver of the log and misses everything. The table has the NLL of the
///   others with and without it, over the splits.
///
/// * The outcomes of the log are drawn again from its true probabilities. From half time on the log-odds are 2.5 lower.
///   The table has the excess NLL of the next 35 events over the true probabilities, predicted during the mission, mean
///   over ten draws. The team has no model, or that of an earlier mission in the same area, in which noise rose as
///   well. Two more rows are without rising noise, for comparison.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    exchange: Exchange,
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let (log, splits) = self.exchange.log.read()?;
        let with_deaf = with_a_deaf_vehicle(&log, &splits);
        writeln!(out, "                              all     own     team")?;
        for (name, (log, splits)) in [("original log", &(log.clone(), splits)), ("with a deaf vehicle", &with_deaf)] {
            let nlls = splits.par_iter().map(|split| nlls(log, split, self.exchange.packets));
            let nlls = nlls.collect::<anyhow::Result<Vec<_>>>()?;
            writeln!(out, "{name:26} {}", columns(&column_means(&nlls), 4))?;
        }
        for (noise, name) in [(NOISE, "rising noise"), (0.0, "constant noise")] {
            let without = Plan::new(Learning::default(), 1);
            let with = Plan { preshared: model_of_earlier_mission(&log, noise)?, ..without.clone() };
            for (model, plan) in [("no model", without), ("with model", with)] {
                let [own, team, all] = mean_excess(&log, noise, &plan)?;
                writeln!(out, "{:26} {all:+.4} {own:+.4} {team:+.4}", format!("{name}, {model}"))?;
            }
        }
        Ok(())
    }
}

/// Returns the log and its splits with a deaf vehicle. The events of the deaf vehicle are training events.
fn with_a_deaf_vehicle(log: &EventLog, splits: &[Split]) -> (EventLog, Vec<Split>) {
    let Some(neighbour) = log.vehicles().pop() else { return (log.clone(), splits.to_vec()) };
    let mut events: Vec<(Event, Vec<bool>)> = Vec::new();
    let held_out = |n: usize| splits.iter().map(|split| split.held_out[n]).collect();
    let mut missed_s = Vec::new();
    for (n, event) in log.events.iter().enumerate() {
        events.push((event.clone(), held_out(n)));
        let Event { time_s, ref transmitter_id, .. } = *event;
        let is_there = [transmitter_id, &event.receiver_id].contains(&&neighbour);
        if is_there && !missed_s.contains(&time_s) {
            missed_s.push(time_s);
            let mut missed = Event { receiver_id: VehicleId::new(DEAF), success: false, ..event.clone() };
            if *transmitter_id == neighbour {
                missed.link.receiver = event.link.transmitter;
            }
            missed.link.receiver.east_m += DISTANCE_M;
            events.push((missed, vec![false; splits.len()]));
        }
    }
    let divide = |(place, split): (usize, &Split)| Split {
        name: split.name.clone(),
        held_out: events.iter().map(|(_, held_out)| held_out[place]).collect(),
    };
    let splits = splits.iter().enumerate().map(divide).collect();
    let events = events.into_iter().map(|(event, _)| event).collect();
    (EventLog { events, true_probability: None, ..log.clone() }, splits)
}

/// Returns the NLL of all events in one place, of own events and of the team. The last two are means over all vehicles
/// but the deaf one.
fn nlls(log: &EventLog, split: &Split, packets: usize) -> anyhow::Result<[f64; 3]> {
    let mission = Mission::prepare(log, split, &Plan::new(Learning::default(), 1), packets)?;
    let nll = |predicted: &[f64]| nll(predicted, &mission.outcomes);
    let names = log.vehicles();
    let mean_nll = |all: Vec<Vec<f64>>| {
        let hearing = all.iter().zip(&names).filter(|(_, name)| name.as_str() != DEAF);
        mean(hearing.map(|(predicted, _)| nll(predicted)))
    };
    let [alone, team] = [mission.predict_alone()?, mission.predict_as_team(packets)?];
    Ok([nll(&mission.predict_centralised()?), mean_nll(alone), mean_nll(team)])
}

/// Returns the time at which half of the mission is over.
fn half_time_s(log: &EventLog) -> f64 {
    log.events.iter().map(|event| event.time_s).fold(0.0, f64::max) / 2.0
}

/// Returns the log with outcomes drawn again, and the NLL of each event under its true probability.
fn noisy(log: &EventLog, noise: f64, seed: u64) -> anyhow::Result<(EventLog, Vec<f64>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let half_s = half_time_s(log);
    let mut log = log.clone();
    let truth = log.true_probability.take().context("no true probabilities")?;
    let mut nll = Vec::new();
    for (event, p) in log.events.iter_mut().zip(truth) {
        let log_odds = (p / (1.0 - p)).ln() - if event.time_s > half_s { noise } else { 0.0 };
        let p = 1.0 / (1.0 + (-log_odds).exp());
        event.success = rng.random::<f64>() < p;
        nll.push(-(if event.success { p } else { 1.0 - p }).ln());
    }
    Ok((log, nll))
}

/// Returns the excess NLL of own, team and all events over the truth, for the events after half time.
fn excess(log: &EventLog, truth: &[f64], plan: &Plan) -> anyhow::Result<[f64; 3]> {
    let mission = online(log, plan, TrafficPlan { slot_every: Some(10), piggyback_bytes: 0 }, &|| ())?;
    let half_s = half_time_s(log);
    let first = mission.steps.iter().take_while(|step| step.time_s <= half_s).count();
    let after = first..(first + NEXT).min(truth.len());
    let least = mean(truth[after.clone()].iter().copied());
    let Step { own, team, centralised, .. } = Step::mean(&mission.steps[after]).context("no events")?;
    Ok([own, team, centralised].map(|nll| nll - least))
}

/// Returns the mean of [`excess`] over draws of the outcomes.
fn mean_excess(log: &EventLog, noise: f64, plan: &Plan) -> anyhow::Result<[f64; 3]> {
    let draw = |seed| {
        let (log, truth) = noisy(log, noise, seed)?;
        excess(&log, &truth, plan)
    };
    Ok(column_means(&(1..=DRAWS).into_par_iter().map(draw).collect::<anyhow::Result<Vec<_>>>()?))
}

/// Returns the model learned from an earlier mission in the same area.
fn model_of_earlier_mission(log: &EventLog, noise: f64) -> anyhow::Result<Preshared> {
    let (earlier, _) = noisy(log, noise, DRAWS + 1)?;
    let events: Vec<&Event> = earlier.events.iter().collect();
    Ok(Preshared::Model(learn(&Learning::default(), log.chart(), log.inputs(), &events)?.best.model))
}
