//! The result of an import: the log, and counts of all that is not in it.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use pingmap_trial::EventLog;

use crate::assemble::clock_estimate::ClockEstimate;
use crate::assemble::pair_counts::PairCounts;
use crate::assemble::vehicles::transmission::{Transmission, TransmissionEvidence};
use crate::assemble::verdict::Contradiction;
use crate::model::exclusion::ExclusionReason;

/// An event log with a report on its origin.
#[derive(Debug, Clone)]
pub struct ImportResult {
    /// The events in the order of time.
    pub log: EventLog,
    /// Counts for each pair of sender and receiver.
    pub pairs: BTreeMap<(VehicleId, VehicleId), PairCounts>,
    /// Number of transmissions by evidence.
    pub evidence: EvidenceCounts,
    /// The estimated clocks.
    pub clocks: Vec<ClockEstimate>,
    /// Median over all senders of the time from the record of a transmission to the record of its reception, without
    /// the travel time of sound, in seconds.
    pub delay_s: f64,
    /// Doubtful properties of the records, as sentences.
    pub warnings: Vec<String>,
    /// Contradictions between the records. A log with contradictions is probably wrong.
    pub contradictions: Vec<Contradiction>,
    /// Counts of records that are in no event.
    pub left_out: LeftOutCounts,
    /// Senders whose transmissions are known by receptions only, separated by commas. Their messages that all receivers
    /// missed are not in the log.
    pub undocumented_senders: String,
    /// Senders whose destinations are known by receptions only, separated by commas. Their messages that all receivers
    /// missed are excluded.
    pub undocumented_destinations: String,
    /// Senders with scheduled slots that may have stayed unused, separated by commas.
    pub unconfirmed_slot_owners: String,
}

impl ImportResult {
    /// Returns how often each reason for exclusion occurred, over all pairs.
    pub fn excluded(&self) -> BTreeMap<ExclusionReason, usize> {
        let mut counts = BTreeMap::new();
        for (&reason, &count) in self.pairs.values().flat_map(|pair| &pair.excluded) {
            *counts.entry(reason).or_default() += count;
        }
        counts
    }
}

/// Number of transmissions by evidence.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct EvidenceCounts {
    /// Transmissions that their sender recorded.
    pub recorded: usize,
    /// Scheduled slots of senders that use every slot.
    pub assumed_slots: usize,
    /// Transmissions that are known by a reception only.
    pub received: usize,
    /// Scheduled slots that may have stayed unused.
    pub unconfirmed_slots: usize,
}

impl EvidenceCounts {
    pub(crate) fn new(transmissions: &[Vec<Transmission>]) -> Self {
        let count = |evidence| {
            transmissions.iter().flatten().filter(|transmission| transmission.total_evidence() == evidence).count()
        };
        Self {
            recorded: count(TransmissionEvidence::Recorded),
            assumed_slots: count(TransmissionEvidence::AssumedSlot),
            received: count(TransmissionEvidence::Received),
            unconfirmed_slots: count(TransmissionEvidence::UnconfirmedSlot),
        }
    }
}

/// Counts of records that are in no event.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct LeftOutCounts {
    /// Messages by source, for sources without a recording.
    pub unknown_sources: BTreeMap<VehicleId, usize>,
    /// Records of messages by destination, for destinations without a recording.
    pub unknown_destinations: BTreeMap<VehicleId, usize>,
    /// Duplicate arrivals.
    pub duplicates: usize,
    /// Messages that a vehicle received from itself.
    pub own_messages: usize,
    /// Messages to other vehicles.
    pub overheard: usize,
    /// Decoded messages that fit no transmission in the sender's record, or no slot of the schedule, by sender.
    pub unexpected: BTreeMap<VehicleId, usize>,
    /// Fixes that the reference system cannot convert to metres.
    pub unprojected: usize,
}
