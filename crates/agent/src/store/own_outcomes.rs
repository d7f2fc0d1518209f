//! The vehicle's own outcomes without positions.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::store::reports::{ReportedOutcome, add_outcome};
use crate::team::slots::Slots;
use crate::types::event::VehicleId;

/// A time in seconds, which can be the key of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Seconds(pub(crate) f64);

impl Eq for Seconds {}

impl PartialOrd for Seconds {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Seconds {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// An outcome of the vehicle itself, in a numbered slot.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct OwnOutcome {
    /// Slot of the time, whoever may transmit in it.
    slot: u32,
    pub(crate) time_s: Seconds,
    pub(crate) transmitter_id: VehicleId,
    pub(crate) success: bool,
}

/// Effect of a new outcome on [`OwnOutcomes`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum OutcomeEffect {
    /// The outcome is stored already, or is too old.
    Unchanged,
    Added,
    /// The outcome is stored, and the oldest ones are not stored any more.
    ForgotOldest,
}

/// Outcomes that the vehicle recorded without the positions of the ends. Those of the latest slots are stored.
#[derive(Debug, Clone)]
pub(crate) struct OwnOutcomes {
    window_slots: u32,
    all: BTreeSet<OwnOutcome>,
    /// Outcomes in slots of their transmitters.
    by_slot: BTreeMap<u32, ReportedOutcome>,
}

impl OwnOutcomes {
    pub(crate) fn new(window_slots: usize) -> Self {
        let window_slots = u32::try_from(window_slots.max(1)).unwrap_or(u32::MAX);
        Self { window_slots, all: BTreeSet::new(), by_slot: BTreeMap::new() }
    }

    /// Inserts an outcome. O(log N). `None` for a time without a numbered slot.
    pub(crate) fn insert(
        &mut self,
        slots: &Slots,
        transmitter_id: &VehicleId,
        time_s: f64,
        success: bool,
    ) -> Option<OutcomeEffect> {
        let slot = slots.number(time_s)?;
        let outcome = OwnOutcome { slot, time_s: Seconds(time_s), transmitter_id: transmitter_id.clone(), success };
        if slot < self.first_kept_slot() || !self.all.insert(outcome) {
            return Some(OutcomeEffect::Unchanged);
        }
        let first_kept = self.first_kept_slot();
        if let Some(begin) = slots.sent_in(time_s, transmitter_id).filter(|&begin| begin >= first_kept) {
            add_outcome(&mut self.by_slot, begin, success);
        }
        if self.all.first().is_none_or(|oldest| oldest.slot >= first_kept) {
            return Some(OutcomeEffect::Added);
        }
        self.all.retain(|outcome| outcome.slot >= first_kept);
        self.by_slot.retain(|&slot, _| slot >= first_kept);
        Some(OutcomeEffect::ForgotOldest)
    }

    /// Returns the first slot that is kept, given the latest one. Slots are forgotten a sixteenth of the window at a
    /// time.
    fn first_kept_slot(&self) -> u32 {
        let step = (self.window_slots / 16).max(1);
        let latest = self.all.last().map_or(0, |outcome| outcome.slot);
        latest.saturating_sub(self.window_slots) / step * step
    }

    /// Returns all outcomes in the order of time.
    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = &OwnOutcome> {
        self.all.iter()
    }

    /// Returns the outcomes in slots of their transmitters.
    pub(crate) fn in_slots(&self, slots: Range<u32>) -> impl Iterator<Item = (u32, ReportedOutcome)> {
        self.by_slot.range(slots).map(|(&slot, &outcome)| (slot, outcome))
    }

    pub(crate) fn has_heard(&self, slot: u32) -> bool {
        self.by_slot.get(&slot).is_some_and(|&outcome| outcome != ReportedOutcome::Missed)
    }
}
