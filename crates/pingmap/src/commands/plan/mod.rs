//! `pingmap plan`: plans missions with a learned map.

mod common;
pub mod standoff;
pub mod track;
pub mod gateway;

use clap::{Args, Subcommand};

use crate::output::Results;

/// Plan with a map: standoff ranges, reception along a track, and the best gateway
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap plan standoff log.csv --at 700,510\n  pingmap plan track log.csv --at 700,510 --along waypoints.csv\n  pingmap plan gateway log.csv --among places.csv --along waypoints.csv"
)]
pub struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// The range in each direction up to which messages are received
    Standoff(Box<standoff::Options>),
    /// The probability along a planned track, leg by leg, and the longest expected silence
    Track(Box<track::Options>),
    /// The best of several positions for a gateway
    Gateway(Box<gateway::Options>),
}

impl Options {
    pub fn threads(&self) -> usize {
        match &self.action {
            Action::Standoff(options) => options.common.source.work.threads,
            Action::Track(options) => options.common.source.work.threads,
            Action::Gateway(options) => options.common.source.work.threads,
        }
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        match &self.action {
            Action::Standoff(options) => options.run(results),
            Action::Track(options) => options.run(results),
            Action::Gateway(options) => options.run(results),
        }
    }
}
