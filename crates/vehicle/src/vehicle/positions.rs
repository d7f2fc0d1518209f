//! The latest positions of the vehicle and of other members.

use std::collections::{BTreeMap, VecDeque};

use pingmap_agent::{Position, VehicleId};

/// Age at which positions are forgotten, in seconds.
const AGE_S_MAX: f64 = 3600.0;

/// Maximum number of positions of one vehicle. The latest ones are dropped first.
const FIXES_MAX: usize = 20_000;

/// Least time between two positions of one vehicle, in seconds.
const STEP_S_MIN: f64 = 0.2;

/// Positions in the order of time, the latest ones.
#[derive(Debug, Clone, Default)]
pub(crate) struct Fixes(VecDeque<(f64, Position)>);

impl Fixes {
    /// Adds a position. It replaces a position at the same time. Of positions at a high rate, some are left out.
    fn add(&mut self, time_s: f64, position: Position, clock_s: f64) {
        while self.0.front().is_some_and(|oldest| oldest.0 < clock_s - AGE_S_MAX) {
            self.0.pop_front();
        }
        if time_s < clock_s - AGE_S_MAX {
            return;
        }
        let index = self.0.partition_point(|fix| fix.0 < time_s);
        let near = |index: usize| self.0.get(index).is_some_and(|fix| (fix.0 - time_s).abs() < STEP_S_MIN);
        let is_dense = near(index) || index.checked_sub(1).is_some_and(near);
        match self.0.get_mut(index).filter(|fix| fix.0 == time_s) {
            Some(fix) => fix.1 = position,
            None if is_dense => {}
            None => self.0.insert(index, (time_s, position)),
        }
        self.0.truncate(FIXES_MAX);
    }

    /// Returns the latest position up to a time, or else the first one after it.
    fn latest(&self, time_s: f64) -> Option<&(f64, Position)> {
        let after = self.0.partition_point(|fix| fix.0 <= time_s);
        self.0.get(after.saturating_sub(1))
    }

    /// Returns the position at a time: that of a fix, or between two fixes that are at most `gap_s_max` apart. An
    /// unknown heading is the course between them.
    fn at(&self, time_s: f64, gap_s_max: f64) -> Option<Position> {
        let after = self.0.partition_point(|fix| fix.0 < time_s);
        let next = self.0.get(after)?;
        let before = after.checked_sub(1).and_then(|before| self.0.get(before));
        let before = before.filter(|before| next.0 - before.0 <= gap_s_max);
        let course_deg = || before?.1.course_deg(&next.1);
        if next.0 == time_s {
            return Some(Position { heading_deg: next.1.heading_deg.or_else(course_deg), ..next.1 });
        }
        let (from, to) = (before?, next);
        let share = (time_s - from.0) / (to.0 - from.0);
        let nearest = if share < 0.5 { from } else { to };
        let heading_deg = nearest.1.heading_deg.or_else(course_deg);
        Some(Position { heading_deg, ..from.1.between(&to.1, share) })
    }
}

/// A vehicle, a time, and east, north, depth and heading.
pub(crate) type StoredPosition = (VehicleId, f64, [Option<f64>; 4]);

/// The latest positions by vehicle.
#[derive(Debug, Clone, Default)]
pub(crate) struct Positions {
    /// From navigation, or known independently of receptions.
    independent: BTreeMap<VehicleId, Fixes>,
    /// From any source.
    known: BTreeMap<VehicleId, Fixes>,
}

impl Positions {
    /// Adds a position of a vehicle. `clock_s` is the present.
    pub(crate) fn add(&mut self, id: &VehicleId, time_s: f64, position: Position, is_independent: bool, clock_s: f64) {
        if is_independent {
            self.independent.entry(id.clone()).or_default().add(time_s, position, clock_s);
        }
        self.known.entry(id.clone()).or_default().add(time_s, position, clock_s);
    }

    /// Returns the position of a vehicle at a time, from positions that are known independently of receptions.
    pub(crate) fn at(&self, id: &VehicleId, time_s: f64, gap_s_max: f64) -> Option<Position> {
        self.independent.get(id)?.at(time_s, gap_s_max)
    }

    /// Returns the last position before a time, whatever its source. `None` if it is older than `age_s_max`.
    pub(crate) fn before(&self, id: &VehicleId, time_s: f64, age_s_max: f64) -> Option<Position> {
        let fixes = &self.known.get(id)?.0;
        let before = fixes.partition_point(|fix| fix.0 < time_s).checked_sub(1)?;
        fixes.get(before).filter(|fix| time_s - fix.0 <= age_s_max).map(|fix| fix.1)
    }

    /// Returns the position of each vehicle at the present, and its time: for a store.
    pub(crate) fn stored(&self, clock_s: f64) -> Vec<StoredPosition> {
        let stored = |(id, fixes): (&VehicleId, &Fixes)| {
            let &(time_s, at) = fixes.latest(clock_s)?;
            Some((id.clone(), time_s, [Some(at.east_m), Some(at.north_m), at.depth_m, at.heading_deg]))
        };
        self.known.iter().filter_map(stored).collect()
    }

    /// Takes the latest position of each vehicle from a store.
    pub(crate) fn restore(&mut self, stored: Vec<StoredPosition>) {
        for (id, time_s, [east_m, north_m, depth_m, heading_deg]) in stored {
            if let Some((east_m, north_m)) = east_m.zip(north_m) {
                self.add(&id, time_s, Position { east_m, north_m, depth_m, heading_deg }, false, time_s);
            }
        }
    }

    /// Returns the position of a vehicle at the present.
    pub(crate) fn latest(&self, id: &VehicleId, clock_s: f64) -> Option<Position> {
        self.known.get(id)?.latest(clock_s).map(|(_, position)| *position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn added(times_s: impl IntoIterator<Item = f64>) -> Fixes {
        let mut fixes = Fixes::default();
        let mut clock_s = f64::NEG_INFINITY;
        for time_s in times_s {
            // Times far ahead are plans.
            clock_s = if time_s < 50_000.0 { time_s.max(clock_s) } else { clock_s };
            fixes.add(time_s, Position::new(time_s, 0.0), clock_s);
        }
        fixes
    }

    #[test]
    fn positions_at_a_high_rate_stay_known_for_an_hour() {
        let fixes = added((0..200_000).map(|n| f64::from(n) / 50.0));
        let at = fixes.at(1000.05, 10.0).unwrap();
        assert!((at.east_m - 1000.05).abs() < 1e-9);
        assert_eq!(fixes.at(100.0, 10.0), None);
        assert!(fixes.0.len() <= (AGE_S_MAX / STEP_S_MIN) as usize + 1, "{}", fixes.0.len());
    }

    #[test]
    fn plans_and_wrong_times_ahead_erase_no_position() {
        let fixes = added([100.0, 90_000.0, 90_010.0, 110.0]);
        assert_eq!(fixes.at(105.0, 20.0).map(|at| at.east_m), Some(105.0));
        assert_eq!(fixes.at(90_005.0, 20.0).map(|at| at.east_m), Some(90_005.0));
        assert_eq!(fixes.latest(120.0).map(|fix| fix.0), Some(110.0));
        assert_eq!(fixes.latest(50.0).map(|fix| fix.0), Some(100.0));
    }

    #[test]
    fn late_positions_are_used() {
        let fixes = added([0.0, 20.0, 10.0]);
        assert_eq!(fixes.at(5.0, 10.0).map(|at| at.east_m), Some(5.0));
    }
}
