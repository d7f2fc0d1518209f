//! `pingmap store export`: the events of a store as an event log.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use pingmap_agent::{Event, VehicleId};
use pingmap_import::Reference;
use pingmap_packet::to_hex;
use pingmap_trial::EventLog;
use pingmap_vehicle::{Vehicle, VehicleConfig, read_store};

use crate::options::RESULT;
use crate::output::{BadInput, Results, count, note};
use crate::output_target::Overwrite;
use crate::team::read_team;

/// Write the vehicle's own events in a store as an event log. The store is not changed
#[derive(Args)]
#[command(after_long_help = "Example:\n  pingmap store export auv1.redb --team team.toml -o exported.csv")]
pub struct Options {
    /// The store. No vehicle may have it open
    #[arg(value_name = "FILE")]
    store: PathBuf,
    /// Team file of the vehicle
    #[arg(long, value_name = "FILE", default_value = "team.toml")]
    team: PathBuf,
    /// File for the events
    #[arg(help_heading = RESULT, long, short, value_name = "FILE", default_value = "-")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

impl Options {
    pub fn run(&self, results: Results) -> anyhow::Result<()> {
        let target = self.overwrite.target(&self.output, &[&self.store, &self.team])?;
        let bad = |error: &dyn std::fmt::Display| BadInput(format!("{}: {error}", self.store.display()));
        let (identity, contents) = read_store(&self.store).map_err(|error| BadInput(error.to_string()))?;
        let team = read_team(&self.team)?;
        if team.digest() != identity.team_digest {
            let (found, expected) = (to_hex(&team.digest()), to_hex(&identity.team_digest));
            let message = format!("{}: the team has the digest {found}, expected {expected}", self.team.display());
            return Err(BadInput(message).into());
        }
        let reference_system = team.model.chart.reference;
        let reference = Reference::new(reference_system).map_err(|error| bad(&error))?;
        let config = VehicleConfig::new(VehicleId::new(identity.vehicle), self.team.clone());
        let vehicle = Vehicle::restore(config, Arc::new(team), reference, &contents).map_err(|error| bad(&error))?;
        let events: Vec<Event> = vehicle.counting_events().cloned().collect();
        let ends = || events.iter().flat_map(|event| event.link.ends());
        let log = EventLog {
            has_depths: ends().all(|end| end.depth_m.is_some()),
            has_headings: ends().any(|end| end.heading_deg.is_some()),
            true_probability: None,
            unknown_columns: Vec::new(),
            reference: reference_system,
            events,
        };
        target.write_or_print(&log.to_csv(), results)?;
        note(format_args!("{} of {}", count(log.events.len(), "event"), vehicle.id()));
        Ok(())
    }
}
