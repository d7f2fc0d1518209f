//! The track of a vehicle.

use pingmap_agent::Position;

use crate::model::recording::Recording;
use crate::model::reference::Reference;

/// Positions in the order of time, with linear interpolation between them.
pub(crate) struct Track {
    fixes: Vec<(f64, Position)>,
    fixed: Option<Position>,
    /// Number of fixes that the reference system cannot convert to metres.
    pub(crate) unprojected: usize,
}

impl Track {
    /// Converts the fixes of a recording to metres. O(n log n).
    pub(crate) fn new(recording: &Recording, reference: &Reference) -> Self {
        let projected_position = |place, depth_m| {
            let (east_m, north_m) = reference.metres(place)?;
            Some(Position { depth_m, ..Position::new(east_m, north_m) })
        };
        let projected =
            recording.fixes.iter().filter_map(|fix| Some((fix.time_s, projected_position(fix.place, fix.depth_m)?)));
        let mut fixes: Vec<(f64, Position)> = projected.collect();
        let unprojected = recording.fixes.len() - fixes.len();
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0));
        fixes.dedup_by_key(|fix| fix.0);
        Self { fixes, fixed: recording.station.and_then(|fix| projected_position(fix.place, fix.depth_m)), unprojected }
    }

    /// Returns the times of the first and the last fix; an unbounded span for a fixed vehicle.
    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        match self.fixed {
            Some(_) => Some((f64::NEG_INFINITY, f64::INFINITY)),
            None => Some((self.fixes.first()?.0, self.fixes.last()?.0)),
        }
    }

    /// Interpolates the position at a time. Returns `None` if the fixes around it are more than `gap_s_max` seconds
    /// apart.
    pub(crate) fn position(&self, time_s: f64, gap_s_max: f64) -> Option<Position> {
        if self.fixed.is_some() {
            return self.fixed;
        }
        let next = self.fixes.partition_point(|fix| fix.0 < time_s);
        let following = self.fixes.get(next)?;
        if following.0 == time_s {
            return Some(following.1);
        }
        let previous = &self.fixes[next.checked_sub(1)?];
        let gap_s = following.0 - previous.0;
        let share = (time_s - previous.0) / gap_s;
        (gap_s <= gap_s_max).then(|| previous.1.between(&following.1, share))
    }

    /// Returns the spans of successive fixes above a depth, from the first to the last fix of each.
    pub(crate) fn spans_above(&self, depth_m: f64) -> Vec<(f64, f64)> {
        let is_above = |position: &Position| position.depth_m.is_some_and(|own_m| own_m < depth_m);
        let spans = self.fixes.chunk_by(|a, b| is_above(&a.1) == is_above(&b.1));
        let above = spans.filter(|span| span.first().is_some_and(|fix| is_above(&fix.1)));
        above.filter_map(|span| Some((span.first()?.0, span.last()?.0))).collect()
    }

    /// Estimates the position at any time, for the travel time of sound: interpolated across any gap, else the nearest
    /// fix.
    pub(crate) fn estimate(&self, time_s: f64) -> Option<Position> {
        let next = self.fixes.partition_point(|fix| fix.0 < time_s);
        let nearest = self.fixes.get(next).or_else(|| self.fixes.last()).map(|fix| fix.1);
        self.fixed.or_else(|| self.position(time_s, f64::INFINITY)).or(nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::recording::Fix;
    use crate::model::reference::Place;

    #[test]
    fn positions_are_interpolated_between_fixes_and_undefined_in_gaps() {
        let fix = |time_s, east_m, depth_m| Fix { time_s, place: Place::Metres(east_m, 0.0), depth_m };
        let fixes =
            vec![fix(20.0, 40.0, Some(2.0)), fix(0.0, 0.0, Some(1.0)), fix(100.0, 200.0, None), fix(0.0, 7.0, None)];
        let track = Track::new(&Recording { fixes, ..Recording::default() }, &Reference::unknown());
        let position = |time_s| track.position(time_s, 30.0).map(|position| (position.east_m, position.depth_m));
        assert_eq!(
            [0.0, 10.0, 20.0, 100.0].map(position),
            [Some((0.0, Some(1.0))), Some((20.0, Some(1.5))), Some((40.0, Some(2.0))), Some((200.0, None))]
        );
        assert_eq!([-1.0, 60.0, 100.5, f64::NAN].map(position), [None; 4]);
        assert_eq!(track.estimate(300.0).map(|position| position.east_m), Some(200.0));
    }
}
