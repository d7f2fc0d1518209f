//! Result of an import in JSON.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ClockEstimate, ClockSegment, EvidenceCounts, ExclusionReason, ImportResult, PairCounts};
use schemars::JsonSchema;
use serde::Serialize;

use super::files::Taken;

/// Result of an import in JSON.
#[derive(Serialize, JsonSchema)]
pub struct ImportedJson {
    /// Version of this object.
    schema: u32,
    /// Number of events that were written.
    events: usize,
    /// Number of these events that were heard.
    heard: usize,
    /// Digest of the events. It does not depend on the file or the order of lines.
    log_digest: String,
    /// Number of transmissions by the evidence for them.
    transmissions: ProofsJson,
    /// Counts for each transmitter and receiver, ordered by name.
    pairs: Vec<PairJson>,
    /// Messages that are neither heard nor missed for certain, by reason. They yield no events.
    unknown: BTreeMap<&'static str, usize>,
    /// Estimated offsets and drifts of the vehicles' clocks.
    clocks: Vec<ClockJson>,
    /// Time from the start of a message to the record of its reception in seconds, without the travel time of sound.
    delay_s: f64,
    /// Reference system of the metres in the log.
    reference: String,
    /// Latitude and longitude of (0, 0) of the log in degrees.
    origin: Option<[f64; 2]>,
    /// Recorded data that yield no events.
    left_out: LeftOutJson,
}

#[derive(Serialize, JsonSchema)]
pub struct ProofsJson {
    /// Transmissions that the sender recorded.
    recorded: usize,
    /// Slots of a schedule that are assumed to be used.
    by_turn: usize,
    /// Transmissions that only receivers recorded.
    by_reception: usize,
    /// Slots of a schedule without a reception. Their use is unknown unless `--always-sends` is given.
    turns_not_known_to_be_used: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct PairJson {
    /// Name of the transmitter.
    transmitter: String,
    /// Name of the receiver.
    receiver: String,
    /// Number of events that were heard.
    heard: usize,
    /// Number of events that were missed.
    missed: usize,
    /// Messages that are neither heard nor missed for certain, by reason.
    unknown: BTreeMap<&'static str, usize>,
    /// Messages to other vehicles.
    overheard: usize,
    /// Receptions that match no recorded transmission of the sender.
    stray: usize,
    /// Receptions that were recorded twice.
    recorded_twice: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct ClockJson {
    /// Name of the vehicle.
    vehicle: String,
    /// Whether the other clocks are compared with this clock.
    is_reference: bool,
    /// Offsets of the clock in pieces between adjustments. The list is empty if the offset is unknown.
    pieces: Vec<PieceJson>,
    /// Number of messages that were used to compare the clock.
    messages: usize,
    /// Median absolute residual of these messages in seconds.
    off_s_median: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct PieceJson {
    /// Time in seconds at which the offset is `ahead_s`.
    time_s: f64,
    /// Offset from the reference clock in seconds; positive if ahead.
    ahead_s: f64,
    /// Drift in microseconds per second.
    drift_ppm: f64,
}

impl PieceJson {
    fn of(segment: &ClockSegment) -> Self {
        Self { time_s: segment.middle_s, ahead_s: segment.offset_s, drift_ppm: 1e6 * segment.drift }
    }
}

#[derive(Serialize, JsonSchema)]
pub struct LeftOutJson {
    /// Messages from vehicles without records, by name.
    of_unknown_vehicles: BTreeMap<String, usize>,
    /// Messages to vehicles without records, by name.
    to_unknown_vehicles: BTreeMap<String, usize>,
    /// Receptions that match no transmission of a sender with records, by name; they yield no events. Receptions
    /// outside the sender's slots are counted, too, but yield events.
    unexpected: BTreeMap<String, usize>,
    /// Receptions that were recorded twice.
    recorded_twice: usize,
    /// Messages to other vehicles.
    overheard: usize,
    /// Messages that a vehicle received from itself.
    of_itself: usize,
    /// Transmissions that failed according to the modem.
    not_sent: usize,
    /// Damaged messages without a readable sender.
    broken_of_unknown_senders: usize,
    /// Rows and sentences that cannot be parsed.
    garbled: usize,
    /// Recorded messages of unknown types.
    of_no_type: usize,
    /// Files that end within a record.
    cut_off: usize,
    /// Files in folders and archives whose kind is unknown.
    files: usize,
    /// Positions that are invalid.
    positions: usize,
}

impl ImportedJson {
    pub fn of(imported: &ImportResult, taken: &Taken) -> Self {
        let EvidenceCounts { recorded, always_sends, received, scheduled_only } = imported.evidence;
        let pair = |((from, to), pair): (&(VehicleId, VehicleId), &PairCounts)| PairJson {
            transmitter: from.to_string(),
            receiver: to.to_string(),
            heard: pair.heard,
            missed: pair.missed,
            unknown: keys(&pair.excluded),
            overheard: pair.overheard,
            stray: pair.unmatched,
            recorded_twice: pair.duplicates,
        };
        let clock = |clock: &ClockEstimate| ClockJson {
            vehicle: clock.vehicle.to_string(),
            is_reference: clock.is_reference,
            pieces: clock.segments.iter().map(PieceJson::of).collect(),
            messages: clock.comparisons,
            off_s_median: clock.median_residual_s,
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
                turns_not_known_to_be_used: scheduled_only,
            },
            pairs: imported.pairs.iter().map(pair).collect(),
            unknown: keys(&imported.excluded()),
            clocks: imported.clocks.iter().map(clock).collect(),
            delay_s: imported.delay_s,
            reference: taken.reference.name(),
            origin: taken.origin.map(|(origin, _)| [origin.latitude_deg, origin.longitude_deg]),
            left_out: LeftOutJson {
                of_unknown_vehicles: named(&left_out.unknown_sources),
                to_unknown_vehicles: named(&left_out.unknown_destinations),
                unexpected: named(&left_out.unexpected),
                recorded_twice: left_out.duplicates,
                overheard: left_out.overheard,
                of_itself: left_out.own_messages,
                not_sent: taken.skipped.not_sent,
                broken_of_unknown_senders: taken.skipped.unattributed,
                garbled: taken.skipped.garbled,
                of_no_type: taken.skipped.unknown_type,
                cut_off: taken.skipped.truncated,
                files: taken.left_alone.len(),
                positions: taken.skipped.without_position + left_out.unprojected,
            },
        }
    }
}

fn keys(reasons: &BTreeMap<ExclusionReason, usize>) -> BTreeMap<&'static str, usize> {
    reasons.iter().map(|(reason, number)| (reason.key(), *number)).collect()
}
