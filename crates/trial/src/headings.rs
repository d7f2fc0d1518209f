//! Headings of vehicles, from their courses.

use std::collections::BTreeMap;

use pingmap_agent::{Event, Position, VehicleId};

/// Longest time between an event and a position that gives a course, in seconds.
const NEIGHBOUR_S_MAX: f64 = 60.0;

/// Sets every unknown heading to the course of the vehicle: from a position before the event to one after it.
///
/// The positions are those in the events, heard and missed alike. On either side it is the nearest position that is at
/// least two metres and at most a minute away. The heading stays unknown if there is none. O(n log n), plus the
/// positions within a minute for each event.
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
    let is_apart = |fix: &&(f64, Position)| fix.1.course_deg(at).is_some();
    let (before, after) = track.split_at(track.partition_point(|fix| fix.0 < time_s));
    let before = before.iter().rev().take_while(is_near).find(is_apart);
    let after = after.iter().take_while(is_near).find(is_apart);
    before.map_or(at, |fix| &fix.1).course_deg(after.map_or(at, |fix| &fix.1))
}
