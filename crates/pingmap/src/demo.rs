//! `pingmap demo`: a replay of the field trial that is built in.

use std::path::Path;

use pingmap_agent::Learning;
use pingmap_trial::{EventLog, Plan, draw_splits};

use crate::cli;
use crate::output::{note, use_threads};
use crate::replay::Replayed;
use crate::report;

/// Three vehicles on survey legs in a bay with a ridge and a mound (`data/README.md`).
const TRIAL: &[u8] = include_bytes!("../../../data/bay3.csv");

const SEED: u64 = 1;

pub fn run(options: &cli::Demo) -> anyhow::Result<()> {
    use_threads(options.threads)?;
    report::make_folder(&options.out)?;
    let log = EventLog::read(TRIAL, Path::new("bay3.csv (built in)"))?;
    note("Three underwater vehicles record which of each other's messages they hear. Each learns from the events it");
    note("received, sends a few packets that sum them up, and predicts events that nobody learned from.\n");
    let plan = Plan::new(Learning::default(), SEED);
    let splits = draw_splits(&log, 3, 0.35, SEED)?;
    let events = log.events.len();
    let mission = Replayed::new(log, events, splits, &[1, 2, 5, 10, 20], plan)?;
    mission.show(options.json, Some(&options.out))
}
