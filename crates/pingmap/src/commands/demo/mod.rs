//! `pingmap demo`: the paper's scheme and event reports side by side, on a built-in field trial.

mod comparison;
pub mod json;
mod pictures;

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use pingmap_agent::{Learning, Sharing};
use pingmap_trial::paper::Policy;
use pingmap_trial::{Alternative, Division, Plan, built_in};

use super::replay::{Replayed, report};
use crate::cli_parsers::threads;
use crate::log::WholeLog;
use crate::output::{Results, note, print, print_json};
use crate::output_target::{Overwrite, RESULT};
use crate::page::Page;
use json::DemoJson;
use pictures::Pictures;

/// Three vehicles on survey legs in a bay with a ridge and a mound.
const TRIAL: &str = "bay3";

const SEED: u64 = 1;

/// Numbers of packets of every vehicle.
const PACKETS: [usize; 2] = [2, 10];

/// Replay a built-in trial with the paper's scheme and with reports, and write maps
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
        note("Three underwater vehicles record which messages they receive and which they miss. Each vehicle");
        note("fits these events, sends a few packets of 32 bytes, and predicts held-out events.\n");
        let concatenations = Policy::ALL.map(Alternative::Concatenation);
        let plan = Plan {
            calibration: true,
            sharing: Sharing::reports(),
            alternatives: [&concatenations[..], &[Alternative::SummariesOnly]].concat(),
            ..Plan::new(Learning::default(), SEED)
        };
        let splits = Division::random(3, 0.35).splits(&log, SEED)?;
        let whole = WholeLog::of(&log, format!("{TRIAL}, built in"));
        let mission = Replayed::new((log, whole), splits, &PACKETS, plan)?;
        mission.warn();
        let command = results.command().to_vec();
        let rows = comparison::rows(&mission);
        match self.json {
            true => print_json(results, &DemoJson::of(&mission, &rows))?,
            false => print(results, &comparison::text(&mission, &rows))?,
        }
        let pictures = Pictures::draw(&mission, PACKETS[0])?;
        let lead = |page: &mut Page| {
            comparison::section(page, &rows);
            pictures.section(page);
        };
        let page = report::write(&mission, &command, &self.out, &lead)?;
        note(format_args!("report: {}", page.display()));
        Ok(())
    }
}
