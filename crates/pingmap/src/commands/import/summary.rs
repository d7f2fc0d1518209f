//! Summary of an import as text.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ClockEstimate, EvidenceCounts, ExclusionReason, ImportResult, PairCounts, Rules};

use super::files::Inputs;
use super::origin::OriginSource;
use crate::output::{count, table};

/// Largest number of files of unknown kind that are named.
const UNKNOWN_FILES_NAMED_MAX: usize = 5;

/// Formats the counts of each pair, the left-out messages with their reasons, and the clocks.
pub fn summary(imported: &ImportResult, inputs: &Inputs, rules: &Rules) -> String {
    let events = imported.log.events.len();
    let heard = imported.log.events.iter().filter(|event| event.success).count();
    let EvidenceCounts { recorded, assumed_slots, received, unconfirmed_slots } = imported.evidence;
    let transmissions = match inputs.events {
        Some(_) => "in tables with outcomes".to_owned(),
        None => format!(
            "of {}: {recorded} recorded by the sender, {assumed_slots} assumed from the schedule, {received} recorded only by receivers",
            count(recorded + assumed_slots + received, "transmission")
        ),
    };
    let mut text = format!("{} ({heard} heard, {} missed) {transmissions}.\n", count(events, "event"), events - heard,);
    if unconfirmed_slots > 0 {
        text += &format!("The use of {} is unknown.\n", count(unconfirmed_slots, "slot"));
    }
    text += &format!("Positions: {}{}.\n", inputs.reference.name(), origin_note(inputs));
    text += &format!("\n{}\n", pairs(&imported.pairs));
    if inputs.events.is_some() {
        return text.trim_end().to_owned();
    }
    let times = if rules.reference_clock.is_some() {
        "times and positions are corrected"
    } else {
        "times and positions are as recorded"
    };
    text += &format!("\n{}\n\nClocks are compared by received messages; {times}.", clocks(&imported.clocks));
    if imported.delay_s.abs() > 0.005 {
        text += &format!(
            " A reception is recorded {:.2} s after its transmission, in addition to the travel time of sound.",
            imported.delay_s
        );
    }
    let left_out = &imported.left_out;
    let counts = [
        (left_out.overheard, "messages to other vehicles (--overhear)"),
        (inputs.skipped.unattributed, "damaged messages of unknown senders"),
        (inputs.skipped.failed_transmissions, "transmissions that did not take place"),
    ];
    let mut left_out_counts: Vec<String> =
        counts.iter().filter(|count| count.0 > 0).map(|(number, noun)| format!("{number} {noun}")).collect();
    left_out_counts.extend(unknown_files(inputs));
    if !left_out_counts.is_empty() {
        text += &format!("\nLeft out: {}.", left_out_counts.join(", "));
    }
    text
}

/// Names the files in folders whose kind is unknown.
pub fn unknown_files(inputs: &Inputs) -> Option<String> {
    let named = inputs.unknown_files.iter().take(UNKNOWN_FILES_NAMED_MAX);
    let mut names: Vec<String> = named.map(|path| path.display().to_string()).collect();
    let remaining = inputs.unknown_files.len() - names.len();
    names.extend((remaining > 0).then(|| format!("{remaining} more")));
    (!names.is_empty()).then(|| format!("files of unknown kind ({})", names.join(", ")))
}

/// Describes the source of the origin, unless an option gave the origin.
fn origin_note(inputs: &Inputs) -> String {
    match inputs.origin {
        Some((origin, OriginSource::Mean)) => format!(
            " (their mean; for other logs of this area: --origin {:.2},{:.2})",
            origin.latitude_deg, origin.longitude_deg
        ),
        Some((origin, OriginSource::Files)) => {
            format!(" (from the files: --origin {:.5},{:.5})", origin.latitude_deg, origin.longitude_deg)
        }
        Some((_, OriginSource::Option)) | None => String::new(),
    }
}

type Pairs = BTreeMap<(VehicleId, VehicleId), PairCounts>;

/// A count of a pair.
type Number = fn(&PairCounts) -> usize;

/// Columns for messages that yield no event although their outcome is known.
const OTHER_COUNTS: [(&str, Number); 3] = [
    ("other destination", |pair| pair.overheard),
    ("unassigned", |pair| pair.unassigned),
    ("duplicates", |pair| pair.duplicates),
];

fn pairs(pairs: &Pairs) -> String {
    let reasons: Vec<ExclusionReason> = ExclusionReason::ALL
        .into_iter()
        .filter(|reason| pairs.values().any(|pair| pair.excluded.contains_key(reason)))
        .collect();
    let mut header = vec!["from → to", "transmissions", "heard", "missed"];
    header.extend(reasons.iter().map(|reason| reason.description()));
    let columns: Vec<_> =
        OTHER_COUNTS.into_iter().filter(|(_, number)| pairs.values().any(|pair| number(pair) > 0)).collect();
    header.extend(columns.iter().map(|(words, _)| *words));
    let row = |((sender, receiver), pair): (&(_, _), &PairCounts)| {
        let counts = [pair.transmissions, pair.heard, pair.missed];
        let mut row = vec![format!("{sender} → {receiver}")];
        row.extend(counts.map(|number| number.to_string()));
        let or_dash = |number: usize| if number > 0 { number.to_string() } else { "–".into() };
        row.extend(reasons.iter().map(|reason| or_dash(pair.excluded.get(reason).copied().unwrap_or(0))));
        row.extend(columns.iter().map(|(_, number)| or_dash(number(pair))));
        row
    };
    table(&header, &pairs.iter().map(row).collect::<Vec<_>>())
}

fn clocks(clocks: &[ClockEstimate]) -> String {
    let rows: Vec<Vec<String>> = clocks.iter().map(clock).collect();
    table(&["clock", "offset (s)", "drift (ppm)", "messages", "median residual (s)"], &rows)
}

fn clock(clock: &ClockEstimate) -> Vec<String> {
    let joined = |text: &dyn Fn(&pingmap_import::ClockSegment) -> String| match clock.segments.as_slice() {
        [] => "unknown".to_owned(),
        segments => segments.iter().map(text).collect::<Vec<_>>().join(", then "),
    };
    let (offset, drift) = if clock.is_reference {
        ("0 (reference)".to_owned(), "–".to_owned())
    } else {
        (
            joined(&|segment| format!("{:+.2}", segment.offset_s)),
            joined(&|segment| format!("{:+.1}", 1e6 * segment.drift)),
        )
    };
    vec![
        clock.vehicle.to_string(),
        offset,
        drift,
        clock.comparisons.to_string(),
        format!("{:.3}", clock.median_residual_s),
    ]
}
