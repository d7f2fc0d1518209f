//! `pingmap store`: looks into the store of a vehicle.

pub mod check;
pub mod export;

use clap::{Args, Subcommand};

use crate::output::Results;

/// Look into the store of a vehicle: check it, or export its events
#[derive(Args)]
#[command(
    after_long_help = "Examples:\n  pingmap store check auv1.redb\n  pingmap store export auv1.redb --team team.toml -o exported.csv"
)]
pub struct Options {
    #[command(subcommand)]
    action: Action,
}

#[derive(Subcommand)]
enum Action {
    /// Verify every checksum, and print what the store holds
    Check(check::Options),
    /// Write the vehicle's own events as an event log
    Export(export::Options),
}

impl Options {
    pub fn threads(&self) -> usize {
        1
    }

    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        match &self.action {
            Action::Check(options) => options.run(results),
            Action::Export(options) => options.run(results),
        }
    }
}
