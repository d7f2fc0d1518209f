//! Headings of vehicles, from their courses.

use std::collections::BTreeMap;

use pingmap_agent::{Event, Position, VehicleId};

/// Longest time between a position and its neighbour that gives a course, in seconds.
const NEIGHBOUR_S_MAX: f64 = 60.0;

/// Sets every unknown heading to the course of the vehicle: from its position before the event to the one after it.
///
/// The positions are those in the events, heard and missed alike. A neighbour counts if it is at most a minute away.
/// The heading stays unknown without neighbours, and if the vehicle moved less than two metres. O(n log n).
pub fn derive_headings(events: &mut [Event]) {
    let mut tracks = BTreeMap::<VehicleId, Vec<(f64, Position)>>::new();
    for event in &*events {
        for (id, position) in
            [(&event.transmitter_id, event.link.transmitter), (&event.receiver_id, event.link.receiver)]
        {
            tracks.entry(id.clone()).or_default().push((event.time_s, position));
        }
    }
    for track in tracks.values_mut() {
        track.sort_by(|a, b| a.0.total_cmp(&b.0));
        track.dedup_by_key(|fix| fix.0);
    }
    for event in events {
        let time_s = event.time_s;
        for (id, end) in
            [(&event.transmitter_id, &mut event.link.transmitter), (&event.receiver_id, &mut event.link.receiver)]
        {
            if end.heading_deg.is_none() {
                end.heading_deg = tracks.get(id).and_then(|track| course_deg(track, time_s, end));
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
