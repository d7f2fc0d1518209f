//! Measures the benefit of optional terms. For each split the program prints the accepted terms and the NLL of held-out
//! events. Predictions use all events in one place, each vehicle's own events (mean), or those of the team after
//! `packets` packets each.
//!
//! `cargo run --release -p pingmap-trial --example optional_terms -- events.csv splits.csv [packets]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

mod common;

use common::{Failure, log_splits_and_packets};
use pingmap_agent::{Learning, OptionalTerm};
use pingmap_trial::{EventLog, Mission, Plan, Score, Split};
use rayon::prelude::*;

/// Results of one split.
struct Row {
    name: String,
    accepted: String,
    /// NLL of all events in one place, of own events, and of the team.
    nll: [f64; 3],
}

fn row(log: &EventLog, split: &Split, packets: usize) -> Result<Row, Failure> {
    let mission = Mission::prepare(log, split, &Plan::new(Learning::default(), 1), packets)?;
    let nll = |predicted: &[f64]| Score::new(predicted, &mission.outcomes).map_or(f64::NAN, |score| score.nll);
    let mean = |all: Vec<Vec<f64>>| all.iter().map(|predicted| nll(predicted)).sum::<f64>() / all.len() as f64;
    let accepted = mission.fit.iter().flat_map(|fit| fit.structure.additions.iter()).map(OptionalTerm::name);
    Ok(Row {
        name: split.name.clone(),
        accepted: accepted.collect::<Vec<_>>().join(", "),
        nll: [
            nll(&mission.predict_centralised()?),
            mean(mission.predict_alone()?),
            mean(mission.predict_as_team(packets)?),
        ],
    })
}

fn main() -> Result<(), Failure> {
    let (log, splits, packets) = log_splits_and_packets()?;
    let rows = splits.par_iter().map(|split| row(&log, split, packets)).collect::<Result<Vec<Row>, _>>()?;
    println!("split     all     own    team  accepted");
    for Row { name, accepted, nll: [all, own, team] } in &rows {
        println!("{name:5} {all:.4}  {own:.4}  {team:.4}  {accepted}");
    }
    let mean = |place: usize| rows.iter().map(|row| row.nll[place]).sum::<f64>() / rows.len() as f64;
    println!("mean  {:.4}  {:.4}  {:.4}", mean(0), mean(1), mean(2));
    Ok(())
}
