//! Result of an import in JSON.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ClockEstimate, ClockSegment, EvidenceCounts, ExclusionReason, ImportResult, PairCounts};
use schemars::JsonSchema;
use serde::Serialize;

use super::files::Inputs;

/// Result of an import in JSON.
#[derive(Serialize, JsonSchema)]
pub struct ImportJson {
    /// Version of this object.
    schema: u32,
    /// Number of events that were written.
    events: usize,
    /// Number of these events that were heard.
    heard: usize,
    /// Digest of the events. It does not depend on the file or the order of lines.
    log_digest: String,
    /// Number of transmissions by the evidence for them.
    transmissions: EvidenceJson,
    /// Counts for each transmitter and receiver, ordered by name.
    pairs: Vec<PairJson>,
    /// Messages that are neither heard nor missed for certain, by reason. They yield no events.
    excluded: BTreeMap<&'static str, usize>,
    /// Estimated offsets and drifts of the vehicles' clocks.
    clocks: Vec<ClockJson>,
    /// Median time from the record of a transmission to the record of its reception in seconds, without the travel time
    /// of sound.
    delay_s: f64,
    /// Doubtful properties of the records.
    warnings: Vec<String>,
    /// Contradictions between the records. The log is written only with `--accept-bad-log` then.
    contradictions: Vec<String>,
    /// Reference system of the metres in the log.
    reference: String,
    /// Latitude and longitude of (0, 0) of the log in degrees.
    origin: Option<[f64; 2]>,
    /// Recorded data that yield no events.
    left_out: LeftOutJson,
}

#[derive(Serialize, JsonSchema)]
pub struct EvidenceJson {
    /// Transmissions that the sender recorded.
    recorded: usize,
    /// Slots of a schedule that are assumed to be used.
    by_slot: usize,
    /// Transmissions that only receivers recorded.
    by_reception: usize,
    /// Slots of a schedule without a reception. Their use is unknown unless `--always-transmits` is given.
    slots_of_unknown_use: usize,
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
    excluded: BTreeMap<&'static str, usize>,
    /// Messages to other vehicles.
    overheard: usize,
    /// Transmissions and slots of the transmitter.
    transmissions: usize,
    /// Transmissions with a record of their reception.
    assigned: usize,
    /// Receptions that fit no recorded transmission of the sender.
    unassigned: usize,
    /// Receptions that were recorded twice.
    duplicates: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct ClockJson {
    /// Name of the vehicle.
    vehicle: String,
    /// Whether the other clocks are compared with this clock.
    is_reference: bool,
    /// Offset of the clock in each segment between adjustments. The list is empty if the offset is unknown.
    segments: Vec<SegmentJson>,
    /// Number of messages that were used to compare the clock.
    messages: usize,
    /// Median absolute residual of these messages in seconds.
    median_residual_s: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct SegmentJson {
    /// Time in seconds at which the offset is `offset_s`.
    time_s: f64,
    /// Offset from the reference clock in seconds; positive if ahead.
    offset_s: f64,
    /// Drift in microseconds per second.
    drift_ppm: f64,
}

impl SegmentJson {
    fn new(segment: &ClockSegment) -> Self {
        Self { time_s: segment.middle_s, offset_s: segment.offset_s, drift_ppm: 1e6 * segment.drift }
    }
}

#[derive(Serialize, JsonSchema)]
pub struct LeftOutJson {
    /// Messages from vehicles without records, by name.
    unknown_sources: BTreeMap<String, usize>,
    /// Messages to vehicles without records, by name.
    unknown_destinations: BTreeMap<String, usize>,
    /// Receptions that match no transmission of a sender with records, by name; they yield no events. Receptions
    /// outside the sender's slots are counted, too, but yield events.
    unexpected: BTreeMap<String, usize>,
    /// Receptions that were recorded twice.
    duplicates: usize,
    /// Messages to other vehicles.
    overheard: usize,
    /// Messages that a vehicle received from itself.
    own_messages: usize,
    /// Transmissions that failed according to the modem.
    failed_transmissions: usize,
    /// Damaged messages without a readable sender.
    unattributed: usize,
    /// Rows and sentences that cannot be parsed.
    garbled: usize,
    /// Recorded messages of unknown types.
    unknown_type: usize,
    /// Modem sentences with unknown names, by name. They may hold transmissions or receptions.
    unknown_sentences: BTreeMap<String, usize>,
    /// Files that end within a record.
    truncated: usize,
    /// Damaged places of logs: chunks of MCAP files, and bytes between events of LCM logs.
    damaged: usize,
    /// Files in folders and archives whose kind is unknown.
    files: usize,
    /// Positions that are invalid.
    positions: usize,
}

impl LeftOutJson {
    fn new(imported: &ImportResult, inputs: &Inputs) -> Self {
        let left_out = &imported.left_out;
        let sentences = inputs.skipped.unknown_sentences.iter();
        let named = |names: &BTreeMap<VehicleId, usize>| {
            names.iter().map(|(name, number)| (name.to_string(), *number)).collect()
        };
        Self {
            unknown_sources: named(&left_out.unknown_sources),
            unknown_destinations: named(&left_out.unknown_destinations),
            unexpected: named(&left_out.unexpected),
            duplicates: left_out.duplicates,
            overheard: left_out.overheard,
            own_messages: left_out.own_messages,
            failed_transmissions: inputs.skipped.failed_transmissions,
            unattributed: inputs.skipped.unattributed,
            garbled: inputs.skipped.garbled,
            unknown_type: inputs.skipped.unknown_type,
            unknown_sentences: sentences.map(|(name, number)| (name.to_owned(), number)).collect(),
            truncated: inputs.skipped.truncated,
            damaged: inputs.skipped.damaged,
            files: inputs.unknown_files.len(),
            positions: inputs.skipped.missing_positions + left_out.unprojected,
        }
    }
}

impl ImportJson {
    pub fn new(imported: &ImportResult, inputs: &Inputs) -> Self {
        let EvidenceCounts { recorded, assumed_slots, received, unconfirmed_slots } = imported.evidence;
        let pair = |((sender, receiver), pair): (&(VehicleId, VehicleId), &PairCounts)| PairJson {
            transmitter: sender.to_string(),
            receiver: receiver.to_string(),
            heard: pair.heard,
            missed: pair.missed,
            excluded: keys(&pair.excluded),
            overheard: pair.overheard,
            transmissions: pair.transmissions,
            assigned: pair.assigned,
            unassigned: pair.unassigned,
            duplicates: pair.duplicates,
        };
        let clock = |clock: &ClockEstimate| ClockJson {
            vehicle: clock.vehicle.to_string(),
            is_reference: clock.is_reference,
            segments: clock.segments.iter().map(SegmentJson::new).collect(),
            messages: clock.comparisons,
            median_residual_s: clock.median_residual_s,
        };
        Self {
            schema: 1,
            events: imported.log.events.len(),
            heard: imported.log.events.iter().filter(|event| event.success).count(),
            log_digest: imported.log.digest(),
            transmissions: EvidenceJson {
                recorded,
                by_slot: assumed_slots,
                by_reception: received,
                slots_of_unknown_use: unconfirmed_slots,
            },
            pairs: imported.pairs.iter().map(pair).collect(),
            excluded: keys(&imported.excluded()),
            clocks: imported.clocks.iter().map(clock).collect(),
            delay_s: imported.delay_s,
            warnings: imported.warnings.clone(),
            contradictions: imported.contradictions.iter().map(ToString::to_string).collect(),
            reference: inputs.reference.name(),
            origin: inputs.origin.map(|(origin, _)| [origin.latitude_deg, origin.longitude_deg]),
            left_out: LeftOutJson::new(imported, inputs),
        }
    }
}

fn keys(reasons: &BTreeMap<ExclusionReason, usize>) -> BTreeMap<&'static str, usize> {
    reasons.iter().map(|(reason, number)| (reason.key(), *number)).collect()
}
