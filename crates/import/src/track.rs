//! Where a vehicle was.

use pingmap_agent::Position;

use crate::recording::Recording;
use crate::reference::Reference;

/// Positions in the order of time, straight in between.
pub(crate) struct Track {
    fixes: Vec<(f64, Position)>,
    fixed: Option<Position>,
    /// Fixes that are no place in the log.
    pub(crate) unplaced: usize,
}

impl Track {
    pub(crate) fn of(recording: &Recording, reference: &Reference) -> Self {
        let position = |place, depth_m| {
            let (east_m, north_m) = reference.metres(place)?;
            Some(Position { east_m, north_m, depth_m })
        };
        let placed = recording.fixes.iter().filter_map(|fix| Some((fix.time_s, position(fix.place, fix.depth_m)?)));
        let mut fixes: Vec<(f64, Position)> = placed.collect();
        let unplaced = recording.fixes.len() - fixes.len();
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0));
        fixes.dedup_by_key(|fix| fix.0);
        Self { fixes, fixed: recording.fixed.and_then(|fix| position(fix.place, fix.depth_m)), unplaced }
    }

    /// When it was first and last seen.
    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        match self.fixed {
            Some(_) => Some((f64::NEG_INFINITY, f64::INFINITY)),
            None => Some((self.fixes.first()?.0, self.fixes.last()?.0)),
        }
    }

    /// Where it was, if the fixes before and after are no farther apart in time than `gap_s_max`.
    pub(crate) fn at(&self, time_s: f64, gap_s_max: f64) -> Option<Position> {
        if self.fixed.is_some() {
            return self.fixed;
        }
        let next = self.fixes.partition_point(|fix| fix.0 < time_s);
        let after = self.fixes.get(next)?;
        if after.0 == time_s {
            return Some(after.1);
        }
        let before = &self.fixes[next.checked_sub(1)?];
        let gap_s = after.0 - before.0;
        let share = (time_s - before.0) / gap_s;
        let between = |from: f64, to: f64| from + share * (to - from);
        (gap_s <= gap_s_max).then(|| Position {
            east_m: between(before.1.east_m, after.1.east_m),
            north_m: between(before.1.north_m, after.1.north_m),
            depth_m: before.1.depth_m.zip(after.1.depth_m).map(|(from, to)| between(from, to)),
        })
    }

    /// Where it probably was, for the time that sound takes: at the nearest fix, if there is any.
    pub(crate) fn near(&self, time_s: f64) -> Option<Position> {
        let next = self.fixes.partition_point(|fix| fix.0 < time_s);
        let nearest = self.fixes.get(next).or_else(|| self.fixes.last()).map(|fix| fix.1);
        self.fixed.or_else(|| self.at(time_s, f64::INFINITY)).or(nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Fix;
    use crate::reference::Place;

    #[test]
    fn positions_are_straight_between_fixes_and_nowhere_in_gaps() {
        let fix = |time_s, east_m, depth_m| Fix { time_s, place: Place::Metres(east_m, 0.0), depth_m };
        let fixes =
            vec![fix(20.0, 40.0, Some(2.0)), fix(0.0, 0.0, Some(1.0)), fix(100.0, 200.0, None), fix(0.0, 7.0, None)];
        let track = Track::of(&Recording { fixes, ..Recording::default() }, &Reference::unknown());
        let at = |time_s| track.at(time_s, 30.0).map(|position| (position.east_m, position.depth_m));
        assert_eq!(
            [0.0, 10.0, 20.0, 100.0].map(at),
            [Some((0.0, Some(1.0))), Some((20.0, Some(1.5))), Some((40.0, Some(2.0))), Some((200.0, None))]
        );
        assert_eq!([-1.0, 60.0, 100.5, f64::NAN].map(at), [None; 4]);
        assert_eq!(track.near(300.0).map(|position| position.east_m), Some(200.0));
    }
}
