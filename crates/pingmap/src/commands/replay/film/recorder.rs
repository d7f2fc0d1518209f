//! Records a film while the mission is replayed.

use std::collections::BTreeMap;

use pingmap_agent::{Agent, Event, Position, Time, VehicleId};
use pingmap_import::time_in_words;
use pingmap_packet::to_hex;
use pingmap_trial::{EventLog, Vehicles};
use rayon::prelude::*;

use super::data::{AreaData, Film, Message, Moment, Vehicle, ViewerMap, cell_byte, colors, metres};
use crate::area::Area;
use crate::data_extent::DataExtent;
use crate::success_map::SuccessMap;
use crate::tracks;

/// Number of moments, equally spaced from the first to the last event.
const MOMENTS: usize = 24;

/// Side of a cell, in cells of `pingmap map`: 24 cells along the longer side of the area. The page interpolates.
const CELLS_JOINED: f64 = 5.0;

/// Positions of a vehicle in the order of time.
type Track = Vec<(f64, Position)>;

/// A film in progress.
pub struct Recorder<'a> {
    log: &'a EventLog,
    area: Area,
    tracks: BTreeMap<&'a VehicleId, Track>,
    moments: Vec<Moment>,
}

impl<'a> Recorder<'a> {
    /// Returns a recorder for the area of all events.
    pub fn new(log: &'a EventLog) -> anyhow::Result<Self> {
        let ends = || log.events.iter().flat_map(|event| event.link.ends());
        let fine = Area::around(ends(), None)?;
        let track = |id| {
            let mut track: Track = log.track(id).collect();
            track.sort_by(|a, b| a.0.total_cmp(&b.0));
            (id, track)
        };
        Ok(Self {
            log,
            area: Area::around(ends(), Some(CELLS_JOINED * fine.cell_m))?,
            tracks: tracks::tracks(&log.events).into_keys().map(track).collect(),
            moments: Vec::new(),
        })
    }

    /// Returns the times of the film in ascending order.
    pub fn times_s(&self) -> Vec<f64> {
        let times = || self.log.events.iter().map(|event| event.time_s);
        let (start_s, end_s) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
        if start_s == end_s {
            return vec![end_s];
        }
        let share = |n: usize| n as f64 / (MOMENTS - 1) as f64;
        (0..MOMENTS).map(|n| start_s * (1.0 - share(n)) + end_s * share(n)).collect()
    }

    /// Records the maps of all vehicles at a time. Predictions are those of copies, so that they do not change the
    /// vehicles. O(cells · n²) for n events of a vehicle. `step` is called after every map.
    pub fn record(&mut self, time_s: f64, vehicles: &Vehicles, step: &(dyn Fn() + Sync)) -> anyhow::Result<()> {
        let earlier = self.log.events.iter().filter(|event| event.time_s <= time_s);
        let extent = DataExtent::of(&[], earlier.map(|event| &event.link));
        let map = |agent: &Agent| {
            let map = self.map(&mut agent.clone(), time_s, &extent);
            step();
            map
        };
        let agents: Vec<&Agent> = vehicles.values().collect();
        let maps = agents.into_par_iter().map(map).collect::<anyhow::Result<Vec<ViewerMap>>>()?;
        let places = self.tracks.values().map(|track| metres(place_at(track, time_s))).collect();
        self.moments.push(Moment { time_s, words: time_in_words(time_s.round()), places, maps });
        Ok(())
    }

    /// Returns the map of messages from the vehicle's position at a time to typical receivers.
    fn map(&self, agent: &mut Agent, time_s: f64, extent: &DataExtent) -> anyhow::Result<ViewerMap> {
        let at = place_at(&self.tracks[agent.id()], time_s);
        let map = SuccessMap::of_messages(agent, at, Time::At(time_s), self.area, extent)?;
        let cells: Vec<u8> = map.sides.iter().flat_map(|side| &side.cells).map(cell_byte).collect();
        let status = agent.status();
        Ok(ViewerMap {
            own: status.own_events,
            received: status.located_events,
            packets: status.live_packets,
            cells: to_hex(&cells),
        })
    }

    /// Returns the recorded film.
    pub fn finish(self, log: String) -> Film {
        let place = |id: &VehicleId| self.tracks.keys().position(|other| *other == id).unwrap_or_default();
        let message = |event: &&Event| Message::of(event, place(&event.transmitter_id), place(&event.receiver_id));
        let mut events: Vec<&Event> = self.log.events.iter().collect();
        events.sort_by(|a, b| a.canonical_order(b));
        Film {
            log,
            vehicles: self.tracks.keys().enumerate().map(|(n, id)| Vehicle::new(n, id)).collect(),
            viewers: self.log.vehicles().iter().map(place).collect(),
            area: AreaData::of(&self.area),
            colors: colors(),
            messages: events.iter().map(message).collect(),
            moments: self.moments,
        }
    }
}

/// Returns the position at a time: on the line between the positions before and after it, with the heading before it.
/// Outside the times of the track it is the nearest position.
fn place_at(track: &[(f64, Position)], time_s: f64) -> Position {
    let later = track.partition_point(|fix| fix.0 <= time_s);
    let (before, after) = (track[later.saturating_sub(1)], track[later.min(track.len() - 1)]);
    if after.0 <= before.0 {
        return before.1;
    }
    let share = (time_s - before.0) / (after.0 - before.0);
    let between = before.1.between(&after.1, share);
    let depth_m = between.depth_m.or(before.1.depth_m);
    Position { depth_m, heading_deg: before.1.heading_deg, ..between }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_lie_between_the_positions_before_and_after() {
        let fix = |time_s, east_m| (time_s, Position { depth_m: Some(time_s), ..Position::new(east_m, 0.0) });
        let track = [fix(10.0, 0.0), fix(20.0, 100.0), fix(20.0, 200.0), fix(30.0, 300.0)];
        let at = |time_s| place_at(&track, time_s);
        assert_eq!(
            [0.0, 10.0, 12.0, 20.0, 25.0, 30.0, 99.0].map(|time_s| at(time_s).east_m),
            [0.0, 0.0, 20.0, 200.0, 250.0, 300.0, 300.0]
        );
        assert_eq!(at(12.0).depth_m, Some(12.0));
    }
}
