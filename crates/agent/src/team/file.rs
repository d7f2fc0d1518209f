//! The team file, `team.toml`. Unknown keys are refused, so that a misspelt key is not replaced by a default.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use pingmap_packet::Key;
use serde::{Deserialize, Serialize};

use crate::model::link_model::Model;
use crate::team::config::{
    DEFAULT_EXCLUSION_THRESHOLD_SD, DEFAULT_EXTRAPOLATION_S_MAX, DEFAULT_FRAME_BYTES, DEFAULT_MIN_GAIN_NATS,
    DEFAULT_REPORTS_PER_SENDER_MAX, DEFAULT_SLOT_S, DEFAULT_TRACK_TOLERANCE_CELLS, DEFAULT_TRANSMISSIONS_MAX,
    TEAM_SCHEMA, Team, TeamError, default_packets_per_sender_max,
};
use crate::team::grid::{DEFAULT_TIME_CELL_S, Grid};
use crate::team::members::Members;
use crate::team::slots::Slots;
use crate::types::bounds::{self, Bounds};
use crate::types::event::VehicleId;
use crate::types::limits::Limits;

/// Content of `team.toml`. The model and the key have their own files, whose names it contains.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeamFile {
    schema: u32,
    /// Name of the file of the packet model.
    pub model_file: String,
    /// Name of the file of the team's key, which has 64 hexadecimal digits. `None` for plain packets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_file: Option<String>,
    /// [`crate::Provenance::log_digest`] of the model, for information. It is not part of the team configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_digest: Option<String>,
    #[serde(default)]
    epoch: u32,
    #[serde(default = "frame_bytes")]
    frame_bytes: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    packets_per_sender_max: Option<u16>,
    #[serde(default = "reports_per_sender_max")]
    reports_per_sender_max: u16,
    #[serde(default = "transmissions_max")]
    transmissions_max: u8,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    piggyback: Option<bool>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    track_tolerance_m: Option<f64>,
    #[serde(default = "extrapolation_s_max")]
    extrapolation_s_max: f64,
    #[serde(default = "min_gain_nats")]
    min_gain_nats: f64,
    #[serde(default = "exclusion_threshold_sd")]
    exclusion_threshold_sd: f64,
    members: BTreeMap<String, u8>,
    grid: GridLayout,
    #[serde(default)]
    slots: SlotsLayout,
    #[serde(default)]
    limits: Limits,
}

fn frame_bytes() -> usize {
    DEFAULT_FRAME_BYTES
}

fn reports_per_sender_max() -> u16 {
    DEFAULT_REPORTS_PER_SENDER_MAX
}

fn transmissions_max() -> u8 {
    DEFAULT_TRANSMISSIONS_MAX
}

fn extrapolation_s_max() -> f64 {
    DEFAULT_EXTRAPOLATION_S_MAX
}

fn exclusion_threshold_sd() -> f64 {
    DEFAULT_EXCLUSION_THRESHOLD_SD
}

fn time_cell_s() -> f64 {
    DEFAULT_TIME_CELL_S
}

fn min_gain_nats() -> f64 {
    DEFAULT_MIN_GAIN_NATS
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GridLayout {
    cell_m: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    depth_cell_m: Option<f64>,
    #[serde(default)]
    start_s: f64,
    #[serde(default = "time_cell_s")]
    time_cell_s: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct SlotsLayout {
    start_s: f64,
    duration_s: f64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    order: Vec<String>,
}

impl Default for SlotsLayout {
    fn default() -> Self {
        Self { start_s: 0.0, duration_s: DEFAULT_SLOT_S, order: Vec::new() }
    }
}

impl SlotsLayout {
    fn of(slots: &Slots) -> Self {
        let order = slots.order.iter().map(|name| name.as_str().to_owned()).collect();
        Self { start_s: slots.start_s, duration_s: slots.duration_s, order }
    }

    /// Returns the slots of these members. If the file has no order, members transmit in the order of their numbers.
    fn slots(&self, members: &BTreeMap<u8, VehicleId>) -> Result<Slots, TeamError> {
        let is_known = |name: &VehicleId| name.as_str().is_empty() || members.values().any(|member| member == name);
        let mut order: Vec<VehicleId> = self.order.iter().map(|name| VehicleId::new(name.as_str())).collect();
        if let Some(name) = order.iter().find(|name| !is_known(name)) {
            return Err(TeamError::UnknownMember { name: name.clone() });
        }
        if order.is_empty() {
            order = members.values().cloned().collect();
        }
        let start_s = checked("slots.start_s", bounds::TIME_S, self.start_s)?;
        Ok(Slots { start_s, ..Slots::cycle(checked("slots.duration_s", bounds::SLOT_S, self.duration_s)?, order) })
    }
}

/// Schema version of a team file. It is read first, so that a newer file is refused as newer and not for an unknown
/// key.
#[derive(Deserialize)]
struct SchemaVersion {
    schema: u32,
}

impl TeamFile {
    /// Parses the text of a team file. [`TeamFile::team`] checks the values.
    ///
    /// # Errors
    /// [`TeamError::Syntax`], [`TeamError::Newer`] or [`TeamError::Older`].
    pub fn parse(text: &str) -> Result<Self, TeamError> {
        let syntax = |error: toml::de::Error| TeamError::Syntax(error.to_string().trim_end().to_owned());
        let SchemaVersion { schema } = toml::from_str(text).map_err(syntax)?;
        match schema.cmp(&TEAM_SCHEMA) {
            Ordering::Greater => Err(TeamError::Newer { found: schema }),
            Ordering::Less => Err(TeamError::Older { found: schema }),
            Ordering::Equal => toml::from_str(text).map_err(syntax),
        }
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
        let file = Self {
            schema: TEAM_SCHEMA,
            model_file: model_file.to_owned(),
            key_file: key_file.map(str::to_owned),
            log_digest: log_digest.map(str::to_owned),
            epoch: team.epoch,
            frame_bytes: team.frame_bytes,
            packets_per_sender_max: Some(team.packets_per_sender_max),
            reports_per_sender_max: team.reports_per_sender_max,
            transmissions_max: team.transmissions_max,
            piggyback: team.piggyback,
            track_tolerance_m: Some(team.track_tolerance_m),
            extrapolation_s_max: team.extrapolation_s_max,
            min_gain_nats: team.min_gain_nats,
            exclusion_threshold_sd: team.exclusion_threshold_sd,
            members: team.members.iter().map(|(&number, name)| (name.as_str().to_owned(), number)).collect(),
            grid: GridLayout {
                cell_m: team.grid.cell_m,
                depth_cell_m: Some(team.grid.depth_cell_m),
                start_s: team.grid.start_s,
                time_cell_s: team.grid.time_cell_s,
            },
            slots: SlotsLayout::of(&team.slots),
            limits: team.limits,
        };
        let unwritable = |problem: &dyn std::fmt::Display| TeamError::Unwritable { problem: problem.to_string() };
        let text = toml::to_string(&file).map_err(|error| unwritable(&error))?;
        if key_file.is_some() != team.key.is_some() {
            return Err(unwritable(&"a key needs the name of a key file, and the name of a key file needs a key"));
        }
        let again = Self::parse(&text).and_then(|file| file.team(team.model.clone(), team.key.clone()));
        let again = again.map_err(|error| unwritable(&error))?;
        let local_settings = |team: &Team| {
            let numbers =
                [team.min_gain_nats, team.exclusion_threshold_sd, team.track_tolerance_m, team.extrapolation_s_max]
                    .map(f64::to_bits);
            (numbers, team.transmissions_max, team.piggyback, team.limits)
        };
        if again.canonical_bytes() != team.canonical_bytes() || local_settings(&again) != local_settings(team) {
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
        for (name, &number) in &self.members {
            let second = VehicleId::new(name.as_str());
            if let Some(first) = members.insert(number, second.clone()) {
                return Err(TeamError::SameNumber { number, first, second });
            }
        }
        if members.is_empty() {
            return Err(TeamError::Members { found: 0 });
        }
        let window = self
            .packets_per_sender_max
            .unwrap_or_else(|| default_packets_per_sender_max(members.len(), self.frame_bytes));
        for (name, limit, bounds) in self.limits.entries() {
            checked(&format!("limits.{name}"), bounds, limit as f64)?;
        }
        let team = Team {
            grid: Grid {
                cell_m: checked("grid.cell_m", bounds::LENGTH_M, self.grid.cell_m)?,
                depth_cell_m: checked("grid.depth_cell_m", bounds::LENGTH_M, self.grid.depth_cell_m.unwrap_or(1.0))?,
                start_s: checked("grid.start_s", bounds::TIME_S, self.grid.start_s)?,
                time_cell_s: checked("grid.time_cell_s", bounds::SLOT_S, self.grid.time_cell_s)?,
            },
            frame_bytes: self.frame_bytes,
            slots: self.slots.slots(&members)?,
            key,
            epoch: self.epoch,
            packets_per_sender_max: checked("packets_per_sender_max", bounds::WINDOW, window.into())? as u16,
            reports_per_sender_max: checked(
                "reports_per_sender_max",
                bounds::WINDOW,
                self.reports_per_sender_max.into(),
            )? as u16,
            transmissions_max: self.transmissions_max,
            piggyback: self.piggyback,
            extrapolation_s_max: checked("extrapolation_s_max", bounds::EXTRAPOLATION_S, self.extrapolation_s_max)?,
            track_tolerance_m: checked(
                "track_tolerance_m",
                bounds::LENGTH_M,
                self.track_tolerance_m.unwrap_or(DEFAULT_TRACK_TOLERANCE_CELLS * self.grid.cell_m),
            )?,
            exclusion_threshold_sd: checked(
                "exclusion_threshold_sd",
                bounds::EXCLUSION_THRESHOLD,
                self.exclusion_threshold_sd,
            )?,
            min_gain_nats: checked("min_gain_nats", bounds::MIN_GAIN_NATS, self.min_gain_nats)?,
            limits: self.limits,
            members: Members::new(members),
            model,
        };
        team.layout(team.frame_bytes)?;
        checked("frame_bytes", bounds::FRAME_BYTES, team.frame_bytes as f64)?;
        Ok(team)
    }
}

fn checked(key: &str, bounds: Bounds, value: f64) -> Result<f64, TeamError> {
    bounds.check(value).ok_or_else(|| TeamError::OutOfRange { key: key.to_owned(), expected: bounds, value })
}
