//! `pingmap demo`: replays the built-in field trial.

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use pingmap_agent::Learning;
use pingmap_trial::{Division, Plan, built_in};

use super::replay::Replayed;
use crate::cli_parsers::threads;
use crate::log::WholeLog;
use crate::output::{Results, note};
use crate::output_target::{Overwrite, RESULT};

/// Three vehicles on survey legs in a bay with a ridge and a mound.
const TRIAL: &str = "bay3";

const SEED: u64 = 1;

/// Replay a built-in field trial, print the scores and write a report with maps
#[derive(Args)]
#[command(after_help = "Example:\n  pingmap demo --out report")]
pub struct Options {
    /// Folder for the report
    #[arg(help_heading = RESULT, long, default_value = "pingmap-report", value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub overwrite: Overwrite,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
    /// Worker threads; 0 uses one per core. Results do not depend on it
    #[arg(long, default_value_t = 0, value_parser = threads)]
    pub threads: usize,
}

impl Options {
    pub fn threads(&self) -> usize {
        self.threads
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        self.overwrite.report_folder(&self.out, &[])?;
        let log = built_in(TRIAL).context("the trial is built in")??;
        note(
            "Three underwater vehicles record which of each other's messages they hear. Each learns from the events it",
        );
        note("received, sends a few packets that summarise them, and predicts held-out events.\n");
        let plan = Plan { calibration: true, ..Plan::new(Learning::default(), SEED) };
        let splits = Division::random(3, 0.35).splits(&log, SEED)?;
        let whole = WholeLog::of(&log, format!("{TRIAL}, built in"));
        let mission = Replayed::new((log, whole), splits, &[1, 2, 5, 10, 20], plan)?;
        mission.show(results, self.json, Some(&self.out))
    }
}
