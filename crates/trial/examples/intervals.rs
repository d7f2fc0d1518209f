//! Measures the coverage of 90 % intervals of the probability, learned from all training events.
//!
//! The program compares intervals of the mean field, of expectation propagation, and of vehicles, on held-out links of
//! each trial: two splits of a log, or one split of a simulated trial. It prints the share of true probabilities within
//! 0.01 of the interval: over all links, over the half with lower variance, and over the half with higher variance.
//! Median width and mean interval score (width + 20 · distance outside, lower is better) follow.
//!
//! The factor by which vehicles widen their intervals was chosen on bay3 and on simulated trials with seeds 1 to 20.
//! The simulated trials here have other seeds.
//!
//! `cargo run --release -p pingmap-trial --example intervals -- [events.csv splits.csv]… [number of simulated trials]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

use std::error::Error;
use std::path::Path;

use dgpc::{Latent, success_probability};
use pingmap_agent::{INTERVAL_WIDENING, Learning, PredictOptions};
use pingmap_trial::simulate::{Simulation, Sound};
use pingmap_trial::{Division, EventLog, Mission, Plan, Split, read_splits};
use rayon::prelude::*;

type Failure = Box<dyn Error + Send + Sync>;

/// Coverage over all links, over the half with lower variance, over the half with higher variance; median width;
/// interval score.
type Row = [f64; 5];

const KINDS: [&str; 3] = ["mean field", "expectation propagation", "vehicles"];

/// Simulated trials have seeds above this number.
const SEED: u64 = 100;

const SPLITS: usize = 2;

fn intervals_of(latent: &Latent) -> Vec<(f64, f64)> {
    let end = |mean: f64, reach: f64| success_probability(mean + reach, 0.0);
    let interval = |(&mean, &variance): (&f64, &f64)| {
        let reach = 1.644_854 * variance.sqrt();
        (end(mean, -reach), end(mean, reach))
    };
    latent.mean.iter().zip(&latent.variance).map(interval).collect()
}

fn row(intervals: &[(f64, f64)], truth: &[f64], variance: &[f64]) -> Row {
    let mut order: Vec<usize> = (0..truth.len()).collect();
    order.sort_by(|&a, &b| variance[a].total_cmp(&variance[b]));
    let is_covered = |&n: &usize| (intervals[n].0 - 0.01..=intervals[n].1 + 0.01).contains(&truth[n]);
    let share = |part: &[usize]| part.iter().filter(|n| is_covered(n)).count() as f64 / part.len().max(1) as f64;
    let (low, high) = order.split_at(order.len() / 2);
    let mut widths: Vec<f64> = intervals.iter().map(|(low, high)| high - low).collect();
    let off = |(&(low, high), &p): (&(f64, f64), &f64)| high - low + 20.0 * ((low - p).max(0.0) + (p - high).max(0.0));
    let score = intervals.iter().zip(truth).map(off).sum::<f64>() / truth.len().max(1) as f64;
    widths.sort_by(f64::total_cmp);
    [share(&order), share(low), share(high), widths.get(widths.len() / 2).copied().unwrap_or(0.0), score]
}

fn of_split(log: &EventLog, split: &Split) -> Result<[Row; 3], Failure> {
    let truth = log.true_probability.as_ref().ok_or("no true probabilities")?;
    let truth: Vec<f64> = split.indices(true).into_iter().map(|n| truth[n]).collect();
    let mission = Mission::prepare(log, split, &Plan::new(Learning::default(), 1), 0)?;
    let mut agent = mission.centralised.clone();
    let mut propagated = agent.interval_latent(&mission.held_out)?;
    propagated.variance.iter_mut().for_each(|variance| *variance /= INTERVAL_WIDENING * INTERVAL_WIDENING);
    let predictions = agent.predict(&mission.held_out, PredictOptions::with_intervals())?;
    let of_vehicle = predictions.iter().filter_map(|prediction| prediction.interval).collect();
    let all = [intervals_of(&mission.latent(&agent)?), intervals_of(&propagated), of_vehicle];
    Ok(all.map(|intervals| row(&intervals, &truth, &propagated.variance)))
}

fn mean(rows: &[[Row; 3]]) -> [Row; 3] {
    let mean = |kind: usize, column: usize| rows.iter().map(|row| row[kind][column]).sum::<f64>() / rows.len() as f64;
    [0, 1, 2].map(|kind| [0, 1, 2, 3, 4].map(|column| mean(kind, column)))
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let pairs = arguments.chunks_exact(2);
    let simulated: u64 = pairs.remainder().first().map_or(Ok(0), |count| count.parse())?;
    let mut trials: Vec<(String, EventLog, Vec<Split>)> = Vec::new();
    for pair in pairs {
        let log = EventLog::open(Path::new(&pair[0]))?;
        let splits = read_splits(Path::new(&pair[1]), &log)?.into_iter().take(SPLITS).collect();
        trials.push((pair[0].clone(), log, splits));
    }
    for seed in (1..=simulated).map(|n| SEED + n) {
        let (vehicles, slots) = (2 + (seed % 3) as usize, 150 + 50 * (seed % 5) as usize);
        let log = Simulation { seed, vehicles, slots, ..Simulation::default() }.run(&Sound::default())?.log;
        let splits = Division::random(1, 0.35).splits(&log, seed)?;
        trials.push((format!("simulated {seed}"), log, splits));
    }
    let of_trial = |(_, log, splits): &(String, EventLog, Vec<Split>)| {
        let rows = splits.par_iter().map(|split| of_split(log, split)).collect::<Result<Vec<_>, Failure>>()?;
        Ok(mean(&rows))
    };
    let rows = trials.par_iter().map(of_trial).collect::<Result<Vec<_>, Failure>>()?;
    let names = trials.iter().map(|(name, ..)| name.as_str()).chain(["mean over trials"]);
    println!("                            all    low   high  width  score");
    for (name, kinds) in names.zip(rows.iter().copied().chain([mean(&rows)])) {
        println!("{name}");
        for (kind, [all, low, high, width, score]) in KINDS.iter().zip(kinds) {
            println!("  {kind:24} {all:.3}  {low:.3}  {high:.3}  {width:.3}  {score:.3}");
        }
    }
    Ok(())
}
