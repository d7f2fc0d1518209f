//! Detects members whose messages arrive outside their slots: their clock, or their schedule, differs from the
//! vehicle's.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::team::slots::Slots;
use crate::types::event::VehicleId;

/// Number of consecutive receptions outside its slots which show that a member does not conform to the schedule.
const RUN: usize = 4;

/// Minimum number of recorded misses in slot for each miss outside its sender's slot. With fewer of them the vehicle
/// itself does not use the schedule.
const MISSES_PER_OUTLIER: usize = 8;

/// Number of an outcome without an event.
pub(crate) const WITHOUT_EVENT: u64 = u64::MAX;

/// Largest clock offset that is examined, in slots.
const OFFSET_MAX: i32 = 31;

/// A reception, by time and number of its event, or [`WITHOUT_EVENT`].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reception {
    time_s: f64,
    number: u64,
    is_in_slot: bool,
}

/// The vehicle's own receptions and misses in comparison with the schedule.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct SlotConformance {
    /// Receptions of each member, in the order of time.
    receptions: BTreeMap<VehicleId, Arc<Vec<Reception>>>,
    /// Receptions outside their slots.
    outliers: usize,
    misses_in_slot: usize,
    misses_out_of_slot: usize,
}

impl SlotConformance {
    /// Adds an outcome of the vehicle with another member under a fixed schedule. Returns the times between which other
    /// events of that member may change: they may now count, or no longer. O(log N) for an event that is the latest.
    pub(crate) fn insert(
        &mut self,
        slots: &Slots,
        transmitter_id: &VehicleId,
        (time_s, number): (f64, u64),
        success: bool,
    ) -> Option<(f64, f64)> {
        if slots.explicit.is_some() || slots.number(time_s).is_none() {
            return None;
        }
        let was_active = self.is_active();
        let is_in_slot = slots.sent_in(time_s, transmitter_id).is_some();
        let mut affected = None;
        if success {
            self.outliers += usize::from(!is_in_slot);
            let receptions = Arc::make_mut(self.receptions.entry(transmitter_id.clone()).or_default());
            let index = receptions.partition_point(|other| (other.time_s, other.number) < (time_s, number));
            receptions.insert(index, Reception { time_s, number, is_in_slot });
            let near = index.saturating_sub(RUN)..receptions.len().min(index + RUN + 1);
            if receptions[near.clone()].iter().any(|other| !other.is_in_slot) {
                let begin_s = if near.start == 0 { f64::NEG_INFINITY } else { receptions[near.start].time_s };
                affected = Some((begin_s, receptions.get(near.end).map_or(f64::INFINITY, |other| other.time_s)));
            }
        } else {
            *if is_in_slot { &mut self.misses_in_slot } else { &mut self.misses_out_of_slot } += 1;
        }
        match self.is_active() == was_active || self.outliers < RUN {
            true => affected,
            false => Some((f64::NEG_INFINITY, f64::INFINITY)),
        }
    }

    /// Returns whether the vehicle records misses by this schedule, so that receptions can be compared with it.
    fn is_active(&self) -> bool {
        self.misses_in_slot >= RUN && MISSES_PER_OUTLIER * self.misses_out_of_slot <= self.misses_in_slot
    }

    /// Returns whether every member conforms to the schedule at all times.
    pub(crate) fn is_clean(&self) -> bool {
        self.outliers < RUN || !self.is_active()
    }

    /// Returns whether a member did not conform to the schedule at a time. The last reception by then, or the first of
    /// all, is then one of four consecutive receptions outside its slots. O(log N).
    pub(crate) fn is_out_of_slot(&self, id: &VehicleId, time_s: f64) -> bool {
        if self.is_clean() {
            return false;
        }
        let Some(receptions) = self.receptions.get(id) else { return false };
        let last = receptions.partition_point(|reception| reception.time_s <= time_s).saturating_sub(1);
        let begins = (0..RUN).filter_map(|before| last.checked_sub(before));
        let mut runs = begins.filter_map(|begin| receptions.get(begin..begin + RUN));
        runs.any(|run| run.iter().all(|reception| !reception.is_in_slot))
    }

    /// Returns whether a member did not conform to the schedule at a time although another one did. If no member did,
    /// the vehicle's own clock is wrong, and the slot numbers of the member may be right. O(members log N).
    pub(crate) fn is_only_member_out(&self, id: &VehicleId, time_s: f64) -> bool {
        self.is_out_of_slot(id, time_s) && self.receptions.keys().any(|other| !self.is_out_of_slot(other, time_s))
    }

    /// Returns the members whose latest receptions lie outside their slots. Each has the clock offset in slots that
    /// fits these, if only one does. An offset is positive where messages arrive late.
    pub(crate) fn out_of_slot(&self, slots: &Slots) -> BTreeMap<VehicleId, Option<i32>> {
        let is_out = |id: &VehicleId| self.is_out_of_slot(id, f64::INFINITY);
        let members = self.receptions.iter().filter(|(id, _)| is_out(id));
        members.map(|(id, receptions)| (id.clone(), offset(slots, id, &receptions[receptions.len() - RUN..]))).collect()
    }

    /// Returns the offset of the vehicle's own clock in slots. All members that it receives, two at least, are then out
    /// of slot by that offset. With one other member nothing shows whose clock is wrong.
    pub(crate) fn own_offset(&self, slots: &Slots) -> Option<i32> {
        let members = self.out_of_slot(slots);
        let offset = *members.values().next()?;
        let is_everyone = members.len() >= 2 && members.len() == self.receptions.len();
        offset.filter(|_| is_everyone && members.values().all(|other| *other == offset))
    }
}

/// Returns the offset of less than half a cycle that puts all these receptions into slots of their sender, if there is
/// only one.
fn offset(slots: &Slots, id: &VehicleId, receptions: &[Reception]) -> Option<i32> {
    let max = ((slots.cycle_slots() as i32 - 1) / 2).min(OFFSET_MAX);
    let fits = |offset: &i32| {
        let sent_s = |reception: &Reception| reception.time_s - f64::from(*offset) * slots.duration_s;
        receptions.iter().all(|reception| slots.sent_in(sent_s(reception), id).is_some())
    };
    let mut fitting = (-max..=max).filter(fits);
    fitting.next().filter(|_| fitting.next().is_none())
}
