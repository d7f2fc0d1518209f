//! Coverage of intervals of the probability.

use std::io::Write;

use clap::Args;
use dgpc::{Latent, success_probability};
use pingmap_agent::{INTERVAL_WIDENING, Learning};
use pingmap_trial::simulate::{Simulation, Sound};
use pingmap_trial::{Division, EventLog, Mission, Plan, Split};
use rayon::prelude::*;

use crate::arguments::LogFiles;
use crate::statistics::{column_means, columns, mean};

/// Coverage over all links, over the half with lower variance, over the half with higher variance; median width;
/// interval score. Then the share of links that a map does not hatch, and the share of these outside their interval.
type Row = [f64; 7];

const KINDS: [&str; 3] = ["mean field", "expectation propagation", "vehicles"];

/// Simulated trials have seeds above this number.
const SEED: u64 = 100;

const SPLITS: usize = 2;

/// Quantile of the normal distribution for intervals of 90 %.
const QUANTILE: f64 = 1.644_854;

/// Widest interval that a map does not hatch.
const HATCH_WIDTH: f64 = 0.5;

/// Measures the coverage of 90 % intervals of the probability, learned from all training events.
///
/// The program compares intervals of the mean field, of expectation propagation, and of vehicles, on held-out links of
/// each trial: two splits of a log, or one split of a simulated trial. The table has the share of true probabilities
/// within 0.01 of the interval: over all links, over the half with lower variance, and over the half with higher
/// variance. Median width and mean interval score (width + 20 · distance outside, lower is better) follow. Maps do
/// not hatch links whose interval is at most 0.5 wide. The last two columns are the share of these links, and the share
/// of them whose true probability is not within 0.01 of the interval.
///
/// The factor by which vehicles widen their intervals was chosen on bay3 and on simulated trials with seeds 1 to 20.
/// The simulated trials here have other seeds.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Event logs with true probabilities, and their splits
    #[arg(value_name = "EVENTS:SPLITS", required_unless_present = "simulated")]
    logs: Vec<LogFiles>,
    /// Number of simulated trials
    #[arg(long, default_value_t = 0)]
    simulated: u64,
}

struct Trial {
    name: String,
    log: EventLog,
    splits: Vec<Split>,
}

impl Trial {
    fn read(files: &LogFiles) -> anyhow::Result<Self> {
        let (log, mut splits) = files.read()?;
        splits.truncate(SPLITS);
        Ok(Self { name: files.events.display().to_string(), log, splits })
    }

    fn simulate(seed: u64) -> anyhow::Result<Self> {
        let (vehicles, slots) = (2 + (seed % 3) as usize, 150 + 50 * (seed % 5) as usize);
        let log = Simulation { seed, vehicles, slots, ..Simulation::default() }.run(&Sound::default())?.log;
        let splits = Division::random(1, 0.35).splits(&log, seed)?;
        Ok(Self { name: format!("simulated {seed}"), log, splits })
    }

    /// Returns the mean over splits for each kind of interval.
    fn measure(&self) -> anyhow::Result<[Row; 3]> {
        let rows = self.splits.par_iter().map(|split| measure(&self.log, split));
        Ok(kind_means(&rows.collect::<anyhow::Result<Vec<_>>>()?))
    }
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let logs = self.logs.iter().map(Trial::read);
        let simulated = (1..=self.simulated).map(|n| Trial::simulate(SEED + n));
        let trials = logs.chain(simulated).collect::<anyhow::Result<Vec<_>>>()?;
        let rows = trials.par_iter().map(Trial::measure).collect::<anyhow::Result<Vec<_>>>()?;
        let names = trials.iter().map(|trial| trial.name.as_str()).chain(["mean over trials"]);
        writeln!(out, "                            all    low   high  width  score   open    out")?;
        for (name, kinds) in names.zip(rows.iter().copied().chain([kind_means(&rows)])) {
            writeln!(out, "{name}")?;
            for (kind, row) in KINDS.iter().zip(kinds) {
                writeln!(out, "  {kind:24} {}", columns(&row, 3))?;
            }
        }
        Ok(())
    }
}

fn measure(log: &EventLog, split: &Split) -> anyhow::Result<[Row; 3]> {
    let truth = log.true_probability.as_ref().ok_or_else(|| anyhow::anyhow!("no true probabilities"))?;
    let truth: Vec<f64> = split.indices(true).into_iter().map(|n| truth[n]).collect();
    let mission = Mission::prepare(log, split, &Plan::new(Learning::default(), 1), 0)?;
    let mut agent = mission.centralised.clone();
    let mut propagated = mission.interval_latent(&agent)?;
    propagated.variance.iter_mut().for_each(|variance| *variance /= INTERVAL_WIDENING * INTERVAL_WIDENING);
    let predictions = agent.predict_intervals(&mission.held_out)?;
    let of_vehicle =
        predictions.iter().filter_map(|prediction| prediction.interval).map(|ends| (ends.low, ends.high)).collect();
    let all = [intervals(&mission.latent(&agent)?), intervals(&propagated), of_vehicle];
    Ok(all.map(|intervals| row(&intervals, &truth, &propagated.variance)))
}

fn kind_means(rows: &[[Row; 3]]) -> [Row; 3] {
    std::array::from_fn(|kind| column_means(&rows.iter().map(|row| row[kind]).collect::<Vec<_>>()))
}

fn intervals(latent: &Latent) -> Vec<(f64, f64)> {
    let end = |mean: f64, reach: f64| success_probability(mean + reach, 0.0);
    let interval = |(&mean, &variance): (&f64, &f64)| {
        let reach = QUANTILE * variance.sqrt();
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
    let score = mean(intervals.iter().zip(truth).map(off));
    let open: Vec<usize> = order.iter().copied().filter(|&n| widths[n] <= HATCH_WIDTH).collect();
    let outside = if open.is_empty() { 0.0 } else { 1.0 - share(&open) };
    let open_share = open.len() as f64 / order.len().max(1) as f64;
    widths.sort_by(f64::total_cmp);
    let width = widths.get(widths.len() / 2).copied().unwrap_or(0.0);
    [share(&order), share(low), share(high), width, score, open_share, outside]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_width_and_score_are_those_of_the_intervals() {
        let intervals = [(0.1, 0.3), (0.4, 0.8), (0.0, 1.0), (0.5, 0.6)];
        let truth = [0.2, 0.805, 0.5, 0.3];
        // The second probability is within 0.01 of its interval. The fourth is 0.2 below its interval.
        let [all, low, high, width, score, open, outside] = row(&intervals, &truth, &[1.0, 2.0, 3.0, 4.0]);
        assert_eq!((all, low, high, width), (0.75, 1.0, 0.5, 0.4));
        // Three intervals are narrow, and the fourth probability is outside one of them.
        assert_eq!(open, 0.75);
        assert!((outside - 1.0 / 3.0).abs() < 1e-12, "{outside}");
        assert!((score - (1.7 + 20.0 * (0.005 + 0.2)) / 4.0).abs() < 1e-12, "{score}");
    }
}
