//! The files of a fleet: team, model, and one configuration for each vehicle.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use pingmap_agent::{ModelFile, Team, TeamFile, VehicleId};
use pingmap_trial::{EventLog, Plan, TrafficPlan, schedule};
use tempfile::TempDir;

use crate::files::write_file;
use crate::output::BadInput;

/// The files of a fleet.
pub struct Setup {
    pub team: Team,
    /// The configuration file of each vehicle.
    pub configs: BTreeMap<VehicleId, PathBuf>,
    /// The folder that is removed at the end, unless it is kept.
    _temporary: Option<TempDir>,
}

impl Setup {
    /// Writes the files for the mission of a log into a folder. Without a folder they are removed at the end.
    pub fn write(log: &EventLog, plan: &Plan, traffic: TrafficPlan, keep: Option<&Path>) -> anyhow::Result<Self> {
        let (team, _) = plan.team(log, None)?;
        let slots = schedule(log).ok_or_else(|| {
            unusable("the log has no regular slots, which vehicles need; `pingmap replay --online` needs none")
        })?;
        let piggyback = if traffic.piggyback_bytes > 0 { Some(true) } else { team.piggyback };
        let team = Team { slots, piggyback, ..team };
        let temporary = keep.is_none().then(tempfile::tempdir).transpose().context("a temporary folder")?;
        let folder = temporary.as_ref().map(TempDir::path).or(keep).unwrap_or(Path::new("."));
        if folder.read_dir().is_ok_and(|mut entries| entries.next().is_some()) {
            return Err(unusable(&format!("{}: expected a new or empty folder", folder.display())));
        }
        std::fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
        let model = ModelFile { model: team.model.clone(), learned: None, site_log_digests: Vec::new() };
        write_file(&folder.join("model.toml"), model.write()?.as_bytes())?;
        let text = TeamFile::write(&team, "model.toml", None, None).map_err(|error| unusable(&error.to_string()))?;
        write_file(&folder.join("team.toml"), text.as_bytes())?;
        let mut configs = BTreeMap::new();
        for (number, id) in team.members.iter() {
            let config = folder.join(format!("vehicle-{number}.toml"));
            write_file(
                &config,
                config_text(*number, id, team.slots.duration_s, traffic.slot_every.is_some()).as_bytes(),
            )?;
            configs.insert(id.clone(), config);
        }
        Ok(Self { team, configs, _temporary: temporary })
    }
}

fn config_text(number: u8, id: &VehicleId, slot_s: f64, sends_frames: bool) -> String {
    // Every own transmission of the log is reported. Names of vehicles may not be valid in file names.
    let lines = [
        "schema = 1".to_owned(),
        format!("vehicle = {}", toml::Value::String(id.to_string())),
        "team = \"team.toml\"".to_owned(),
        format!("store.path = \"vehicle-{number}.redb\""),
        format!("store.snapshot = \"vehicle-{number}.snapshot\""),
        "navigation.interval_s = 0.0".to_owned(),
        // The clock moves from slot to slot. A few slots may have no event.
        format!("clock.gap_s = {:?}", (3.0 * slot_s).max(30.0)),
        // All receptions of a slot arrive before the next slot. Slots that are counted later are predicted with the
        // frames of later slots, too.
        "slots.settle_s = 0.0".to_owned(),
        // Without frames nothing tells the team about unused slots, and the log has none.
        format!("slots.reports_transmissions = {sends_frames}"),
        "log.level = \"warn\"".to_owned(),
    ];
    lines.join("\n") + "\n"
}

/// Returns the error for a log that processes cannot run.
fn unusable(problem: &str) -> anyhow::Error {
    BadInput(problem.into()).into()
}
