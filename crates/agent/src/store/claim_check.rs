//! Compares claims of unused slots with the vehicle's own receptions.

use std::collections::{BTreeMap, BTreeSet};

/// Number of contradicted claims at which no claim of a member counts any longer.
const CONTRADICTIONS_MAX: usize = 3;

/// Claims that the vehicle's own receptions contradict: a member reported that it did not transmit in a slot, but the
/// vehicle recorded a reception in it.
///
/// A host that fails to log its transmissions makes such claims by accident. Single contradictions are allowed for.
/// Receptions that other members report do not count here, because a faulty receiver could discredit every other
/// member.
#[derive(Debug, Clone, Default)]
pub(crate) struct ClaimCheck {
    contradicted: BTreeMap<u8, BTreeSet<u32>>,
}

impl ClaimCheck {
    /// Adds a contradicted claim. O(log N).
    pub(crate) fn insert(&mut self, member: u8, slot: u32) {
        self.contradicted.entry(member).or_default().insert(slot);
    }

    /// Removes contradictions of a member whose claims or receptions are no longer stored. Returns whether its claims
    /// count again.
    pub(crate) fn retain(&mut self, member: u8, is_contradicted: impl Fn(u32) -> bool) -> bool {
        let was_reliable = self.is_reliable(member);
        if let Some(slots) = self.contradicted.get_mut(&member) {
            slots.retain(|&slot| is_contradicted(slot));
        }
        !was_reliable && self.is_reliable(member)
    }

    /// Returns whether the claims of a member count.
    pub(crate) fn is_reliable(&self, member: u8) -> bool {
        self.contradicted.get(&member).is_none_or(|slots| slots.len() < CONTRADICTIONS_MAX)
    }
}
