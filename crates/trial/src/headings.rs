//! Headings of vehicles, from their courses.

use std::collections::BTreeMap;

use pingmap_agent::{Position, VehicleId};

use crate::event_log::EventLog;

/// Longest time between a position and its neighbour that gives a course, in seconds.
const NEIGHBOUR_S_MAX: f64 = 60.0;

impl EventLog {
    /// Sets every unknown heading to the course of the vehicle: from its position before the event to the one after it.
    ///
    /// The positions are those in the events, heard and missed alike. On each side the nearest one counts that is at
    /// least two metres away, so that a dense log gives courses, too. It must be at most a minute away. The heading
    /// stays unknown if the vehicle moved less than two metres in that time. O(VN + N log N) for N events of V
    /// vehicles, and at most the positions of two minutes for each event.
    pub fn derive_headings(&mut self) {
        let ids = self.events.iter().flat_map(|event| [&event.transmitter_id, &event.receiver_id]);
        let mut tracks: BTreeMap<VehicleId, Vec<(f64, Position)>> = ids.map(|id| (id.clone(), Vec::new())).collect();
        for (id, track) in &mut tracks {
            track.extend(self.track(id));
            track.sort_by(|a, b| a.0.total_cmp(&b.0));
            track.dedup_by_key(|fix| fix.0);
        }
        for event in &mut self.events {
            let ends = [&mut event.link.transmitter, &mut event.link.receiver];
            for (id, end) in [&event.transmitter_id, &event.receiver_id].into_iter().zip(ends) {
                end.heading_deg = end.heading_deg.or_else(|| course_deg(&tracks[id], event.time_s, end));
            }
        }
    }
}

/// Returns the course at a time of a track in the order of time. `at` is the position at that time.
fn course_deg(track: &[(f64, Position)], time_s: f64, at: &Position) -> Option<f64> {
    let earlier = track[..track.partition_point(|fix| fix.0 < time_s)].iter().rev();
    let later = track[track.partition_point(|fix| fix.0 <= time_s)..].iter();
    let is_near = |fix: &&(f64, Position)| (fix.0 - time_s).abs() <= NEIGHBOUR_S_MAX;
    let before = moved_from(at, earlier.take_while(is_near));
    let after = moved_from(at, later.take_while(is_near));
    before.unwrap_or(at).course_deg(after.unwrap_or(at))
}

/// Returns the first position that is far enough from `at` for a course; if there is none, the first one.
fn moved_from<'a>(at: &Position, mut fixes: impl Iterator<Item = &'a (f64, Position)>) -> Option<&'a Position> {
    let first = &fixes.next()?.1;
    let is_away = |position: &&Position| at.course_deg(position).is_some();
    Some(Some(first).filter(is_away).or_else(|| fixes.map(|fix| &fix.1).find(is_away)).unwrap_or(first))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the track of a vehicle that moves at this speed along a course, one fix a second.
    fn track(speed_m_per_s: f64, course_deg: f64) -> Vec<(f64, Position)> {
        let (sin, cos) = course_deg.to_radians().sin_cos();
        let fix = |second: u32| {
            let along_m = speed_m_per_s * f64::from(second);
            (f64::from(second), Position::new(along_m * sin, along_m * cos))
        };
        (0..200).map(fix).collect()
    }

    #[test]
    fn dense_positions_give_the_course_of_a_moving_vehicle_only() {
        for course in [10.0, 200.0, 359.0] {
            for (speed_m_per_s, is_known) in [(5.0, true), (0.5, true), (0.05, true), (0.005, false)] {
                let track = track(speed_m_per_s, course);
                for place in [0, 100, 199] {
                    let (time_s, at) = track[place];
                    let found = course_deg(&track, time_s, &at);
                    assert_eq!(found.is_some(), is_known, "{speed_m_per_s} m/s, fix {place}");
                    assert!(found.is_none_or(|found| (found - course).abs() < 1e-6), "{found:?}");
                }
            }
        }
    }

    #[test]
    fn sparse_positions_give_the_course_between_the_neighbours() {
        let track =
            [(0.0, Position::new(0.0, 0.0)), (10.0, Position::new(10.0, 0.0)), (20.0, Position::new(10.0, 10.0))];
        let at = |place: usize| course_deg(&track, track[place].0, &track[place].1);
        assert_eq!([at(0), at(1), at(2)], [Some(90.0), Some(45.0), Some(0.0)]);
        let late = [track[0], (100.0, Position::new(10.0, 0.0))];
        assert_eq!(course_deg(&late, 0.0, &late[0].1), None);
    }
}
