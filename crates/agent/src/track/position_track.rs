//! The track of a vehicle: positions over time.

use crate::types::event::Position;

/// Longest time over which a course is computed from positions that are not neighbours, in seconds.
const COURSE_S_MAX: f64 = 60.0;

/// Positions in the order of time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track(Vec<(f64, Position)>);

impl Track {
    /// Creates a track from positions in any order. If there are several positions at one time, the first one in the
    /// bitwise order of their coordinates counts.
    pub(crate) fn new(mut fixes: Vec<(f64, Position)>) -> Self {
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| coordinate_bits(&a.1).cmp(&coordinate_bits(&b.1))));
        fixes.dedup_by(|later, kept| later.0 == kept.0);
        Self(fixes)
    }

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
    /// A position without a heading gets the course from the position before it. If these two are less than two
    /// metres apart, the latest earlier position counts that is two metres away. It is at most a minute older.
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
        let course_deg = || self.course_deg(after, gap_s_max);
        if next.0 == time_s {
            return Some(Position { heading_deg: next.1.heading_deg.or_else(course_deg), ..next.1 });
        }
        let between = interpolate(before?, next, time_s);
        Some(Position { heading_deg: between.heading_deg.or_else(course_deg), ..between })
    }

    /// Returns the position at a time, interpolated between the last position before it and the first one from `end_s`
    /// on. `None` if these are more than `gap_s_max` seconds apart, or if one is missing. The heading is the one
    /// between both headings, or the course.
    pub(crate) fn across(&self, time_s: f64, end_s: f64, gap_s_max: f64) -> Option<Position> {
        let before = self.0.partition_point(|fix| fix.0 < time_s).checked_sub(1)?;
        let after = self.0.partition_point(|fix| fix.0 < end_s);
        let (before, after) = (&self.0[before], self.0.get(after)?);
        (after.0 - before.0 <= gap_s_max).then(|| interpolate(before, after, time_s))
    }

    /// Returns the course to the position at `index` from the position before it. If they are too near for a course, an
    /// earlier position counts that is at most [`COURSE_S_MAX`] older.
    fn course_deg(&self, index: usize, gap_s_max: f64) -> Option<f64> {
        let (time_s, to) = &self.0[index];
        let earlier = self.0[..index].iter().rev().enumerate();
        let is_near = |(place, fix): &(usize, &(f64, Position))| {
            time_s - fix.0 <= if *place == 0 { gap_s_max } else { COURSE_S_MAX }
        };
        earlier.take_while(is_near).find_map(|(_, fix)| fix.1.course_deg(to))
    }
}

/// Returns the bits of all coordinates, by which positions at one time are ordered. Unknown ones are least.
pub(crate) fn coordinate_bits(position: &Position) -> [u64; 4] {
    let or_least = |value: Option<f64>| value.unwrap_or(f64::NEG_INFINITY);
    let [depth_m, heading_deg] = [position.depth_m, position.heading_deg].map(or_least);
    [position.east_m, position.north_m, depth_m, heading_deg].map(f64::to_bits)
}

/// Returns the position at a time on the straight line through two positions, at constant velocity. Extrapolates
/// outside the interval. If both positions have one time, returns the second one. The heading is the one between both
/// headings, or the course if one of them is unknown.
pub(crate) fn interpolate(from: &(f64, Position), to: &(f64, Position), time_s: f64) -> Position {
    let share = if to.0 > from.0 { (time_s - from.0) / (to.0 - from.0) } else { 1.0 };
    let heading_deg = match from.1.heading_deg.zip(to.1.heading_deg) {
        Some((a, b)) => Some((a + share.clamp(0.0, 1.0) * turn_deg(a, b)).rem_euclid(360.0)),
        None => from.1.course_deg(&to.1),
    };
    Position { heading_deg, ..from.1.between(&to.1, share) }
}

/// Returns the shorter turn from one heading to another, from −180 to 180 degrees, positive to starboard.
fn turn_deg(from_deg: f64, to_deg: f64) -> f64 {
    (to_deg - from_deg + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
#[path = "../../tests/unit/position_track.rs"]
mod tests;
