//! What a team agrees on as a TOML text. Unknown keys are refused: a slip of the pen must not pass for a default.

use std::collections::BTreeMap;

use pingmap_packet::Key;
use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};
use crate::event::VehicleId;
use crate::grid::{Grid, TIME_CELL_S};
use crate::limits::Limits;
use crate::model::Model;
use crate::slots::{SlotChange, Slots};
use crate::team::{
    FRAME_BYTES, ONWARD_S_MAX, REPORTS_PER_SENDER_MAX, SLOT_S, SURPRISE_MAX, TEAM_SCHEMA, TELLINGS_MAX,
    TRACK_OFF_CELLS, Team, TeamError, WORTH_NATS, packets_per_sender_max,
};

/// `team.toml`, with the names of the files that belong to it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeamFile {
    schema: u32,
    /// File of the packet model.
    pub model_file: String,
    /// File with the team's key, 64 hexadecimal digits, if packets are sealed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub key_file: Option<String>,
    /// [`crate::Provenance::log_digest`] of the model. No part of what the team agrees on.
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
    #[serde(default = "tellings_max")]
    tellings_max: u8,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    spare_bits: Option<bool>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    track_off_max_m: Option<f64>,
    #[serde(default = "onward_s_max")]
    onward_s_max: f64,
    #[serde(default = "worth_nats")]
    worth_nats: f64,
    #[serde(default = "surprise_max")]
    surprise_max: f64,
    #[serde(default)]
    repeats_max: u8,
    members: BTreeMap<String, u8>,
    grid: GridLayout,
    #[serde(default)]
    slots: SlotsLayout,
    #[serde(default)]
    limits: Limits,
}

fn frame_bytes() -> usize {
    FRAME_BYTES
}

fn reports_per_sender_max() -> u16 {
    REPORTS_PER_SENDER_MAX
}

fn tellings_max() -> u8 {
    TELLINGS_MAX
}

fn onward_s_max() -> f64 {
    ONWARD_S_MAX
}

fn surprise_max() -> f64 {
    SURPRISE_MAX
}

fn time_cell_s() -> f64 {
    TIME_CELL_S
}

fn worth_nats() -> f64 {
    WORTH_NATS
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
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    at_will: bool,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    order: Vec<String>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    changes: Vec<ChangeLayout>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    may_be_silent: Vec<String>,
}

/// Another order, and when its first slot begins.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChangeLayout {
    from_s: f64,
    order: Vec<String>,
}

impl Default for SlotsLayout {
    fn default() -> Self {
        Self {
            start_s: 0.0,
            duration_s: SLOT_S,
            at_will: false,
            order: Vec::new(),
            changes: Vec::new(),
            may_be_silent: Vec::new(),
        }
    }
}

impl SlotsLayout {
    fn of(slots: &Slots) -> Self {
        let names = |order: &[VehicleId]| order.iter().map(|name| name.as_str().to_owned()).collect();
        let change = |change: &SlotChange| ChangeLayout {
            from_s: slots.start_s + f64::from(change.from) * slots.duration_s,
            order: names(&change.order),
        };
        Self {
            start_s: slots.start_s,
            duration_s: slots.duration_s,
            at_will: slots.at_will,
            // Those who send at will are the members.
            order: if slots.at_will { Vec::new() } else { names(&slots.order) },
            changes: slots.changes.iter().map(change).collect(),
            may_be_silent: slots.may_be_silent.iter().map(|name| name.as_str().to_owned()).collect(),
        }
    }

    /// The slots of these members: they send in turn where the file names no order.
    fn slots(&self, members: &BTreeMap<u8, VehicleId>) -> Result<Slots, TeamError> {
        let names = |order: &[String]| -> Result<Vec<VehicleId>, TeamError> {
            let order: Vec<VehicleId> = order.iter().map(|name| VehicleId::new(name.as_str())).collect();
            let is_known = |name: &VehicleId| name.as_str().is_empty() || members.values().any(|member| member == name);
            match order.iter().find(|name| !is_known(name)) {
                Some(name) => Err(TeamError::UnknownMember { name: name.clone() }),
                None if order.is_empty() => Ok(members.values().cloned().collect()),
                None => Ok(order),
            }
        };
        let mut slots = Slots {
            start_s: checked("slots.start_s", bounds::TIME_S, self.start_s)?,
            may_be_silent: self.may_be_silent.iter().map(|name| VehicleId::new(name.as_str())).collect(),
            at_will: self.at_will,
            ..Slots::in_turn(checked("slots.duration_s", bounds::SLOT_S, self.duration_s)?, names(&self.order)?)
        };
        if let Some(name) = slots.may_be_silent.iter().find(|name| !members.values().any(|member| member == *name)) {
            return Err(TeamError::UnknownMember { name: name.clone() });
        }
        if slots.at_will && !(self.order.is_empty() && self.changes.is_empty()) {
            return Err(TeamError::OrderAtWill);
        }
        for change in &self.changes {
            let from_s = checked("slots.changes.from_s", bounds::TIME_S, change.from_s)?;
            let before = slots.changes.last().map_or(0, |change| change.from);
            let from = slots.number(from_s).filter(|&from| from > before);
            let from = from.ok_or(TeamError::ChangesBackwards { from_s })?;
            slots.changes.push(SlotChange { from, order: names(&change.order)? });
        }
        Ok(slots)
    }
}

/// What is read first, so that a newer file is called newer and not misspelt.
#[derive(Deserialize)]
struct Version {
    schema: u32,
}

impl TeamFile {
    /// Reads the text. What it says is checked by [`TeamFile::team`], once the files it names are at hand.
    ///
    /// # Errors
    /// [`TeamError::Syntax`] or [`TeamError::Newer`].
    pub fn parse(text: &str) -> Result<Self, TeamError> {
        let syntax = |error: toml::de::Error| TeamError::Syntax(error.to_string().trim_end().to_owned());
        let Version { schema } = toml::from_str(text).map_err(syntax)?;
        if schema > TEAM_SCHEMA {
            return Err(TeamError::Newer { found: schema });
        }
        toml::from_str(text).map_err(syntax)
    }

    /// The text of a team whose model, and key if it has one, lie in these files, and whose model was learned from this log.
    ///
    /// # Errors
    /// [`TeamError::Unwritable`] for a team that no file can say.
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
            tellings_max: team.tellings_max,
            spare_bits: team.spare_bits,
            track_off_max_m: Some(team.track_off_max_m),
            onward_s_max: team.onward_s_max,
            worth_nats: team.worth_nats,
            surprise_max: team.surprise_max,
            repeats_max: team.repeats_max,
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
            return Err(unwritable(&"a key and the name of its file go together"));
        }
        let again = Self::parse(&text).and_then(|file| file.team(team.model.clone(), team.key.clone()));
        let again = again.map_err(|error| unwritable(&error))?;
        let own_affairs = |team: &Team| {
            let numbers =
                [team.worth_nats, team.surprise_max, team.track_off_max_m, team.onward_s_max].map(f64::to_bits);
            (
                numbers,
                team.repeats_max,
                team.tellings_max,
                team.spare_bits,
                team.limits,
                team.slots.may_be_silent.clone(),
            )
        };
        if again.canonical_bytes() != team.canonical_bytes() || own_affairs(&again) != own_affairs(team) {
            return Err(unwritable(&"something is lost in it"));
        }
        Ok(text)
    }

    /// The team, given what its files hold.
    ///
    /// # Errors
    /// [`TeamError`] with the key, what was expected and what it says.
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
        let window =
            self.packets_per_sender_max.unwrap_or_else(|| packets_per_sender_max(members.len(), self.frame_bytes));
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
            tellings_max: self.tellings_max,
            spare_bits: self.spare_bits,
            onward_s_max: checked("onward_s_max", bounds::ONWARD_S, self.onward_s_max)?,
            track_off_max_m: checked(
                "track_off_max_m",
                bounds::LENGTH_M,
                self.track_off_max_m.unwrap_or(TRACK_OFF_CELLS * self.grid.cell_m),
            )?,
            surprise_max: checked("surprise_max", bounds::SURPRISE, self.surprise_max)?,
            worth_nats: checked("worth_nats", bounds::WORTH_NATS, self.worth_nats)?,
            repeats_max: self.repeats_max,
            limits: self.limits,
            members,
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
