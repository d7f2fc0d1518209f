//! The transmission schedule: which member may transmit in which slot.

use std::sync::Arc;

use pingmap_packet::SLOTS;
use serde::{Deserialize, Serialize};

use crate::types::event::VehicleId;

/// A TDMA schedule: a fixed cycle of senders, or an explicit list of transmissions.
///
/// Slots are numbered by time, from [`Slots::start_s`] on. A vehicle that misses messages therefore keeps the right
/// slot number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Slots {
    /// Beginning of slot 0, in seconds.
    pub start_s: f64,
    /// Length of a slot in seconds.
    pub duration_s: f64,
    /// Senders of one cycle, from slot 0 on. An empty name continues the slot before it. In a team file without an
    /// order, members transmit in the order of their numbers.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub order: Vec<VehicleId>,
    /// Transmissions in the order of time, in place of a cycle: for logs without a known schedule. The number of a slot
    /// is then its index in this list. Files cannot contain it.
    #[serde(skip)]
    pub explicit: Option<Arc<[ScheduledTransmission]>>,
}

/// One transmission of an explicit schedule.
#[derive(Debug, Clone, PartialEq)]
pub struct ScheduledTransmission {
    /// Time of the transmission, in seconds.
    pub time_s: f64,
    /// The member that transmitted.
    pub sender: VehicleId,
    /// The members that could have received it.
    pub listeners: Vec<VehicleId>,
}

impl Default for Slots {
    /// Returns slots of ten seconds without senders.
    fn default() -> Self {
        Self::cycle(10.0, Vec::new())
    }
}

/// Tolerance of times, in seconds. Times that differ by less are equal.
const SAME_S: f64 = 1e-6;

impl Slots {
    /// Returns a fixed cycle that begins at time 0.
    pub fn cycle(duration_s: f64, order: Vec<VehicleId>) -> Self {
        Self { start_s: 0.0, duration_s, order, explicit: None }
    }

    /// Renumbers the schedule: slot 0 becomes the last beginning of a cycle at or before `time_s`.
    #[must_use]
    pub fn aligned_before(self, time_s: f64) -> Self {
        let cycle_s = self.duration_s * self.order.len().max(1) as f64;
        let start_s = self.start_s + ((time_s - self.start_s) / cycle_s).floor() * cycle_s;
        if start_s.is_finite() { Self { start_s, ..self } } else { self }
    }

    /// Returns the slot of a time. If an explicit schedule has several transmissions at that time, returns the last of
    /// them. Returns `None` before the first slot, after the last numbered slot, and for a time that is not finite.
    pub fn number(&self, time_s: f64) -> Option<u32> {
        let index = self.index(time_s);
        (time_s.is_finite() && (0.0..f64::from(SLOTS)).contains(&index)).then_some(index as u32)
    }

    /// Returns the latest slot that has begun at a time: the last slot of the schedule after its end. `None` before the
    /// first slot.
    pub(crate) fn latest(&self, time_s: f64) -> Option<u32> {
        let index = self.index(time_s).min(f64::from(self.end()) - 1.0);
        (index >= 0.0).then_some(index as u32)
    }

    /// Returns an upper bound on the number of slots of a member up to `latest`. The bound counts the member's slots in
    /// all cycles that have begun, and at least one in each cycle. An explicit schedule counts the slots of all
    /// members.
    pub(crate) fn transmissions(&self, latest: u32, member: Option<&VehicleId>) -> u32 {
        if self.explicit.is_some() {
            return latest.saturating_add(1);
        }
        let in_cycle = self.order.iter().filter(|name| Some(*name) == member).count().max(1);
        (latest / self.cycle_slots() as u32 + 1).saturating_mul(in_cycle as u32)
    }

    /// Returns the slot of any time, which may lie outside the numbered range.
    fn index(&self, time_s: f64) -> f64 {
        match &self.explicit {
            Some(explicit) => explicit.partition_point(|listed| listed.time_s <= time_s + SAME_S) as f64 - 1.0,
            None => ((time_s - self.start_s + SAME_S) / self.duration_s).floor(),
        }
    }

    /// Returns the beginning of a slot, in seconds.
    pub fn begin_s(&self, number: u32) -> Option<f64> {
        match &self.explicit {
            Some(explicit) => explicit.get(number as usize).map(|listed| listed.time_s),
            None => (number < SLOTS).then(|| self.start_s + f64::from(number) * self.duration_s),
        }
    }

    /// Returns the member that may transmit in a slot; `None` for a slot that continues the one before it.
    pub fn sender(&self, number: u32) -> Option<&VehicleId> {
        match &self.explicit {
            Some(explicit) => explicit.get(number as usize).map(|listed| &listed.sender),
            None => self.order.get(number as usize % self.cycle_slots()).filter(|name| !name.as_str().is_empty()),
        }
    }

    /// Returns whether a vehicle could receive another member in a slot.
    pub fn is_heard_by(&self, number: u32, id: &VehicleId) -> bool {
        match &self.explicit {
            Some(explicit) => explicit.get(number as usize).is_some_and(|listed| listed.listeners.contains(id)),
            None => self.sender(number).is_some_and(|sender| sender != id),
        }
    }

    /// Returns the slot of a transmission of this vehicle at this time, if the vehicle may transmit then.
    pub fn sent_in(&self, time_s: f64, id: &VehicleId) -> Option<u32> {
        let number = self.number(time_s)?;
        if let Some(explicit) = &self.explicit {
            let is_now = |slot: &u32| explicit[*slot as usize].time_s >= time_s - 2.0 * SAME_S;
            let simultaneous = std::iter::once(number).chain((0..number).rev().take_while(is_now));
            return simultaneous.into_iter().find(|&slot| explicit[slot as usize].sender == *id);
        }
        self.transmission_slot(number).filter(|&begin| self.sender(begin) == Some(id))
    }

    /// Returns the slot in which the transmission of a slot began: the slot itself, or the one that it continues.
    /// `None` if no slot of the cycle before it has a sender.
    pub fn transmission_slot(&self, number: u32) -> Option<u32> {
        (0..=number).rev().take(self.cycle_slots()).find(|&begin| self.sender(begin).is_some())
    }

    /// Returns the slot of a transmission of this vehicle at this time or, outside its slots, its next slot. `None`
    /// before the first slot, and for a vehicle without further slots.
    pub fn next_slot(&self, time_s: f64, id: &VehicleId) -> Option<u32> {
        let next = || {
            let near = if self.explicit.is_some() { usize::MAX } else { self.cycle_slots() };
            let mut ahead = (self.number(time_s)?..self.end()).skip(1).take(near);
            ahead.find(|&slot| self.sender(slot) == Some(id))
        };
        self.sent_in(time_s, id).or_else(next)
    }

    /// Returns the times at which a transmission of this slot may have been recorded: from its beginning to the end of
    /// its cycle.
    pub(crate) fn span_s(&self, number: u32) -> Option<(f64, f64)> {
        let begin_s = self.begin_s(number)?;
        let length_s = if self.explicit.is_some() { SAME_S } else { self.duration_s * self.cycle_slots() as f64 };
        Some((begin_s - SAME_S, begin_s + length_s + SAME_S))
    }

    /// Returns the beginning of the next slot that has a sender, in seconds. A message of this slot may last until
    /// then.
    pub fn next_begin_s(&self, number: u32) -> Option<f64> {
        let next =
            (number.saturating_add(1)..self.end()).take(self.cycle_slots()).find(|&next| self.sender(next).is_some());
        self.begin_s(next?)
    }

    pub(crate) fn cycle_slots(&self) -> usize {
        self.order.len().max(1)
    }

    /// Returns one more than the number of the last slot.
    pub fn end(&self) -> u32 {
        self.explicit.as_ref().map_or(SLOTS, |explicit| (explicit.len() as u32).min(SLOTS))
    }
}
