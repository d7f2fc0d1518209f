//! Whether vehicles keep to the schedule: what was heard shows by when it came whose clock, or schedule, differs.

use std::collections::{BTreeMap, BTreeSet};

use crate::event::VehicleId;
use crate::events::Events;
use crate::frames::Frames;

/// Events that are looked at: the latest.
const LATEST: usize = 64;

/// Of each kind so many are needed at least,
const EVENTS_MIN: usize = 4;

/// and for so many that fit the suspicion one at most may not.
const FITTING: usize = 8;

/// Members who are heard out of their turn of late, though what is missed is missed in turn: their clock or their schedule differs from
/// that of this vehicle. What is heard comes when it is sent, and what is missed stands where it was expected; where both are out of
/// turn, nobody goes by this schedule at all. None where transmissions are listed one by one. O(64).
pub(crate) fn out_of_turn(frames: &Frames, events: &Events) -> BTreeSet<VehicleId> {
    let slots = &frames.team.slots;
    if slots.listed.is_some() {
        return BTreeSet::new();
    }
    // Out of turn, and in turn.
    let (mut heard, mut missed) = (BTreeMap::<&VehicleId, [usize; 2]>::new(), [0, 0]);
    let latest = events.iter().rev().take(LATEST);
    for event in latest.filter(|event| frames.team.number(&event.transmitter_id).is_some()) {
        let in_turn = slots.sent_in(event.time_s, &event.transmitter_id).is_some();
        let counts = if event.success { heard.entry(&event.transmitter_id).or_default() } else { &mut missed };
        counts[usize::from(in_turn)] += 1;
    }
    let mostly = |fitting: usize, not: usize| fitting >= EVENTS_MIN && FITTING * not <= fitting;
    let is_out =
        |&(_, &[out, within]): &(&&VehicleId, &[usize; 2])| mostly(out, within) && mostly(missed[1], missed[0]);
    heard.iter().filter(is_out).map(|(&id, _)| id.clone()).collect()
}
