//! Counts of one sender and one receiver.

use std::collections::BTreeMap;

use crate::model::exclusion::ExclusionReason;

/// The counts by receiver and sender.
pub(crate) type PairTable = BTreeMap<(usize, usize), PairCounts>;

/// Counts of the messages from one vehicle to another.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PairCounts {
    /// Transmissions and slots of the sender.
    pub transmissions: usize,
    /// Transmissions with a record of their reception, whether the message was decoded or not.
    pub assigned: usize,
    /// Decoded messages that fit no transmission in the sender's record.
    pub unassigned: usize,
    /// Duplicate arrivals.
    pub duplicates: usize,
    /// Events with a decoded message.
    pub heard: usize,
    /// Events with a missed message.
    pub missed: usize,
    /// Transmissions that yield no event, by reason.
    pub excluded: BTreeMap<ExclusionReason, usize>,
    /// Messages to other vehicles.
    pub overheard: usize,
}
