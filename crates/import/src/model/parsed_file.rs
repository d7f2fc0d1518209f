//! The content of one log file.

use std::collections::BTreeMap;

use pingmap_agent::{Geographic, VehicleId};

use crate::model::recording::Recording;

/// Largest number of sentence names that are counted separately.
const NAMES_MAX: usize = 32;

/// Longest name that is counted separately, in bytes.
const NAME_BYTES_MAX: usize = 8;

/// The count of all sentences with further or longer names.
const OTHER_NAMES: &str = "others";

/// Number of modem sentences by name. The number of names is bounded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SentenceCounts(BTreeMap<String, usize>);

impl SentenceCounts {
    /// Adds a number of sentences.
    pub(crate) fn add(&mut self, name: &str, number: usize) {
        let is_counted = self.0.contains_key(name) || name.len() <= NAME_BYTES_MAX && self.0.len() < NAMES_MAX;
        *self.0.entry(if is_counted { name } else { OTHER_NAMES }.to_owned()).or_default() += number;
    }

    /// Returns each name with its number of sentences, in the order of the names.
    pub fn iter(&self) -> impl Iterator<Item = (&str, usize)> {
        self.0.iter().map(|(name, number)| (name.as_str(), *number))
    }
}

/// Number of lines and messages that yield no record, by reason.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SkipCounts {
    /// Fixes without a position: an empty field, NaN, latitude and longitude 0, or a receiver without a fix.
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
    /// Modem sentences that no reader absorbs, but that may hold transmissions or receptions.
    pub unknown_sentences: SentenceCounts,
    /// Damaged places of logs, which the reader left out: chunks of MCAP files, and bytes between events of LCM logs.
    pub damaged: usize,
}

impl SkipCounts {
    /// Adds two counts.
    #[must_use]
    pub fn sum(&self, other: Self) -> Self {
        let mut unknown_sentences = self.unknown_sentences.clone();
        other.unknown_sentences.iter().for_each(|(name, number)| unknown_sentences.add(name, number));
        Self {
            missing_positions: self.missing_positions + other.missing_positions,
            unattributed: self.unattributed + other.unattributed,
            failed_transmissions: self.failed_transmissions + other.failed_transmissions,
            garbled: self.garbled + other.garbled,
            unknown_type: self.unknown_type + other.unknown_type,
            truncated: self.truncated + other.truncated,
            unknown_sentences,
            damaged: self.damaged + other.damaged,
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
