//! What was imported, for people and programs.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ClockFound, Imported, Pair, Proofs, Rules, Unknown};
use schemars::JsonSchema;
use serde::Serialize;

use super::files::{OriginBy, Taken};
use crate::output::{count, table};

/// Clocks that differ by more than this are worth a word.
const CLOCK_OFF_S: f64 = 0.5;

/// So is a modem without a sign for this share of all messages.
const SILENT_SHARE: f64 = 0.1;

/// What should be known before the log is used.
pub fn warnings(imported: &Imported, taken: &Taken, rules: &Rules) -> Vec<String> {
    let mut warnings = Vec::new();
    if !imported.by_reception_alone.is_empty() {
        warnings.push(format!(
            "of what {} sent only what somebody received is known, so what all missed is not in the log and the map will be optimistic: \
             say what was sent (--sent), or when it was whose turn (--schedule)",
            imported.by_reception_alone
        ));
    }
    if !imported.whom_by_reception.is_empty() && !rules.overhear {
        warnings.push(format!(
            "to whom {} sent only receivers know, so messages that nobody heard are left out and the map will be optimistic: say it where it \
             is recorded what was sent, or --overhear counts everything for everybody",
            imported.whom_by_reception
        ));
    }
    if !imported.unused_turns.is_empty() {
        warnings.push(format!(
            "{} of {} that nobody heard may not have been used and are left out, so the map will be optimistic: say what was sent \
             (--sent), or that all turns are used (--always-sends)",
            count(imported.proofs.nothing, "turn"),
            imported.unused_turns
        ));
    }
    for (receiver, silent, all) in silences(&imported.pairs) {
        warnings.push(format!(
            "{silent} of {all} messages lie before the first or after the last sign of {receiver}'s modem and are left out, whatever became \
             of them: if it was listening, --listening {receiver}=FROM/TO says from when to when"
        ));
    }
    let off = |clock: &&ClockFound| clock.pieces.iter().any(|piece| piece.ahead_s.abs() > CLOCK_OFF_S);
    if rules.right_clock.is_none() && imported.clocks.iter().any(|clock| off(&clock)) {
        warnings.push(
            "clocks differ, and times and places are as recorded: --correct-clocks NAME corrects them to that of NAME"
                .into(),
        );
    }
    warnings.extend(imported.doubts.iter().cloned());
    warnings.extend(unknown_clocks(imported));
    for (name, messages) in imported.left_out.strangers.iter().chain(&taken.unknown_sources) {
        let messages = count(*messages, "message");
        warnings.push(format!(
            "{messages} from {name}, of whom nothing was recorded, left out (--ids says who is meant by an id)"
        ));
    }
    for (name, messages) in imported.left_out.to_strangers.iter().filter(|_| !rules.overhear) {
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
fn left_out(imported: &Imported, taken: &Taken) -> impl Iterator<Item = String> {
    let skipped = &taken.skipped;
    let counts = [
        (skipped.garbled, "line", "garbled, or none of their kind, left out"),
        (
            skipped.of_no_type,
            "message",
            "in an encoding that is not read, or of types that no given definition (.lcm) has, left out",
        ),
        (skipped.cut_off, "file", "cut off: what stands before is read, what followed is not known"),
        (skipped.unplaced, "line", "of navigation without a position left out"),
        (imported.left_out.unplaced, "position", "outside of the map left out"),
        (imported.left_out.own, "message", "that vehicles heard of themselves left out"),
    ];
    counts
        .into_iter()
        .filter(|(number, ..)| *number > 0)
        .map(|(number, what, why)| format!("{} {why}", count(number, what)))
}

/// Vehicles whose clock no messages compare with the others', and what becomes of them.
fn unknown_clocks(imported: &Imported) -> Option<String> {
    let unknown = imported.clocks.iter().filter(|clock| clock.pieces.is_empty());
    let names: Vec<&str> = unknown.map(|clock| clock.vehicle.as_str()).collect();
    let left_out = imported.unknown().get(&Unknown::ClockUnsure).copied().unwrap_or(0);
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
        counts.0 += pair.unknown.get(&Unknown::NotRecording).copied().unwrap_or(0);
        counts.1 += pair.heard + pair.missed + pair.unknown.values().sum::<usize>();
    }
    let many = |counts: &(usize, usize)| counts.0 as f64 > SILENT_SHARE * counts.1 as f64;
    by_receiver
        .into_iter()
        .filter(|(_, counts)| many(counts))
        .map(|(name, counts)| (name, counts.0, counts.1))
        .collect()
}

/// The pairs, what was left out and why, and the clocks.
pub fn summary(imported: &Imported, taken: &Taken, rules: &Rules) -> String {
    let events = imported.log.events.len();
    let heard = imported.log.events.iter().filter(|event| event.success).count();
    let Proofs { recorded, always_sends, received, nothing } = imported.proofs;
    let mut text = format!(
        "{} ({heard} heard, {} missed) of {}: {recorded} recorded by the sender, {always_sends} by its turn, {received} by a reception alone.\n",
        count(events, "event"),
        events - heard,
        count(recorded + always_sends + received, "transmission"),
    );
    if nothing > 0 {
        text += &format!("{} not known to be used.\n", count(nothing, "turn"));
    }
    text += &format!("Places: {}{}.\n", taken.reference.name(), chosen(taken));
    text += &format!("\n{}\n", pairs(&imported.pairs));
    let times =
        if rules.right_clock.is_some() { "times and places are corrected" } else { "times and places are as recorded" };
    text += &format!("\n{}\n\nClocks by what was sent and heard; {times}.", clocks(&imported.clocks));
    if imported.delay_s > 0.0 {
        text += &format!(
            " A message is recorded {:.2} s after it began, beside the time that sound takes.",
            imported.delay_s
        );
    }
    let left_out = &imported.left_out;
    let more = [
        (left_out.twice, "arrivals recorded twice"),
        (left_out.overheard, "messages meant for others (--overhear)"),
        (taken.skipped.unattributed, "broken messages of unknown senders"),
        (taken.skipped.not_sent, "transmissions that did not take place"),
        (taken.left_alone.len(), "files of no known kind"),
    ];
    let more: Vec<String> =
        more.iter().filter(|more| more.0 > 0).map(|(number, what)| format!("{number} {what}")).collect();
    if !more.is_empty() {
        text += &format!("\nLeft out: {}.", more.join(", "));
    }
    text
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

type Pairs = BTreeMap<(VehicleId, VehicleId), Pair>;

fn pairs(pairs: &Pairs) -> String {
    let reasons: Vec<Unknown> = Unknown::ALL
        .into_iter()
        .filter(|reason| pairs.values().any(|pair| pair.unknown.contains_key(reason)))
        .collect();
    let mut header = vec!["from → to", "heard", "missed"];
    header.extend(reasons.iter().map(|reason| reason.words()));
    let row = |((from, to), pair): (&(_, _), &Pair)| {
        let mut row = vec![format!("{from} → {to}"), pair.heard.to_string(), pair.missed.to_string()];
        row.extend(reasons.iter().map(|reason| pair.unknown.get(reason).map_or("–".into(), ToString::to_string)));
        row
    };
    table(&header, &pairs.iter().map(row).collect::<Vec<_>>())
}

fn clocks(clocks: &[ClockFound]) -> String {
    let rows: Vec<Vec<String>> = clocks.iter().map(clock).collect();
    table(&["clock", "ahead by (s)", "gains (ppm)", "messages", "half are off by less than (s)"], &rows)
}

fn clock(clock: &ClockFound) -> Vec<String> {
    let joined = |text: &dyn Fn(&pingmap_import::Piece) -> String| match clock.pieces.as_slice() {
        [] => "unknown".to_owned(),
        pieces => pieces.iter().map(text).collect::<Vec<_>>().join(", then "),
    };
    let (ahead, gains) = if clock.is_reference {
        ("0 (the others by it)".to_owned(), "–".to_owned())
    } else {
        (joined(&|piece| format!("{:+.2}", piece.ahead_s)), joined(&|piece| format!("{:+.1}", 1e6 * piece.drift)))
    };
    vec![clock.vehicle.to_string(), ahead, gains, clock.comparisons.to_string(), format!("{:.3}", clock.off_s)]
}

/// What was imported, for programs.
#[derive(Serialize, JsonSchema)]
pub struct ImportedJson {
    /// Version of this object.
    schema: u32,
    /// Events that were written.
    events: usize,
    /// Those of them that were heard.
    heard: usize,
    /// By which the events are known again, whatever the file and the order of its lines.
    log_digest: String,
    /// How it is known that something was sent.
    transmissions: ProofsJson,
    /// From whom to whom, by name.
    pairs: Vec<PairJson>,
    /// What is no event since nobody knows whether it was missed, by reason.
    unknown: BTreeMap<&'static str, usize>,
    /// What is known of the vehicles' clocks.
    clocks: Vec<ClockJson>,
    /// From the beginning of a message to the record of its reception, beside the time that sound takes.
    delay_s: f64,
    /// What metres in the log mean.
    reference: String,
    /// Latitude and longitude of the place where both coordinates are 0, in degrees.
    origin: Option<[f64; 2]>,
    /// What was recorded and counts as nothing.
    left_out: LeftOutJson,
}

#[derive(Serialize, JsonSchema)]
pub struct ProofsJson {
    /// Transmissions that their sender recorded.
    recorded: usize,
    /// Turns of a schedule that were taken to be used.
    by_turn: usize,
    /// Transmissions that only receivers tell of.
    by_reception: usize,
    /// Turns of a schedule of which nobody heard: unknown unless every turn is said to be used.
    turns_not_known_to_be_used: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct PairJson {
    /// Who sent.
    transmitter: String,
    /// Who was to hear it.
    receiver: String,
    /// Events that were heard.
    heard: usize,
    /// Events that were missed.
    missed: usize,
    /// What is no event, by reason.
    unknown: BTreeMap<&'static str, usize>,
}

#[derive(Serialize, JsonSchema)]
pub struct ClockJson {
    /// Whose clock.
    vehicle: String,
    /// Whether the others are compared with it.
    is_reference: bool,
    /// How far ahead it is, a piece between times when it was set; empty where nothing is known.
    pieces: Vec<PieceJson>,
    /// Messages that speak of it.
    messages: usize,
    /// Half of them are off by less than this.
    off_s_median: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct PieceJson {
    /// The time for which `ahead_s` holds.
    time_s: f64,
    /// How far ahead of the reference it is then.
    ahead_s: f64,
    /// How fast it gains, in microseconds a second.
    drift_ppm: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct LeftOutJson {
    /// Messages from somebody of whom nothing was recorded, by name.
    of_unknown_vehicles: BTreeMap<String, usize>,
    /// Messages to somebody of whom nothing was recorded, by name.
    to_unknown_vehicles: BTreeMap<String, usize>,
    /// Messages of senders that recorded no such transmission, by name, which are no events; and of senders that had no turn then, which are.
    unexpected: BTreeMap<String, usize>,
    /// Arrivals that were recorded twice.
    recorded_twice: usize,
    /// Messages that were meant for others.
    overheard: usize,
    /// Messages that a vehicle heard of itself.
    of_itself: usize,
    /// Transmissions that failed by the modem's own word.
    not_sent: usize,
    /// Broken arrivals that do not say whose they were.
    broken_of_unknown_senders: usize,
    /// Rows and sentences that make no sense.
    garbled: usize,
    /// Messages in recordings whose type is not known.
    of_no_type: usize,
    /// Files that end within a record.
    cut_off: usize,
    /// Files in folders and archives that were left alone.
    files: usize,
    /// Positions that are no place.
    positions: usize,
}

impl ImportedJson {
    pub fn of(imported: &Imported, taken: &Taken) -> Self {
        let Proofs { recorded, always_sends, received, nothing } = imported.proofs;
        let pair = |((from, to), pair): (&(VehicleId, VehicleId), &Pair)| PairJson {
            transmitter: from.to_string(),
            receiver: to.to_string(),
            heard: pair.heard,
            missed: pair.missed,
            unknown: keys(&pair.unknown),
        };
        let clock = |clock: &ClockFound| ClockJson {
            vehicle: clock.vehicle.to_string(),
            is_reference: clock.is_reference,
            pieces: clock
                .pieces
                .iter()
                .map(|piece| PieceJson { time_s: piece.middle_s, ahead_s: piece.ahead_s, drift_ppm: 1e6 * piece.drift })
                .collect(),
            messages: clock.comparisons,
            off_s_median: clock.off_s,
        };
        let left_out = &imported.left_out;
        let named = |names: &BTreeMap<VehicleId, usize>| {
            names.iter().map(|(name, number)| (name.to_string(), *number)).collect()
        };
        Self {
            schema: 1,
            events: imported.log.events.len(),
            heard: imported.log.events.iter().filter(|event| event.success).count(),
            log_digest: imported.log.digest(),
            transmissions: ProofsJson {
                recorded,
                by_turn: always_sends,
                by_reception: received,
                turns_not_known_to_be_used: nothing,
            },
            pairs: imported.pairs.iter().map(pair).collect(),
            unknown: keys(&imported.unknown()),
            clocks: imported.clocks.iter().map(clock).collect(),
            delay_s: imported.delay_s,
            reference: taken.reference.name(),
            origin: taken.origin.map(|(origin, _)| [origin.latitude_deg, origin.longitude_deg]),
            left_out: LeftOutJson {
                of_unknown_vehicles: named(&left_out.strangers),
                to_unknown_vehicles: named(&left_out.to_strangers),
                unexpected: named(&left_out.unexpected),
                recorded_twice: left_out.twice,
                overheard: left_out.overheard,
                of_itself: left_out.own,
                not_sent: taken.skipped.not_sent,
                broken_of_unknown_senders: taken.skipped.unattributed,
                garbled: taken.skipped.garbled,
                of_no_type: taken.skipped.of_no_type,
                cut_off: taken.skipped.cut_off,
                files: taken.left_alone.len(),
                positions: taken.skipped.unplaced + left_out.unplaced,
            },
        }
    }
}

fn keys(reasons: &BTreeMap<Unknown, usize>) -> BTreeMap<&'static str, usize> {
    reasons.iter().map(|(reason, number)| (reason.key(), *number)).collect()
}
