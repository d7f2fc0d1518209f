//! Headings of vehicles, from their courses.

use std::collections::BTreeMap;

use pingmap_agent::{Position, VehicleId};

use crate::event_log::EventLog;

/// Longest time between a position and its neighbour that gives a course, in seconds.
const NEIGHBOUR_S_MAX: f64 = 60.0;

impl EventLog {
    /// Sets every unknown heading to the course of the vehicle: from its position before the event to the one after it.
    ///
    /// The positions are those in the events, heard and missed alike. A neighbour counts if it is at most a minute
    /// away. The heading stays unknown without neighbours, and if the vehicle moved less than two metres.
    /// O(VN + N log N) for N events of V vehicles.
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
    let is_near = |fix: &&(f64, Position)| (fix.0 - time_s).abs() <= NEIGHBOUR_S_MAX;
    let before = track[..track.partition_point(|fix| fix.0 < time_s)].last().filter(is_near);
    let after = track[track.partition_point(|fix| fix.0 <= time_s)..].first().filter(is_near);
    before.map_or(at, |fix| &fix.1).course_deg(after.map_or(at, |fix| &fix.1))
}
