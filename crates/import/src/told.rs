//! What a file told, and what of it says nothing.

use pingmap_agent::{Geographic, VehicleId};

use crate::recording::Recording;

/// Lines that say nothing for the log.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Skipped {
    /// Fixes without a position.
    pub unplaced: usize,
    /// Receptions that were not decoded and whose sender is not known.
    pub unattributed: usize,
    /// Transmissions that did not take place, by their senders' word.
    pub not_sent: usize,
    /// Lines that are none of their kind, or were garbled.
    pub garbled: usize,
    /// Messages of types that are not known.
    pub of_no_type: usize,
    /// Files that end in the middle of something.
    pub cut_off: usize,
}

impl Skipped {
    /// Both together.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            unplaced: self.unplaced + other.unplaced,
            unattributed: self.unattributed + other.unattributed,
            not_sent: self.not_sent + other.not_sent,
            garbled: self.garbled + other.garbled,
            of_no_type: self.of_no_type + other.of_no_type,
            cut_off: self.cut_off + other.cut_off,
        }
    }
}

/// What a file told.
#[derive(Debug, Clone, Default)]
pub(crate) struct Told {
    pub(crate) recording: Recording,
    /// Whose it is, by its own word.
    pub(crate) name: Option<VehicleId>,
    pub(crate) datum: Option<Geographic>,
    pub(crate) skipped: Skipped,
}
