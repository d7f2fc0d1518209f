//! The content of one log file.

use pingmap_agent::{Geographic, VehicleId};

use crate::model::recording::Recording;

/// Number of lines and messages that yield no record, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SkipCounts {
    /// Fixes without a position.
    pub missing_positions: usize,
    /// Broken receptions from an unknown sender.
    pub unattributed: usize,
    /// Transmissions that did not take place by the sender's own record.
    pub failed_transmissions: usize,
    /// Lines or messages that cannot be parsed.
    pub garbled: usize,
    /// Messages of unknown types.
    pub unknown_type: usize,
    /// Files that end within a record.
    pub truncated: usize,
}

impl SkipCounts {
    /// Adds two counts.
    #[must_use]
    pub fn sum(self, other: Self) -> Self {
        Self {
            missing_positions: self.missing_positions + other.missing_positions,
            unattributed: self.unattributed + other.unattributed,
            failed_transmissions: self.failed_transmissions + other.failed_transmissions,
            garbled: self.garbled + other.garbled,
            unknown_type: self.unknown_type + other.unknown_type,
            truncated: self.truncated + other.truncated,
        }
    }
}

/// The content of one log file.
#[derive(Debug, Clone, Default)]
pub(crate) struct ParsedFile {
    pub(crate) recording: Recording,
    /// The vehicle that the file names as its owner.
    pub(crate) name: Option<VehicleId>,
    /// The datum of its metres, if the file determines it.
    pub(crate) datum: Option<Geographic>,
    pub(crate) skipped: SkipCounts,
}
