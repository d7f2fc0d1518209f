//! `pingmap fleet`: one process for each vehicle of a mission, and one parent that is water and host.

pub mod json;
mod mission;
mod process;
mod report;
mod setup;

use std::path::PathBuf;

use anyhow::Context;
use clap::Args;
use pingmap_agent::{Learning, OptionalTerm};
use pingmap_trial::{EventLog, Plan, TrafficPlan, built_in, online};

use crate::cli_parsers::{packets, piggyback_bytes};
use crate::log::open_log;
use crate::options::RESULT;
use crate::output::{Results, note, print_json, print_text, progress};
use json::FleetJson;
use mission::Mission;
use setup::Setup;

/// The built-in trial that is used without a log.
const TRIAL: &str = "bay3";

/// Seed of the comparison.
const SEED: u64 = 1;

/// Run a mission with one process for each vehicle, as at sea
///
/// Half-way one process is killed and started again. This program is the water and the hosts. Time runs as fast as the
/// vehicles answer.
#[derive(Args)]
#[command(after_help = "Examples:\n  pingmap fleet\n  pingmap fleet log.csv --slot-every 10 --keep fleet")]
pub struct Options {
    /// Event log of the mission, with transmissions in slots; a built-in field trial if not given
    #[arg(value_name = "LOG")]
    pub log: Option<PathBuf>,
    /// Bytes in every transmission for the newest outcomes of its sender; 0 for none
    #[arg(long, value_name = "BYTES", default_value = "2", value_parser = bytes_or_none)]
    pub piggyback_bytes: usize,
    /// A vehicle may send a frame with every N-th of its transmissions; no frames if not given
    #[arg(long, value_name = "TRANSMISSIONS", value_parser = packets)]
    pub slot_every: Option<usize>,
    /// Kill no process
    #[arg(long)]
    pub no_kill: bool,
    /// Folder for the configurations and stores of the vehicles, which are then kept; it must be new or empty
    #[arg(help_heading = RESULT, long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(help_heading = RESULT, long)]
    pub json: bool,
    /// Program that runs the vehicles; this program if not given
    #[arg(long, value_name = "FILE")]
    pub program: Option<PathBuf>,
}

impl Options {
    pub fn threads(&self) -> usize {
        0
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let (log, name) = self.open()?;
        let plan = plan();
        let traffic = TrafficPlan { slot_every: self.slot_every, piggyback_bytes: self.piggyback_bytes };
        let setup = Setup::write(&log, &plan, traffic, self.keep.as_deref())?;
        let program =
            self.program.clone().map_or_else(std::env::current_exe, Ok).context("the path of this program")?;
        let mut mission = Mission::start(&log, &setup, traffic, &program)?;
        let bar = progress(log.events.len() as u64, "running one process for each vehicle");
        mission.run(!self.no_kill, &|| bar.inc(1))?;
        bar.finish_and_clear();
        let outcome = mission.finish()?;
        let replayed = online(&log, &plan, traffic, &|| ())?;
        match self.json {
            true => print_json(results, &FleetJson::of(&log, &outcome, &replayed))?,
            false => print_text(results, &report::text(&name, &outcome, &replayed))?,
        }
        if let Some(folder) = &self.keep {
            note(format_args!("configurations and stores: {}", folder.display()));
        }
        Ok(())
    }

    fn open(&self) -> anyhow::Result<(EventLog, String)> {
        match &self.log {
            None => Ok((built_in(TRIAL).context("the trial is built in")??, format!("{TRIAL}, built in"))),
            Some(path) => Ok((open_log(path, false)?, path.display().to_string())),
        }
    }
}

/// The prior of a team without any events, as in `replay --online`.
fn plan() -> Plan {
    let learning = Learning { additions: OptionalTerm::ALL.to_vec(), ..Learning::default() };
    Plan::new(learning, SEED)
}

/// Parses a number of piggybacked bytes. 0 means none.
fn bytes_or_none(text: &str) -> Result<usize, String> {
    if text.trim() == "0" { Ok(0) } else { piggyback_bytes(text) }
}
