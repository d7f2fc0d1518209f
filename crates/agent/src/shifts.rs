//! By how many slots a clock would have to be ahead for a message to be in turn.

use crate::event::Event;
use crate::team::Team;

/// A clock is at most so many slots ahead or behind.
const SHIFT_MAX: i32 = 31;

/// Shifts of a clock, in slots: how far it is ahead, or behind where they are negative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shifts(u64);

impl Shifts {
    /// Those by which a transmission is of one of its transmitter's slots, of less than half a turn of the order. `None` for what is of no
    /// member, in no slot, or where nobody has turns.
    pub(crate) fn of(team: &Team, event: &Event) -> Option<Self> {
        let slots = &team.slots;
        if slots.at_will || slots.listed.is_some() {
            return None;
        }
        slots.number(event.time_s)?;
        team.number(&event.transmitter_id)?;
        let max = ((slots.order_max() as i32 - 1) / 2).min(SHIFT_MAX);
        let is_in_turn = |shift: &i32| {
            slots.sent_in(event.time_s - f64::from(*shift) * slots.duration_s, &event.transmitter_id).is_some()
        };
        Some(Self((-max..=max).filter(is_in_turn).fold(0, |shifts, shift| shifts | Self::bit(shift))))
    }

    fn bit(shift: i32) -> u64 {
        1 << (shift + SHIFT_MAX)
    }

    pub(crate) fn has(self, shift: i32) -> bool {
        self.0 & Self::bit(shift) != 0
    }

    /// The one that all of these have, if they have no other in common.
    pub(crate) fn only_one_of(all: impl Iterator<Item = Self>) -> Option<i32> {
        let common = all.fold(u64::MAX, |common, shifts| common & shifts.0);
        (common.count_ones() == 1).then(|| common.trailing_zeros() as i32 - SHIFT_MAX)
    }
}
