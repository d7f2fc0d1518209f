//! The track of another member, reconstructed from the waypoints in its reports.

use std::collections::BTreeMap;
use std::ops::Range;

use pingmap_packet::Cell;

use crate::team::slots::Slots;
use crate::track::position_track::interpolate;
use crate::types::event::Position;

/// The track of one member, from all its reports.
#[derive(Debug, Clone, Default)]
pub(crate) struct ReceivedTrack {
    /// Cells of the waypoints by slot. If reports contain different cells for one slot, the smallest counts.
    waypoints: BTreeMap<u32, Cell>,
    /// Last slot of the longest segment by the first slot of the segment. A segment joins consecutive waypoints of one
    /// report, between which the member moved in a straight line. Between the waypoints of two reports there may be
    /// others, in reports that were lost.
    segments: BTreeMap<u32, u32>,
}

impl ReceivedTrack {
    /// Adds the waypoints of a report, which are in the order of their slots.
    pub(crate) fn add(&mut self, waypoints: &[(u32, Cell)]) {
        for &(slot, cell) in waypoints {
            let stored = self.waypoints.entry(slot).or_insert(cell);
            *stored = cell.min(*stored);
        }
        for segment in waypoints.windows(2) {
            let end = self.segments.entry(segment[0].0).or_default();
            *end = segment[1].0.max(*end);
        }
    }

    /// Removes what a report with these waypoints added. Other reports with some of these slots must be added again.
    pub(crate) fn remove(&mut self, waypoints: &[(u32, Cell)]) {
        for (slot, _) in waypoints {
            self.waypoints.remove(slot);
            self.segments.remove(slot);
        }
    }

    pub(crate) fn waypoints(&self) -> &BTreeMap<u32, Cell> {
        &self.waypoints
    }

    /// Returns the position of the member at the beginning of a slot. `centre` returns the centre of a waypoint cell.
    ///
    /// The position is interpolated within a segment, and between waypoints that are at most 2 · `extrapolation_s_max`
    /// apart. After the last waypoint, and after a waypoint before a longer gap, it is extrapolated for
    /// `extrapolation_s_max`. Extrapolation uses the velocity of the preceding segment at constant depth; without a
    /// preceding segment the member is at rest. Returns `None` for other slots. O(log waypoints).
    ///
    /// The heading is the course of the segment. At a waypoint it is that of the following segment, or else of the
    /// preceding one. Waypoints in neighbouring cells give no course, because a vehicle at rest may drift between them.
    pub(crate) fn at(
        &self,
        slot: u32,
        slots: &Slots,
        centre: &dyn Fn(Cell) -> Position,
        extrapolation_s_max: f64,
    ) -> Option<Position> {
        let fix = |(&slot, &cell): (&u32, &Cell)| Some((slots.begin_s(slot)?, centre(cell)));
        let before = self.waypoints.range(..=slot).next_back()?;
        let (time_s, from) = (slots.begin_s(slot)?, fix(before)?);
        let earlier =
            self.waypoints.range(..before.0).next_back().filter(|earlier| self.is_segment(*earlier.0, *before.0));
        if *before.0 == slot {
            let after = self.waypoints.range(slot.saturating_add(1)..).next();
            let after = after.filter(|after| self.is_segment(slot, *after.0));
            let following = after.and_then(|(_, to)| course_deg(before.1, to, centre));
            let heading_deg = following.or_else(|| course_deg(earlier?.1, before.1, centre));
            return Some(Position { heading_deg, ..from.1 });
        }
        if let Some(after) = self.waypoints.range(slot..).next() {
            let to = fix(after)?;
            if self.is_segment(*before.0, *after.0) || to.0 - from.0 <= 2.0 * extrapolation_s_max {
                let heading_deg = course_deg(before.1, after.1, centre);
                return Some(Position { heading_deg, ..interpolate(&from, &to, time_s) });
            }
        }
        if time_s - from.0 > extrapolation_s_max {
            return None;
        }
        Some(match earlier {
            Some(earlier) => Position {
                depth_m: from.1.depth_m,
                heading_deg: course_deg(earlier.1, before.1, centre),
                ..interpolate(&fix(earlier)?, &from, time_s)
            },
            None => from.1,
        })
    }

    /// Returns whether a slot has a waypoint or lies within a segment.
    pub(crate) fn is_exact_at(&self, slot: u32) -> bool {
        let (before, after) = (self.waypoints.range(..=slot).next_back(), self.waypoints.range(slot..).next());
        before.zip(after).is_some_and(|((&before, _), (&after, _))| before == after || self.is_segment(before, after))
    }

    /// Returns whether a segment leads from a slot to the next one.
    pub(crate) fn continues_after(&self, slot: u32) -> bool {
        self.is_segment(slot, slot.saturating_add(1))
    }

    /// Returns the range of slots in which positions can change when the waypoints of one report are added or removed.
    /// The result is equal before and after the change.
    ///
    /// The range begins at the waypoint before them. It ends at the second waypoint after them, because positions after
    /// a segment are extrapolated along it.
    pub(crate) fn range_affected_by(&self, waypoints: &[(u32, Cell)]) -> Range<u32> {
        let (Some(&(first, _)), Some(&(last, _))) = (waypoints.first(), waypoints.last()) else { return 0..0 };
        let before = self.waypoints.range(..first).next_back();
        let second_after = self.waypoints.range(last.saturating_add(1)..).nth(1);
        before.map_or(first, |(&slot, _)| slot)..second_after.map_or(u32::MAX, |(&slot, _)| slot)
    }

    /// Returns whether one segment contains both slots. A segment has at most 255 slots, which bounds the search.
    fn is_segment(&self, from: u32, to: u32) -> bool {
        let first = to.saturating_sub(u8::MAX.into());
        first <= from && self.segments.range(first..=from).any(|(_, &end)| end >= to)
    }
}

/// Returns the course between two cells, in degrees. Returns `None` for neighbouring cells.
fn course_deg(from: &Cell, to: &Cell, centre: &dyn Fn(Cell) -> Position) -> Option<f64> {
    let cells = from.east.abs_diff(to.east).max(from.north.abs_diff(to.north));
    if cells > 1 { centre(*from).course_deg(&centre(*to)) } else { None }
}

#[cfg(test)]
#[path = "../../tests/unit/received.rs"]
mod tests;
