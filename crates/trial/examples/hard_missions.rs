//! Measures a team in two hard missions: with a deaf member, and with noise that rises during the mission.
//!
//! * A deaf vehicle travels 50 m from the last receiver of the log and misses everything. The program prints the NLL of
//!   the others with and without it, over the splits.
//! * The outcomes of the log are drawn again from its true probabilities. From half time on the log-odds are 2.5 lower.
//!   The program prints the excess NLL of the next 35 events over the true probabilities, predicted during the mission,
//!   mean over ten draws. The team has no model, or that of an earlier mission in the same area, in which noise rose as
//!   well. Two more rows are without rising noise, for comparison.
//!
//! `cargo run --release -p pingmap-trial --example hard_missions -- events.csv splits.csv [packets]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

mod common;

use common::{Failure, log_splits_and_packets};
use pingmap_agent::{Event, Learning, VehicleId};
use pingmap_trial::{Agreed, EventLog, Mission, Plan, Riding, Score, Split, Step, learn_best, online};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Distance of the deaf vehicle from its neighbour.
const DISTANCE_M: f64 = 50.0;

/// Decrease of the log-odds at half time.
const NOISE: f64 = 2.5;

/// Number of events after half time.
const NEXT: usize = 35;

/// Number of draws of the outcomes.
const DRAWS: u64 = 10;

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
            let mut missed = Event { receiver_id: VehicleId::new("deaf"), success: false, ..event.clone() };
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

/// Returns the NLL of all events in one place, of own events and of the team. The last two are means over the vehicles
/// of the log.
fn scores(log: &EventLog, split: &Split, vehicles: usize, packets: usize) -> Result<[f64; 3], Failure> {
    let mission = Mission::prepare(log, split, &Plan::new(Learning::default(), 1), packets)?;
    let nll = |predicted: &Vec<f64>| Score::new(predicted, &mission.outcomes).map_or(f64::NAN, |score| score.nll);
    let names = log.vehicles();
    let mean = |all: Vec<Vec<f64>>| {
        let of_log = all.iter().zip(&names).filter(|(_, name)| name.as_str() != "deaf");
        of_log.map(|(predicted, _)| nll(predicted)).sum::<f64>() / vehicles as f64
    };
    Ok([nll(&mission.predict_centralised()?), mean(mission.predict_alone()?), mean(mission.predict_as_team(packets)?)])
}

fn mean_scores(log: &EventLog, splits: &[Split], vehicles: usize, packets: usize) -> Result<[f64; 3], Failure> {
    let all = splits.par_iter().map(|split| scores(log, split, vehicles, packets)).collect::<Result<Vec<_>, _>>()?;
    Ok(mean(&all))
}

fn mean(all: &[[f64; 3]]) -> [f64; 3] {
    [0, 1, 2].map(|place| all.iter().map(|three| three[place]).sum::<f64>() / all.len() as f64)
}

/// Returns the log with outcomes drawn again, and the NLL of each event under its true probability.
fn noisy(log: &EventLog, noise: f64, seed: u64) -> Option<(EventLog, Vec<f64>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let half_s = log.events.iter().map(|event| event.time_s).fold(0.0, f64::max) / 2.0;
    let mut log = log.clone();
    let truth = log.true_probability.take()?;
    let mut nll = Vec::new();
    for (event, p) in log.events.iter_mut().zip(truth) {
        let log_odds = (p / (1.0 - p)).ln() - if event.time_s > half_s { noise } else { 0.0 };
        let p = 1.0 / (1.0 + (-log_odds).exp());
        event.success = rng.random::<f64>() < p;
        nll.push(-(if event.success { p } else { 1.0 - p }).ln());
    }
    Some((log, nll))
}

/// Returns the excess NLL of own, team and all events over the truth, for the events after half time.
fn excess(log: &EventLog, truth: &[f64], plan: &Plan) -> Result<[f64; 3], Failure> {
    let mission = online(log, plan, Riding { slot_every: Some(10), piggyback_bytes: 0 }, &|| ())?;
    let half_s = log.events.iter().map(|event| event.time_s).fold(0.0, f64::max) / 2.0;
    let first = mission.steps.iter().take_while(|step| step.time_s <= half_s).count();
    let after = first..(first + NEXT).min(truth.len());
    let least = truth[after.clone()].iter().sum::<f64>() / after.len() as f64;
    let Step { own, team, centralised, .. } = Step::mean(&mission.steps[after]).ok_or("no events")?;
    Ok([own, team, centralised].map(|nll| nll - least))
}

/// Returns the mean of [`excess`] over draws of the outcomes.
fn mean_excess(log: &EventLog, noise: f64, plan: &Plan) -> Result<[f64; 3], Failure> {
    let draw = |seed| {
        let (log, truth) = noisy(log, noise, seed).ok_or("no true probabilities")?;
        excess(&log, &truth, plan)
    };
    Ok(mean(&(1..=DRAWS).into_par_iter().map(draw).collect::<Result<Vec<_>, Failure>>()?))
}

/// Returns the model learned from an earlier mission in the same area.
fn model_of_earlier_mission(log: &EventLog, noise: f64) -> Result<Agreed, Failure> {
    let (earlier, _) = noisy(log, noise, DRAWS + 1).ok_or("no true probabilities")?;
    let events: Vec<&Event> = earlier.events.iter().collect();
    Ok(Agreed::Model(learn_best(&Learning::default(), log.chart(), log.inputs(), &events)?.model))
}

fn main() -> Result<(), Failure> {
    let (log, splits, packets) = log_splits_and_packets()?;
    let vehicles = log.vehicles().len();
    println!("                              all     own     team");
    let [all, own, team] = mean_scores(&log, &splits, vehicles, packets)?;
    println!("original log               {all:.4}  {own:.4}  {team:.4}");
    let (deaf, splits) = with_a_deaf_vehicle(&log, &splits);
    let [all, own, team] = mean_scores(&deaf, &splits, vehicles, packets)?;
    println!("with a deaf vehicle        {all:.4}  {own:.4}  {team:.4}");
    for (noise, name) in [(NOISE, "rising noise"), (0.0, "constant noise")] {
        let without = Plan::new(Learning::default(), 1);
        let with = Plan { agreed: model_of_earlier_mission(&log, noise)?, ..without.clone() };
        for (model, plan) in [("no model", without), ("with model", with)] {
            let [own, team, all] = mean_excess(&log, noise, &plan)?;
            println!("{:26} {all:+.4} {own:+.4} {team:+.4}", format!("{name}, {model}"));
        }
    }
    Ok(())
}
