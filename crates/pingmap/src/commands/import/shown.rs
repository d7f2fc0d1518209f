//! What was imported, for people.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ClockEstimate, EvidenceCounts, ExclusionReason, ImportResult, PairCounts, Rules};

use super::files::{OriginBy, Taken};
use crate::output::{count, table};

/// Clocks that differ by more than this are worth a word.
const CLOCK_OFF_S: f64 = 0.5;

/// So many files that are of no known kind are named.
const LEFT_ALONE_NAMED_MAX: usize = 5;

/// So is a modem without a sign for this share of all messages.
const SILENT_SHARE: f64 = 0.1;

/// What should be known before the log is used.
pub fn warnings(imported: &ImportResult, taken: &Taken, rules: &Rules) -> Vec<String> {
    let mut warnings = Vec::new();
    if !imported.senders_by_reception.is_empty() {
        warnings.push(format!(
            "of what {} sent only what somebody received is known, so what all missed is not in the log and the map will be optimistic: \
             say what was sent (--sent), or when it was whose turn (--schedule)",
            imported.senders_by_reception
        ));
    }
    if !imported.destinations_by_reception.is_empty() && !rules.overhear {
        warnings.push(format!(
            "to whom {} sent only receivers know, so messages that nobody heard are left out and the map will be optimistic: say it where it \
             is recorded what was sent, or --overhear counts everything for everybody",
            imported.destinations_by_reception
        ));
    }
    if !imported.unconfirmed_slot_owners.is_empty() {
        warnings.push(format!(
            "{} of {} that nobody heard may not have been used and are left out, so the map will be optimistic: say what was sent \
             (--sent), or that all turns are used (--always-sends)",
            count(imported.evidence.scheduled_only, "turn"),
            imported.unconfirmed_slot_owners
        ));
    }
    for (receiver, silent, all) in silences(&imported.pairs) {
        warnings.push(format!(
            "{silent} of {all} messages lie before the first or after the last sign of {receiver}'s modem and are left out, whatever became \
             of them: if it was listening, --listening {receiver}=FROM/TO says from when to when"
        ));
    }
    let off = |clock: &&ClockEstimate| clock.segments.iter().any(|piece| piece.offset_s.abs() > CLOCK_OFF_S);
    if rules.reference_clock.is_none() && imported.clocks.iter().any(|clock| off(&clock)) {
        warnings.push(
            "clocks differ, and times and places are as recorded: --correct-clocks NAME corrects them to that of NAME"
                .into(),
        );
    }
    warnings.extend(imported.clock_warnings.iter().cloned());
    warnings.extend(unknown_clocks(imported));
    for (name, messages) in imported.left_out.unknown_sources.iter().chain(&taken.unknown_sources) {
        let messages = count(*messages, "message");
        warnings.push(format!(
            "{messages} from {name}, of whom nothing was recorded, left out (--ids says who is meant by an id)"
        ));
    }
    for (name, messages) in imported.left_out.unknown_destinations.iter().filter(|_| !rules.overhear) {
        warnings.push(format!(
            "{} to {name}, of whom nothing was recorded, are nobody's: if {name} is everybody, or somebody by another name, --ids says so",
            count(*messages, "message")
        ));
    }
    for (name, messages) in &imported.left_out.unexpected {
        let messages = count(*messages, "message");
        warnings.push(format!(
            "{messages} from {name} were received when it sent none by its record or had no turn: did its record end before, are clocks, ids and --match-s right?"
        ));
    }
    warnings.extend(left_out(imported, taken));
    warnings
}

/// What stood in files and is in no event, of which there should be nothing.
fn left_out(imported: &ImportResult, taken: &Taken) -> impl Iterator<Item = String> {
    let skipped = &taken.skipped;
    let counts = [
        (skipped.garbled, "line", "garbled, or none of their kind, left out"),
        (
            skipped.unknown_type,
            "message",
            "in an encoding that is not read, or of types that no given definition (.lcm) has, left out",
        ),
        (skipped.truncated, "file", "cut off: what stands before is read, what followed is not known"),
        (skipped.without_position, "line", "of navigation without a position left out"),
        (imported.left_out.unprojected, "position", "outside of the map left out"),
        (imported.left_out.own_messages, "message", "that vehicles heard of themselves left out"),
    ];
    counts
        .into_iter()
        .filter(|(number, ..)| *number > 0)
        .map(|(number, what, why)| format!("{} {why}", count(number, what)))
}

/// Vehicles whose clock no messages compare with the others', and what becomes of them.
fn unknown_clocks(imported: &ImportResult) -> Option<String> {
    let unknown = imported.clocks.iter().filter(|clock| clock.segments.is_empty());
    let names: Vec<&str> = unknown.map(|clock| clock.vehicle.as_str()).collect();
    let left_out = imported.excluded().get(&ExclusionReason::ClockUnsure).copied().unwrap_or(0);
    (!names.is_empty()).then(|| {
        format!(
            "no two messages compare the clock of {} with the others': places stay as recorded, and for want of such comparisons and for \
             messages that fit nothing {left_out} are left out: --clock-off-s-max 0 says that clocks agree",
            names.join(", ")
        )
    })
}

/// Receivers whose modem gave no sign for a good part of all messages: how many, and of how many.
fn silences(pairs: &Pairs) -> Vec<(&VehicleId, usize, usize)> {
    let mut by_receiver: BTreeMap<&VehicleId, (usize, usize)> = BTreeMap::new();
    for ((_, receiver), pair) in pairs {
        let counts = by_receiver.entry(receiver).or_default();
        counts.0 += pair.excluded.get(&ExclusionReason::NotRecording).copied().unwrap_or(0);
        counts.1 += pair.heard + pair.missed + pair.excluded.values().sum::<usize>();
    }
    let many = |counts: &(usize, usize)| counts.0 as f64 > SILENT_SHARE * counts.1 as f64;
    by_receiver
        .into_iter()
        .filter(|(_, counts)| many(counts))
        .map(|(name, counts)| (name, counts.0, counts.1))
        .collect()
}

/// The pairs, what was left out and why, and the clocks.
pub fn summary(imported: &ImportResult, taken: &Taken, rules: &Rules) -> String {
    let events = imported.log.events.len();
    let heard = imported.log.events.iter().filter(|event| event.success).count();
    let EvidenceCounts { recorded, always_sends, received, scheduled_only } = imported.evidence;
    let mut text = format!(
        "{} ({heard} heard, {} missed) of {}: {recorded} recorded by the sender, {always_sends} by its turn, {received} by a reception alone.\n",
        count(events, "event"),
        events - heard,
        count(recorded + always_sends + received, "transmission"),
    );
    if scheduled_only > 0 {
        text += &format!("{} not known to be used.\n", count(scheduled_only, "turn"));
    }
    text += &format!("Places: {}{}.\n", taken.reference.name(), chosen(taken));
    text += &format!("\n{}\n", pairs(&imported.pairs));
    let times = if rules.reference_clock.is_some() {
        "times and places are corrected"
    } else {
        "times and places are as recorded"
    };
    text += &format!("\n{}\n\nClocks by what was sent and heard; {times}.", clocks(&imported.clocks));
    if imported.delay_s > 0.0 {
        text += &format!(
            " A message is recorded {:.2} s after it began, beside the time that sound takes.",
            imported.delay_s
        );
    }
    let left_out = &imported.left_out;
    let more = [
        (left_out.overheard, "messages meant for others (--overhear)"),
        (taken.skipped.unattributed, "broken messages of unknown senders"),
        (taken.skipped.not_sent, "transmissions that did not take place"),
    ];
    let mut more: Vec<String> =
        more.iter().filter(|more| more.0 > 0).map(|(number, what)| format!("{number} {what}")).collect();
    more.extend(left_alone(taken));
    if !more.is_empty() {
        text += &format!("\nLeft out: {}.", more.join(", "));
    }
    text
}

/// Files in folders that are of no known kind, by name.
pub fn left_alone(taken: &Taken) -> Option<String> {
    let named = taken.left_alone.iter().take(LEFT_ALONE_NAMED_MAX);
    let mut names: Vec<String> = named.map(|path| path.display().to_string()).collect();
    let others = taken.left_alone.len() - names.len();
    names.extend((others > 0).then(|| format!("{others} more")));
    (!names.is_empty()).then(|| format!("what is of no known kind ({})", names.join(", ")))
}

/// Whether the origin was not said by whoever imports, and who said it.
fn chosen(taken: &Taken) -> String {
    match taken.origin {
        Some((origin, OriginBy::Nobody)) => format!(
            " (their middle; for other logs of this place: --origin {:.2},{:.2})",
            origin.latitude_deg, origin.longitude_deg
        ),
        Some((origin, OriginBy::Files)) => {
            format!(" (by the files: --origin {:.5},{:.5})", origin.latitude_deg, origin.longitude_deg)
        }
        Some((_, OriginBy::Option)) | None => String::new(),
    }
}

type Pairs = BTreeMap<(VehicleId, VehicleId), PairCounts>;

/// A number that is known of a pair.
type Number = fn(&PairCounts) -> usize;

/// What of a pair is no event and not unknown either.
const BESIDE: [(&str, Number); 3] = [
    ("for others", |pair| pair.overheard),
    ("fits nothing", |pair| pair.unmatched),
    ("recorded twice", |pair| pair.duplicates),
];

fn pairs(pairs: &Pairs) -> String {
    let reasons: Vec<ExclusionReason> = ExclusionReason::ALL
        .into_iter()
        .filter(|reason| pairs.values().any(|pair| pair.excluded.contains_key(reason)))
        .collect();
    let mut header = vec!["from → to", "heard", "missed"];
    header.extend(reasons.iter().map(|reason| reason.description()));
    let more: Vec<_> = BESIDE.into_iter().filter(|(_, number)| pairs.values().any(|pair| number(pair) > 0)).collect();
    header.extend(more.iter().map(|(words, _)| *words));
    let row = |((from, to), pair): (&(_, _), &PairCounts)| {
        let mut row = vec![format!("{from} → {to}"), pair.heard.to_string(), pair.missed.to_string()];
        let or_dash = |number: usize| if number > 0 { number.to_string() } else { "–".into() };
        row.extend(reasons.iter().map(|reason| or_dash(pair.excluded.get(reason).copied().unwrap_or(0))));
        row.extend(more.iter().map(|(_, number)| or_dash(number(pair))));
        row
    };
    table(&header, &pairs.iter().map(row).collect::<Vec<_>>())
}

fn clocks(clocks: &[ClockEstimate]) -> String {
    let rows: Vec<Vec<String>> = clocks.iter().map(clock).collect();
    table(&["clock", "ahead by (s)", "gains (ppm)", "messages", "half are off by less than (s)"], &rows)
}

fn clock(clock: &ClockEstimate) -> Vec<String> {
    let joined = |text: &dyn Fn(&pingmap_import::ClockSegment) -> String| match clock.segments.as_slice() {
        [] => "unknown".to_owned(),
        pieces => pieces.iter().map(text).collect::<Vec<_>>().join(", then "),
    };
    let (ahead, gains) = if clock.is_reference {
        ("0 (the others by it)".to_owned(), "–".to_owned())
    } else {
        (joined(&|piece| format!("{:+.2}", piece.offset_s)), joined(&|piece| format!("{:+.1}", 1e6 * piece.drift)))
    };
    vec![
        clock.vehicle.to_string(),
        ahead,
        gains,
        clock.comparisons.to_string(),
        format!("{:.3}", clock.median_residual_s),
    ]
}
