//! Warnings of an import as text.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{
    ClockEstimate, ExclusionReason, ImportResult, IsolatedFixes, PairCounts, Place, Rules, time_in_words,
};

use super::files::Inputs;
use crate::output::count;

/// Smallest clock offset in seconds that causes a warning.
const CLOCK_OFFSET_S: f64 = 0.5;

/// Largest number of unknown sentences that are named.
const SENTENCES_NAMED_MAX: usize = 8;

/// Smallest share of messages outside a modem's records that causes a warning.
const INACTIVE_SHARE: f64 = 0.1;

/// Returns warnings that the user should read before using the log.
pub fn warnings(imported: &ImportResult, inputs: &Inputs, rules: &Rules) -> Vec<String> {
    let mut warnings = sender_warnings(imported, rules);
    for (receiver, excluded, all) in inactive_receivers(&imported.pairs) {
        warnings.push(format!(
            "{excluded} of {all} messages lie before the first or after the last record of {receiver}'s modem and are left out: if the modem \
             was listening, give the interval with --listening {receiver}=FROM/TO"
        ));
    }
    let has_large_offset =
        |clock: &&ClockEstimate| clock.segments.iter().any(|segment| segment.offset_s.abs() > CLOCK_OFFSET_S);
    if rules.reference_clock.is_none() && imported.clocks.iter().any(|clock| has_large_offset(&clock)) {
        warnings.push(
            "clocks differ, and times and positions are as recorded: --correct-clocks NAME corrects them to the clock of NAME"
                .into(),
        );
    }
    warnings.extend(imported.warnings.iter().cloned());
    warnings.extend(unknown_clocks(imported));
    for (name, messages) in imported.left_out.unknown_sources.iter().chain(&inputs.unknown_sources) {
        let messages = count(*messages, "message");
        warnings.push(format!(
            "{messages} from {name}, a vehicle without records, left out (--ids gives the vehicle of each id)"
        ));
    }
    for (name, messages) in imported.left_out.unknown_destinations.iter().filter(|_| !rules.overhear) {
        warnings.push(format!(
            "{} to {name}, a vehicle without records, left out: if {name} means all vehicles, or is another name of a vehicle, add it to --ids",
            count(*messages, "message")
        ));
    }
    for (name, messages) in &imported.left_out.unexpected {
        let messages = count(*messages, "message");
        warnings.push(format!(
            "{messages} from {name} fit no recorded transmission or slot: check the end of its records, the clocks and the ids"
        ));
    }
    warnings.extend(inputs.isolated_fixes.iter().map(isolated_fixes));
    warnings.extend(unknown_sentences(inputs));
    warnings.extend(left_out(imported, inputs));
    warnings
}

/// Warns about senders whose transmissions, destinations or use of slots are not recorded.
fn sender_warnings(imported: &ImportResult, rules: &Rules) -> Vec<String> {
    let mut warnings = Vec::new();
    if !imported.undocumented_senders.is_empty() {
        warnings.push(format!(
            "only receptions of messages from {} are recorded, so a message counts for a receiver only if another receiver recorded it, and \
             the map will be optimistic: give the transmissions (--sent) or the schedule (--schedule)",
            imported.undocumented_senders
        ));
    }
    if !imported.undocumented_destinations.is_empty() && !rules.overhear {
        warnings.push(format!(
            "only receivers recorded the destinations of {}, so messages without a reception are left out and the map will be optimistic: \
             add destinations to the recorded transmissions, or use --overhear to count every message for every receiver",
            imported.undocumented_destinations
        ));
    }
    if !imported.unconfirmed_slot_owners.is_empty() {
        warnings.push(format!(
            "{} of {} without a reception may not have been used and are left out, so the map will be optimistic: give the transmissions \
             (--sent), or use --always-transmits if all slots are used",
            count(imported.evidence.unconfirmed_slots, "slot"),
            imported.unconfirmed_slot_owners
        ));
    }
    warnings
}

/// Warns about positions that were excluded because they lie far from the rest of their track.
fn isolated_fixes(IsolatedFixes { vehicle, fixes, first, distance_m }: &IsolatedFixes) -> String {
    let place = match first.place {
        Place::Degrees(place) => format!("{:.4}, {:.4}", place.latitude_deg, place.longitude_deg),
        Place::Metres(east_m, north_m) => format!("({east_m:.0}, {north_m:.0}) m"),
    };
    format!(
        "{} of {vehicle} left out, the first at {place}, {}, {:.0} km from its other positions",
        count(*fixes, "position"),
        time_in_words(first.time_s),
        distance_m / 1000.0
    )
}

/// Warns about modem sentences that no reader absorbs, and names the most frequent ones.
fn unknown_sentences(inputs: &Inputs) -> Option<String> {
    let mut counts: Vec<(&str, usize)> = inputs.skipped.unknown_sentences.iter().collect();
    counts.sort_by_key(|(_, number)| Reverse(*number));
    let all: usize = counts.iter().map(|(_, number)| number).sum();
    let mut names: Vec<String> =
        counts.iter().take(SENTENCES_NAMED_MAX).map(|(name, number)| format!("{number} {name}")).collect();
    names.extend((counts.len() > SENTENCES_NAMED_MAX).then(|| "others".to_owned()));
    (all > 0).then(|| {
        format!(
            "{} of a modem left out, because their names are unknown ({}): if they are transmissions or receptions, events are missing, \
             and --sent and --heard can add them as tables",
            count(all, "sentence"),
            names.join(", ")
        )
    })
}

/// Warns about data that yield no event and should not occur, one warning for each kind.
fn left_out(imported: &ImportResult, inputs: &Inputs) -> impl Iterator<Item = String> {
    let skipped = &inputs.skipped;
    let without_position = match inputs.events {
        Some(_) => "without a position left out",
        None => "of navigation without a position left out",
    };
    let counts = [
        (skipped.garbled, "line", "garbled or of the wrong kind left out"),
        (
            skipped.unknown_type,
            "message",
            "in an unsupported encoding, or of types without a definition (.lcm), left out",
        ),
        (skipped.truncated, "file", "cut off within a record: only the records before are read"),
        (
            skipped.damaged,
            "damaged place",
            "of logs (chunks of MCAP files, bytes between events of LCM logs) left out; messages at these times do not count",
        ),
        (skipped.missing_positions, "line", without_position),
        (imported.left_out.unprojected, "position", "outside of the map left out"),
        (imported.left_out.own_messages, "message", "that vehicles received from themselves left out"),
    ];
    counts
        .into_iter()
        .filter(|(number, ..)| *number > 0)
        .map(|(number, noun, explanation)| format!("{} {explanation}", count(number, noun)))
}

/// Warns about vehicles whose clock no two messages compare with another clock.
fn unknown_clocks(imported: &ImportResult) -> Option<String> {
    let unknown = imported.clocks.iter().filter(|clock| clock.segments.is_empty());
    let names: Vec<&str> = unknown.map(|clock| clock.vehicle.as_str()).collect();
    let left_out = imported.excluded().get(&ExclusionReason::ClockUncertain).copied().unwrap_or(0);
    (!names.is_empty()).then(|| {
        format!(
            "no two messages compare the clock of {} with the others': positions stay as recorded, and {left_out} messages are \
             left out: use --clock-offset-s-max 0 if the clocks agree",
            names.join(", ")
        )
    })
}

/// Returns receivers with many messages outside their modem's records: the number of these messages, and of all
/// messages.
fn inactive_receivers(pairs: &BTreeMap<(VehicleId, VehicleId), PairCounts>) -> Vec<(&VehicleId, usize, usize)> {
    let mut by_receiver: BTreeMap<&VehicleId, (usize, usize)> = BTreeMap::new();
    for ((_, receiver), pair) in pairs {
        let counts = by_receiver.entry(receiver).or_default();
        counts.0 += pair.excluded.get(&ExclusionReason::NotRecording).copied().unwrap_or(0);
        counts.1 += pair.heard + pair.missed + pair.excluded.values().sum::<usize>();
    }
    let is_large = |counts: &(usize, usize)| counts.0 as f64 > INACTIVE_SHARE * counts.1 as f64;
    by_receiver
        .into_iter()
        .filter(|(_, counts)| is_large(counts))
        .map(|(name, counts)| (name, counts.0, counts.1))
        .collect()
}
