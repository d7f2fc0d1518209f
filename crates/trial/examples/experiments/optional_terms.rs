//! Benefit of optional terms.

use std::io::Write;

use clap::Args;
use pingmap_agent::{Learning, OptionalTerm};
use pingmap_trial::{Plan, SplitSummary, replay};

use crate::arguments::Exchange;
use crate::statistics::{column_means, columns};

/// Measures the benefit of optional terms.
///
/// For each split the table has the NLL of held-out events and the accepted terms. Predictions use all events in one
/// place, each vehicle's own events (mean), or those of the team after the packets of each vehicle.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    exchange: Exchange,
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let (log, splits) = self.exchange.log.read()?;
        let plan = Plan::new(Learning::default(), 1);
        let replayed = replay(&log, &splits, &[self.exchange.packets], &plan, &|| ())?;
        let nlls: Vec<[f64; 3]> = replayed.splits.iter().map(nlls).collect();
        writeln!(out, "split     all     own    team  accepted")?;
        for (split, nlls) in replayed.splits.iter().zip(&nlls) {
            writeln!(out, "{:5} {}  {}", split.name, columns(nlls, 4), accepted(split))?;
        }
        writeln!(out, "mean  {}", columns(&column_means(&nlls), 4))?;
        Ok(())
    }
}

/// Returns the NLL of all events in one place, of own events, and of the team.
fn nlls(split: &SplitSummary) -> [f64; 3] {
    [split.nll.centralised, split.nll.own, split.nll.team[0]]
}

/// Returns the names of the accepted terms.
fn accepted(split: &SplitSummary) -> String {
    let terms = split.fit.iter().flat_map(|fit| fit.structure.additions.iter()).map(OptionalTerm::name);
    terms.collect::<Vec<_>>().join(", ")
}
