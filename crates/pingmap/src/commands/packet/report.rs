//! Prints reports: outcomes as letters, waypoints by the numbers of their slots.

use pingmap_agent::Agent;
use pingmap_packet::{Cell, Outcome, REPORT_LAYOUTS, Report, ReportLayout, Waypoint};
use schemars::JsonSchema;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use crate::output::{BadInput, Results, print_json, print_text, table};
use crate::team::{model_digest, team_digest};

/// A report as JSON.
#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReportJson {
    /// Version of this object.
    schema: u32,
    /// Version and command line that printed the JSON. They are not read.
    #[serde(default, skip_serializing, rename = "version")]
    #[schemars(skip)]
    _version: IgnoredAny,
    #[serde(default, skip_serializing, rename = "command")]
    #[schemars(skip)]
    _command: IgnoredAny,
    /// Digest of the team configuration, if a team file is given. Not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    team_digest: Option<String>,
    /// Digest of the model, if a team file is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model_digest: Option<String>,
    /// Name of the message in the `.proto`.
    message: String,
    /// Number of the sender in the team.
    sender: u8,
    /// Check number of the team's model and of this report. Authenticated reports have a tag instead.
    #[serde(default)]
    model: u16,
    /// First slot of the report.
    first: u32,
    /// Whether the slots of the sender are included.
    #[serde(default)]
    includes_own_slots: bool,
    /// One letter for each slot: h heard (own slot: used), m missed (own slot: unused), - not reported.
    outcomes: String,
    /// Track of the sender: straight lines between these waypoints.
    waypoints: Vec<WaypointJson>,
}

#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaypointJson {
    /// Slot at whose start the sender was at this waypoint.
    slot: u32,
    /// Cell: east, north and, in messages with depths, depth.
    cell: Vec<u8>,
    /// Position in metres, if a team file is given. Not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    at_m: Option<Vec<f64>>,
}

impl ReportJson {
    /// Returns the layout that the JSON names, and the report.
    fn report(&self) -> Result<(&'static ReportLayout, Report), String> {
        let layout = REPORT_LAYOUTS.iter().find(|layout| layout.name == self.message);
        let layout = layout.ok_or_else(|| {
            let names: Vec<&str> = REPORT_LAYOUTS.iter().map(|layout| layout.name).collect();
            format!("unknown message {:?}; expected one of {}", self.message, names.join(", "))
        })?;
        let outcomes = self.outcomes.chars().map(outcome).collect::<Result<_, _>>()?;
        let mut waypoints = Vec::with_capacity(self.waypoints.len());
        let mut before = None;
        for waypoint in &self.waypoints {
            let slots = match before.replace(waypoint.slot) {
                None => self.first.checked_sub(waypoint.slot),
                Some(before) => waypoint.slot.checked_sub(before),
            };
            let rising = "slots of waypoints must rise, the first at or before \"first\", each at most 255 apart";
            let slots = slots.and_then(|slots| u8::try_from(slots).ok()).ok_or(rising)?;
            let (east, north, depth) = match (waypoint.cell.as_slice(), layout.has_depth) {
                (&[east, north], false) => (east, north, 0),
                (&[east, north, depth], true) => (east, north, depth),
                (other, has_depth) => {
                    let expected = if has_depth { 3 } else { 2 };
                    return Err(format!("cell: expected {expected} cells in {}, found {}", layout.name, other.len()));
                }
            };
            waypoints.push(Waypoint { slots, east, north, depth });
        }
        let Self { sender, model, first, includes_own_slots, .. } = *self;
        Ok((layout, Report { sender, model, first, includes_own_slots, outcomes, waypoints }))
    }
}

fn outcome(letter: char) -> Result<Outcome, String> {
    match letter {
        'h' => Ok(Outcome::Heard),
        'm' => Ok(Outcome::Missed),
        '-' => Ok(Outcome::Unreported),
        other => Err(format!("outcomes: expected h, m or -, found {other:?}")),
    }
}

/// Encodes a report from JSON text, in the layout of the listener's team if there is one. Also returns the layout.
pub fn encode(text: &str, listener: Option<&Agent>) -> Result<(&'static ReportLayout, Vec<u8>), String> {
    let json: ReportJson = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let (layout, report) = json.report()?;
    let Some(listener) = listener else {
        return report.encode(layout, None).map(|bytes| (layout, bytes)).map_err(|error| error.to_string());
    };
    let bytes = listener.codec().write_report(&report).map_err(|error| error.to_string())?;
    // A report that members of the team would refuse is an error here.
    let (written, ..) = listener.codec().read_report(&bytes).map_err(|refusal| refusal.to_string())?;
    match written == layout {
        true => Ok((layout, bytes)),
        false => Err(format!("the team sends {}, not {}", written.name, layout.name)),
    }
}

/// Prints the content of a report.
pub fn decode(bytes: &[u8], listener: Option<&Agent>, as_json: bool, results: Results) -> anyhow::Result<()> {
    let (layout, report, _) = match listener {
        Some(listener) => listener.codec().read_report(bytes).map_err(|refusal| BadInput(refusal.to_string()))?,
        None => Report::decode(bytes, None).map_err(|error| BadInput(error.to_string()))?,
    };
    let json = json_of(layout, &report, listener);
    if as_json {
        return print_json(results, &json);
    }
    let sender = listener.and_then(|listener| listener.team().members.get(&report.sender));
    let sender = sender.map_or_else(|| format!("vehicle {}", report.sender), ToString::to_string);
    let count = |wanted| report.outcomes.iter().filter(|&&outcome| outcome == wanted).count();
    let cells = |cells: &[u8]| cells.iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
    let metres = |at_m: &[f64]| at_m.iter().map(|metres| format!("{metres:.0}")).collect::<Vec<_>>().join(", ");
    let rows = json.waypoints.iter().map(|waypoint| {
        vec![waypoint.slot.to_string(), waypoint.at_m.as_deref().map_or_else(|| cells(&waypoint.cell), metres)]
    });
    let place = if listener.is_some() { "waypoint, m" } else { "waypoint, cell" };
    let [heard, missed, unreported] = [Outcome::Heard, Outcome::Missed, Outcome::Unreported].map(count);
    print_text(
        results,
        &format!(
            "{} of {sender}, slots from {} on: heard {heard}, missed {missed}, not reported {unreported}\n{}\n\n{}",
            layout.name,
            report.first,
            json.outcomes,
            table(&["slot", place], &rows.collect::<Vec<_>>())
        ),
    )
}

fn json_of(layout: &ReportLayout, report: &Report, listener: Option<&Agent>) -> ReportJson {
    let letter = |outcome: &Outcome| match outcome {
        Outcome::Heard => 'h',
        Outcome::Missed => 'm',
        Outcome::Unreported => '-',
    };
    let mut slot = None;
    let waypoint = |waypoint: &Waypoint| {
        let slots = u32::from(waypoint.slots);
        let slot = *slot.insert(slot.map_or(report.first.saturating_sub(slots), |before| before + slots));
        let mut cell = vec![waypoint.east, waypoint.north];
        if layout.has_depth {
            cell.push(waypoint.depth);
        }
        let at_m = listener.map(|listener| {
            let (team, at) =
                (listener.team(), Cell { east: waypoint.east, north: waypoint.north, depth: waypoint.depth });
            let at = team.grid.waypoint_position(&team.model.chart, at, layout.has_depth);
            [Some(at.east_m), Some(at.north_m), at.depth_m].into_iter().flatten().collect()
        });
        WaypointJson { slot, cell, at_m }
    };
    ReportJson {
        schema: 1,
        _version: IgnoredAny,
        _command: IgnoredAny,
        team_digest: listener.map(team_digest),
        model_digest: listener.map(model_digest),
        message: layout.name.to_owned(),
        sender: report.sender,
        model: report.model,
        first: report.first,
        includes_own_slots: report.includes_own_slots,
        outcomes: report.outcomes.iter().map(letter).collect(),
        waypoints: report.waypoints.iter().map(waypoint).collect(),
    }
}
