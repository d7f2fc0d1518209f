//! Reports for people: outcomes as letters, knots by the numbers of their slots.

use pingmap_agent::Agent;
use pingmap_packet::{Cell, Earlier, Knot, Outcome, REPORT_LAYOUTS, Report, ReportLayout};
use schemars::JsonSchema;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use crate::output::{BadInput, Results, print, print_json, table};
use crate::team::{model_digest, team_digest};

/// A report as JSON.
#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReportJson {
    /// Version of this object.
    schema: u32,
    /// With what it was written, from which nothing follows.
    #[serde(default, skip_serializing, rename = "version")]
    #[schemars(skip)]
    _version: IgnoredAny,
    #[serde(default, skip_serializing, rename = "command")]
    #[schemars(skip)]
    _command: IgnoredAny,
    /// With a team, by which its agreement is known; not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    team_digest: Option<String>,
    /// With a team, by which its model is known; not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model_digest: Option<String>,
    /// Name of the message in the `.proto`.
    message: String,
    /// The number of its sender in the team.
    sender: u8,
    /// Check number of the team's model and of this report; not in a sealed one, which proves more.
    #[serde(default)]
    model: u16,
    /// The slot that it begins at.
    first: u32,
    /// Whether it tells of its sender's own transmissions, too.
    #[serde(default)]
    tells_own: bool,
    /// For every slot that it stands for a letter: h heard (or sent), m missed (or silent), - untold.
    outcomes: String,
    /// Its sender's track, to be joined by straight lines.
    knots: Vec<KnotJson>,
    /// Which map messages tell of the same events.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    earlier: Option<EarlierJson>,
}

#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnotJson {
    /// The slot at whose beginning it was there.
    slot: u32,
    /// East, north and, in messages with depths, depth in cells of knots.
    cell: Vec<u8>,
    /// With a team, the same in metres, which is not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    at_m: Option<Vec<f64>>,
}

/// Which map messages speak of the same events.
#[derive(Serialize, JsonSchema, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EarlierJson {
    /// It is about map messages with counters below this one, of which these are the lowest 8 bits.
    before: u8,
    /// Whether what they say beyond reports still counts.
    counts: bool,
}

impl ReportJson {
    /// The form that the JSON names, and the report.
    fn report(&self) -> Result<(&'static ReportLayout, Report), String> {
        let layout = REPORT_LAYOUTS.iter().find(|layout| layout.name == self.message);
        let layout = layout.ok_or_else(|| {
            let names: Vec<&str> = REPORT_LAYOUTS.iter().map(|layout| layout.name).collect();
            format!("unknown message {:?}; expected one of {}", self.message, names.join(", "))
        })?;
        let outcomes = self.outcomes.chars().map(outcome).collect::<Result<_, _>>()?;
        let mut knots = Vec::with_capacity(self.knots.len());
        let mut before = None;
        for knot in &self.knots {
            let slots = match before.replace(knot.slot) {
                None => self.first.checked_sub(knot.slot),
                Some(before) => knot.slot.checked_sub(before),
            };
            let rising = "slots of knots must rise, the first at or before \"first\", each at most 255 apart";
            let slots = slots.and_then(|slots| u8::try_from(slots).ok()).ok_or(rising)?;
            let (east, north, depth) = match (knot.cell.as_slice(), layout.has_depth) {
                (&[east, north], false) => (east, north, 0),
                (&[east, north, depth], true) => (east, north, depth),
                (other, has_depth) => {
                    let expected = if has_depth { 3 } else { 2 };
                    return Err(format!("cell: expected {expected} cells in {}, found {}", layout.name, other.len()));
                }
            };
            knots.push(Knot { slots, east, north, depth });
        }
        let Self { sender, model, first, tells_own, .. } = *self;
        let earlier = self.earlier.as_ref().map(|earlier| Earlier { before: earlier.before, counts: earlier.counts });
        Ok((layout, Report { sender, model, first, tells_own, outcomes, knots, earlier }))
    }
}

fn outcome(letter: char) -> Result<Outcome, String> {
    match letter {
        'h' => Ok(Outcome::Heard),
        'm' => Ok(Outcome::Missed),
        '-' => Ok(Outcome::Untold),
        other => Err(format!("outcomes: expected h, m or -, found {other:?}")),
    }
}

/// The bytes of the report in a text, as the listener's team sends it if there is one, and its form.
pub fn encode(text: &str, listener: Option<&Agent>) -> Result<(&'static ReportLayout, Vec<u8>), String> {
    let json: ReportJson = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let (layout, report) = json.report()?;
    let Some(listener) = listener else {
        return report.encode(layout, None).map(|bytes| (layout, bytes)).map_err(|error| error.to_string());
    };
    let bytes = listener.write_report(&report).map_err(|error| error.to_string())?;
    // What no member of the team would take is an error here already.
    let (written, ..) = listener.read_report(&bytes).map_err(|refusal| refusal.to_string())?;
    match written == layout {
        true => Ok((layout, bytes)),
        false => Err(format!("the team sends {}, not {}", written.name, layout.name)),
    }
}

/// Says what a report holds.
pub fn decode(bytes: &[u8], listener: Option<&Agent>, as_json: bool, results: Results) -> anyhow::Result<()> {
    let (layout, report, _) = match listener {
        Some(listener) => listener.read_report(bytes).map_err(|refusal| BadInput(refusal.to_string()))?,
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
    let rows = json
        .knots
        .iter()
        .map(|knot| vec![knot.slot.to_string(), knot.at_m.as_deref().map_or_else(|| cells(&knot.cell), metres)]);
    let place = if listener.is_some() { "where it was, m" } else { "where it was, cell" };
    let [heard, missed, untold] = [Outcome::Heard, Outcome::Missed, Outcome::Untold].map(count);
    print(
        results,
        &format!(
            "{} of {sender}, slots from {} on: heard {heard}, missed {missed}, untold {untold}\n{}\n\n{}",
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
        Outcome::Untold => '-',
    };
    let mut slot = None;
    let knot = |knot: &Knot| {
        let slots = u32::from(knot.slots);
        let slot = *slot.insert(slot.map_or(report.first.saturating_sub(slots), |before| before + slots));
        let mut cell = vec![knot.east, knot.north];
        if layout.has_depth {
            cell.push(knot.depth);
        }
        let at_m = listener.map(|listener| {
            let (team, at) = (listener.team(), Cell { east: knot.east, north: knot.north, depth: knot.depth });
            let at = team.grid.knot_position(&team.model.chart, at, layout.has_depth);
            [Some(at.east_m), Some(at.north_m), at.depth_m].into_iter().flatten().collect()
        });
        KnotJson { slot, cell, at_m }
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
        tells_own: report.tells_own,
        outcomes: report.outcomes.iter().map(letter).collect(),
        knots: report.knots.iter().map(knot).collect(),
        earlier: report.earlier.map(|earlier| EarlierJson { before: earlier.before, counts: earlier.counts }),
    }
}
