//! What was imported, for programs.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_import::{ClockEstimate, EvidenceCounts, ExclusionReason, ImportResult, PairCounts};
use schemars::JsonSchema;
use serde::Serialize;

use super::files::Taken;

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
    /// Messages that were meant for others.
    overheard: usize,
    /// Messages that fit nothing which their sender recorded.
    stray: usize,
    /// Arrivals that were recorded twice.
    recorded_twice: usize,
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
            pieces: clock
                .segments
                .iter()
                .map(|piece| PieceJson {
                    time_s: piece.middle_s,
                    ahead_s: piece.offset_s,
                    drift_ppm: 1e6 * piece.drift,
                })
                .collect(),
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
