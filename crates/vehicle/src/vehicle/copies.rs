//! Copies of the agent, which predict slots without the data that arrived in them.

use std::collections::BTreeMap;

use pingmap_agent::{Agent, AgentError, Entry};

/// Maximum number of stored copies. Slots after the last copy are predicted by it.
const COPIES_MAX: usize = 8;

/// Copies of the agent by slot. The copy of a slot holds the data from before the first input of that slot or of a
/// later one. Heard and missed slots therefore use the same data.
#[derive(Default)]
pub(crate) struct Copies {
    by_slot: BTreeMap<u32, Agent>,
    /// The first slot without input so far. Later copies belong to this slot or to later ones.
    next: u32,
}

impl Copies {
    /// Stores a copy of the agent before an input in a slot, if it is the first one since that slot began. The copy
    /// also serves the slots without input before it, because the agent has not changed since. A copy costs O(n²) for
    /// n events.
    pub(crate) fn add(&mut self, slot: u32, agent: &Agent) {
        if slot < self.next {
            return;
        }
        let first = if self.next == 0 { slot } else { self.next };
        if self.by_slot.len() < COPIES_MAX {
            self.by_slot.insert(first, agent.clone());
        }
        self.next = slot + 1;
    }

    /// Marks the slots up to `slot` as slots with input, without a copy. The last copy before them predicts them.
    pub(crate) fn skip(&mut self, slot: u32) {
        self.next = self.next.max(slot + 1);
    }

    /// Returns the copy that predicts a slot: its own one, or the last one before it.
    pub(crate) fn before(&mut self, slot: u32) -> Option<&mut Agent> {
        self.by_slot.range_mut(..=slot).next_back().map(|(_, agent)| agent)
    }

    /// Adds own outcomes to every copy, because they predict later slots.
    pub(crate) fn apply(&mut self, entries: &[Entry]) -> Result<(), AgentError> {
        for agent in self.by_slot.values_mut() {
            entries.iter().try_for_each(|entry| agent.apply(entry.clone()).map(drop))?;
        }
        Ok(())
    }

    /// Removes the copies that no slot from `next` on uses.
    pub(crate) fn forget_before(&mut self, next: u32) {
        let kept = self.by_slot.range(..=next).next_back().map_or(next, |(&slot, _)| slot);
        self.by_slot = self.by_slot.split_off(&kept);
    }
}
