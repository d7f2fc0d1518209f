//! The track of a vehicle: positions over time.

use crate::types::event::Position;

/// Positions in the order of time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track(Vec<(f64, Position)>);

impl Track {
    /// Creates a track from positions in any order. If there are several positions at one time, the first one in the
    /// bitwise order of their coordinates counts.
    pub(crate) fn new(mut fixes: Vec<(f64, Position)>) -> Self {
        let coordinates = |position: &Position| {
            let or_least = |value: Option<f64>| value.unwrap_or(f64::NEG_INFINITY);
            let [depth_m, heading_deg] = [position.depth_m, position.heading_deg].map(or_least);
            [position.east_m, position.north_m, depth_m, heading_deg].map(f64::to_bits)
        };
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| coordinates(&a.1).cmp(&coordinates(&b.1))));
        fixes.dedup_by(|later, kept| later.0 == kept.0);
        Self(fixes)
    }

    /// Returns the times and positions.
    pub(crate) fn into_fixes(self) -> Vec<(f64, Position)> {
        self.0
    }

    /// Returns the times of the first and of the last position, in seconds.
    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        Some((self.0.first()?.0, self.0.last()?.0))
    }

    /// Returns the time of the first position at or after `time_s`, in seconds.
    pub(crate) fn next_time_s(&self, time_s: f64) -> Option<f64> {
        self.0.get(self.0.partition_point(|fix| fix.0 < time_s)).map(|fix| fix.0)
    }

    /// Returns the position at a time, interpolated linearly. `None` before the first position and after the last one.
    /// A position without a heading gets the course from the position before it.
    pub(crate) fn at(&self, time_s: f64) -> Option<Position> {
        self.at_within(time_s, f64::INFINITY)
    }

    /// Returns the position at a time, as [`Track::at`]. `None` also where the neighbouring positions are more than
    /// `gap_s_max` seconds apart.
    pub(crate) fn at_within(&self, time_s: f64, gap_s_max: f64) -> Option<Position> {
        let after = self.0.partition_point(|fix| fix.0 < time_s);
        let next = self.0.get(after)?;
        let before = after.checked_sub(1).and_then(|before| self.0.get(before));
        let before = before.filter(|before| next.0 - before.0 <= gap_s_max);
        if next.0 == time_s {
            let course_deg = || before.and_then(|before| before.1.course_deg(&next.1));
            return Some(Position { heading_deg: next.1.heading_deg.or_else(course_deg), ..next.1 });
        }
        before.map(|before| interpolate(before, next, time_s))
    }
}

/// Returns the position at a time on the straight line through two positions, at constant velocity. Extrapolates
/// outside the interval. If both positions have one time, returns the second one. The heading is the one between both
/// headings, or the course if one of them is unknown.
pub(crate) fn interpolate(from: &(f64, Position), to: &(f64, Position), time_s: f64) -> Position {
    let share = if to.0 > from.0 { (time_s - from.0) / (to.0 - from.0) } else { 1.0 };
    let along = |a: f64, b: f64| a + share * (b - a);
    Position {
        east_m: along(from.1.east_m, to.1.east_m),
        north_m: along(from.1.north_m, to.1.north_m),
        depth_m: from.1.depth_m.zip(to.1.depth_m).map(|(a, b)| along(a, b)),
        heading_deg: match from.1.heading_deg.zip(to.1.heading_deg) {
            Some((a, b)) => Some((a + share.clamp(0.0, 1.0) * turn_deg(a, b)).rem_euclid(360.0)),
            None => from.1.course_deg(&to.1),
        },
    }
}

/// Returns the shorter turn from one heading to another, from −180 to 180 degrees, positive to starboard.
fn turn_deg(from_deg: f64, to_deg: f64) -> f64 {
    (to_deg - from_deg + 180.0).rem_euclid(360.0) - 180.0
}
