//! Where a vehicle was: what its navigation says.

use crate::event::Position;

/// Positions at times, in the order of time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Track(Vec<(f64, Position)>);

impl Track {
    /// Of several positions at one time the first counts, in the order of their numbers.
    pub(crate) fn new(mut fixes: Vec<(f64, Position)>) -> Self {
        let numbers = |position: &Position| {
            [position.east_m, position.north_m, position.depth_m.unwrap_or(f64::NEG_INFINITY)].map(f64::to_bits)
        };
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| numbers(&a.1).cmp(&numbers(&b.1))));
        fixes.dedup_by(|later, kept| later.0 == kept.0);
        Self(fixes)
    }

    /// The positions.
    pub(crate) fn fixes(self) -> Vec<(f64, Position)> {
        self.0
    }

    /// From the first position to the last.
    pub(crate) fn span_s(&self) -> Option<(f64, f64)> {
        Some((self.0.first()?.0, self.0.last()?.0))
    }

    /// The time of the first position at this time or later.
    pub(crate) fn next_s(&self, time_s: f64) -> Option<f64> {
        self.0.get(self.0.partition_point(|fix| fix.0 < time_s)).map(|fix| fix.0)
    }

    /// Where it was, on the straight way between the positions before and after; `None` before the first and behind the last.
    pub(crate) fn at(&self, time_s: f64) -> Option<Position> {
        self.at_within(time_s, f64::INFINITY)
    }

    /// The same where these two are no more than so many seconds apart.
    pub(crate) fn at_within(&self, time_s: f64, apart_s_max: f64) -> Option<Position> {
        let after = self.0.partition_point(|fix| fix.0 < time_s);
        let next = self.0.get(after)?;
        if next.0 == time_s {
            return Some(next.1);
        }
        let before = self.0.get(after.checked_sub(1)?)?;
        (next.0 - before.0 <= apart_s_max).then(|| between(before, next, time_s))
    }
}

/// Where it was on the straight way from one place to another, or behind it; of two places at one time the latter.
pub(crate) fn between(from: &(f64, Position), to: &(f64, Position), time_s: f64) -> Position {
    let share = if to.0 > from.0 { (time_s - from.0) / (to.0 - from.0) } else { 1.0 };
    let along = |a: f64, b: f64| a + share * (b - a);
    Position {
        east_m: along(from.1.east_m, to.1.east_m),
        north_m: along(from.1.north_m, to.1.north_m),
        depth_m: from.1.depth_m.zip(to.1.depth_m).map(|(a, b)| along(a, b)),
    }
}
