//! The team file, `team.toml`. Unknown keys are refused, so that a misspelt key is not replaced by a default.

use std::collections::BTreeMap;

use pingmap_packet::Key;
use serde::{Deserialize, Serialize};

use crate::model::file::model_file::parse_versioned;
use crate::model::link_model::Model;
use crate::team::config::{DEFAULT_TRACK_TOLERANCE_CELLS, TEAM_SCHEMA, Team, TeamError};
use crate::team::grid::Grid;
use crate::team::members::Members;
use crate::team::slots::Slots;
use crate::types::bounds::{self, Bounds};
use crate::types::event::VehicleId;
use crate::types::limits::Limits;

/// Content of `team.toml`. The model and the key have their own files, whose names it contains. Keys that the text
/// leaves out have the defaults of [`Team::new`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeamFile {
    schema: u32,
    /// Name of the file of the packet model.
    pub model_file: String,
    /// Name of the file of the team's key, which has 64 hexadecimal digits. `None` for plain packets.
    pub key_file: Option<String>,
    /// [`crate::Provenance::log_digest`] of the model, for information. It is not part of the team configuration.
    pub log_digest: Option<String>,
    epoch: Option<u32>,
    frame_bytes: Option<usize>,
    packets_per_sender_max: Option<u16>,
    reports_per_sender_max: Option<u16>,
    transmissions_max: Option<u8>,
    piggyback: Option<bool>,
    track_tolerance_m: Option<f64>,
    extrapolation_s_max: Option<f64>,
    min_gain_nats: Option<f64>,
    exclusion_threshold_sd: Option<f64>,
    members: BTreeMap<VehicleId, u8>,
    grid: Grid,
    #[serde(default)]
    slots: Slots,
    #[serde(default)]
    limits: Limits,
}

impl TeamFile {
    /// Parses the text of a team file. [`TeamFile::team`] checks the values.
    ///
    /// # Errors
    /// [`TeamError::Syntax`], [`TeamError::Newer`] or [`TeamError::Older`].
    pub fn parse(text: &str) -> Result<Self, TeamError> {
        parse_versioned(text, TEAM_SCHEMA, TeamError::Syntax, TeamError::Newer, TeamError::Older)
    }

    /// Returns the text of the team file. `model_file` and `key_file` are the names of the other files, and
    /// `log_digest` identifies the log from which the model was learned.
    ///
    /// # Errors
    /// [`TeamError::Unwritable`] for a team that no file can represent.
    pub fn write(
        team: &Team,
        model_file: &str,
        key_file: Option<&str>,
        log_digest: Option<&str>,
    ) -> Result<String, TeamError> {
        let file = |team: &Team| Self {
            schema: TEAM_SCHEMA,
            model_file: model_file.to_owned(),
            key_file: key_file.map(str::to_owned),
            log_digest: log_digest.map(str::to_owned),
            epoch: Some(team.epoch),
            frame_bytes: Some(team.frame_bytes),
            packets_per_sender_max: Some(team.packets_per_sender_max),
            reports_per_sender_max: Some(team.reports_per_sender_max),
            transmissions_max: Some(team.transmissions_max),
            piggyback: team.piggyback,
            track_tolerance_m: Some(team.track_tolerance_m),
            extrapolation_s_max: Some(team.extrapolation_s_max),
            min_gain_nats: Some(team.min_gain_nats),
            exclusion_threshold_sd: Some(team.exclusion_threshold_sd),
            members: team.members.iter().map(|(&number, name)| (name.clone(), number)).collect(),
            grid: team.grid,
            slots: team.slots.clone(),
            limits: team.limits,
        };
        let unwritable = |problem: &dyn std::fmt::Display| TeamError::Unwritable(problem.to_string());
        let text = toml::to_string(&file(team)).map_err(|error| unwritable(&error))?;
        if key_file.is_some() != team.key.is_some() {
            return Err(unwritable(&"a key needs the name of a key file, and the name of a key file needs a key"));
        }
        let again = Self::parse(&text).and_then(|file| file.team(team.model.clone(), team.key.clone()));
        let again = again.map_err(|error| unwritable(&error))?;
        if again.canonical_bytes() != team.canonical_bytes() || file(&again) != file(team) {
            return Err(unwritable(&"the text does not give an equal team"));
        }
        Ok(text)
    }

    /// Returns the team, given the contents of the model file and the key file.
    ///
    /// # Errors
    /// [`TeamError`] for a value out of range, with its key and the expected range. [`TeamError`] for invalid members,
    /// slots or frames.
    pub fn team(&self, model: Model, key: Option<Key>) -> Result<Team, TeamError> {
        let mut members = BTreeMap::new();
        for (second, &number) in &self.members {
            if let Some(first) = members.insert(number, second.clone()) {
                return Err(TeamError::SameNumber { number, first, second: second.clone() });
            }
        }
        let default = Team::new(members.values().cloned(), model, [])?;
        let default = match self.frame_bytes {
            Some(frame_bytes) => default.with_frames(frame_bytes),
            None => default,
        };
        let tolerance_m = DEFAULT_TRACK_TOLERANCE_CELLS * self.grid.cell_m;
        let order = if self.slots.order.is_empty() { &default.slots.order } else { &self.slots.order };
        let team = Team {
            slots: Slots { order: order.clone(), ..self.slots.clone() },
            members: Members::new(members),
            grid: self.grid,
            key,
            epoch: self.epoch.unwrap_or(default.epoch),
            packets_per_sender_max: self.packets_per_sender_max.unwrap_or(default.packets_per_sender_max),
            reports_per_sender_max: self.reports_per_sender_max.unwrap_or(default.reports_per_sender_max),
            transmissions_max: self.transmissions_max.unwrap_or(default.transmissions_max),
            piggyback: self.piggyback,
            track_tolerance_m: self.track_tolerance_m.unwrap_or(tolerance_m),
            extrapolation_s_max: self.extrapolation_s_max.unwrap_or(default.extrapolation_s_max),
            min_gain_nats: self.min_gain_nats.unwrap_or(default.min_gain_nats),
            exclusion_threshold_sd: self.exclusion_threshold_sd.unwrap_or(default.exclusion_threshold_sd),
            limits: self.limits,
            ..default
        };
        check(&team)?;
        Ok(team)
    }
}

/// Checks the schedule and all numbers of a team.
fn check(team: &Team) -> Result<(), TeamError> {
    let is_known = |name: &&VehicleId| name.as_str().is_empty() || team.is_member(name);
    if let Some(name) = team.slots.order.iter().find(|name| !is_known(name)) {
        return Err(TeamError::UnknownMember(name.clone()));
    }
    team.layout(team.frame_bytes)?;
    let numbers: [(&str, Bounds, f64); 13] = [
        ("grid.cell_m", bounds::LENGTH_M, team.grid.cell_m),
        ("grid.depth_cell_m", bounds::LENGTH_M, team.grid.depth_cell_m),
        ("grid.start_s", bounds::TIME_S, team.grid.start_s),
        ("grid.time_cell_s", bounds::SLOT_S, team.grid.time_cell_s),
        ("slots.start_s", bounds::TIME_S, team.slots.start_s),
        ("slots.duration_s", bounds::SLOT_S, team.slots.duration_s),
        ("frame_bytes", bounds::FRAME_BYTES, team.frame_bytes as f64),
        ("packets_per_sender_max", bounds::WINDOW, team.packets_per_sender_max.into()),
        ("reports_per_sender_max", bounds::WINDOW, team.reports_per_sender_max.into()),
        ("track_tolerance_m", bounds::LENGTH_M, team.track_tolerance_m),
        ("extrapolation_s_max", bounds::EXTRAPOLATION_S, team.extrapolation_s_max),
        ("min_gain_nats", bounds::MIN_GAIN_NATS, team.min_gain_nats),
        ("exclusion_threshold_sd", bounds::EXCLUSION_THRESHOLD, team.exclusion_threshold_sd),
    ];
    let numbers = numbers.into_iter().map(|(key, bounds, value)| (key.to_owned(), bounds, value));
    let limits = team.limits.entries().map(|(name, limit, bounds)| (format!("limits.{name}"), bounds, limit as f64));
    match numbers.chain(limits).find(|(_, bounds, value)| bounds.check(*value).is_none()) {
        Some((key, expected, value)) => Err(TeamError::OutOfRange { key, expected, value }),
        None => Ok(()),
    }
}
