//! Which additions are taken split by split, and what they are worth: the centralised NLL of held-out events, that of
//! every vehicle alone (mean), and the team's after so many packets of each.
//!
//! `cargo run --release -p pingmap-trial --example additions -- events.csv splits.csv [packets]`

#![allow(clippy::print_stdout, reason = "what it measures is its output")]

mod common;

use common::{Failure, log_splits_and_packets};
use pingmap_agent::{Addition, Learning};
use pingmap_trial::{EventLog, Mission, Plan, Score, Split};
use rayon::prelude::*;

/// What came of one split.
struct Row {
    name: String,
    taken: String,
    /// Of all events in one place, of own events, and of the team.
    nll: [f64; 3],
}

fn row(log: &EventLog, split: &Split, packets: usize) -> Result<Row, Failure> {
    let mission = Mission::prepare(log, split, &Plan::new(Learning::default(), 1), packets)?;
    let nll = |predicted: &[f64]| Score::new(predicted, &mission.outcomes).map_or(f64::NAN, |score| score.nll);
    let mean = |all: Vec<Vec<f64>>| all.iter().map(|predicted| nll(predicted)).sum::<f64>() / all.len() as f64;
    let taken = mission.fit.iter().flat_map(|fit| fit.structure.additions.iter()).map(Addition::name);
    Ok(Row {
        name: split.name.clone(),
        taken: taken.collect::<Vec<_>>().join(", "),
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
    println!("split     all     own    team  taken");
    for Row { name, taken, nll: [all, own, team] } in &rows {
        println!("{name:5} {all:.4}  {own:.4}  {team:.4}  {taken}");
    }
    let mean = |place: usize| rows.iter().map(|row| row.nll[place]).sum::<f64>() / rows.len() as f64;
    println!("mean  {:.4}  {:.4}  {:.4}", mean(0), mean(1), mean(2));
    Ok(())
}
