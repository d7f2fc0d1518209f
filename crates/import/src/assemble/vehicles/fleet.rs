//! All vehicles of a mission, addressed by index.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::VehicleId;

use crate::assemble::median::median;
use crate::assemble::rules::Rules;
use crate::assemble::vehicles::message::{Message, assemble_messages};
use crate::assemble::vehicles::track::Track;
use crate::model::recording::{Recording, Recordings};
use crate::model::reference::Reference;

/// A satellite receiver that is silent for longer than this was under water, in seconds.
const SATELLITE_SILENCE_S: f64 = 60.0;

/// Limit of silence for a receiver with rare reports, as a multiple of its median interval.
const SATELLITE_SILENCE_INTERVALS: f64 = 5.0;

/// Time between a message that bounds the record of a modem and the first or last transmission that counts, in seconds.
const BOUNDARY_S: f64 = 5.0;

/// One vehicle of a fleet.
pub(crate) struct Vehicle<'a> {
    pub(crate) name: &'a VehicleId,
    pub(crate) recording: &'a Recording,
    pub(crate) track: Track,
    /// Received messages by sender, each list in the order of time.
    pub(crate) messages: BTreeMap<usize, Vec<Message>>,
    /// Intervals in which its modem was active, by its own clock.
    pub(crate) active_spans: Vec<(f64, f64)>,
}

/// All vehicles with a recording, in the order of their names.
pub(crate) struct Fleet<'a> {
    pub(crate) vehicles: Vec<Vehicle<'a>>,
    pub(crate) rules: &'a Rules,
    /// Number of messages from each source without a recording.
    pub(crate) unknown_sources: BTreeMap<VehicleId, usize>,
    /// Number of messages to each destination without a recording.
    pub(crate) unknown_destinations: BTreeMap<VehicleId, usize>,
    /// Number of duplicate arrivals by receiver and sender.
    pub(crate) duplicates: BTreeMap<(usize, usize), usize>,
    /// Number of arrivals of a vehicle's own messages.
    pub(crate) own_messages: usize,
}

impl<'a> Fleet<'a> {
    /// Builds the track and the messages of every vehicle. O(n log n) in the number of records.
    pub(crate) fn new(recordings: &'a Recordings, reference: &Reference, rules: &'a Rules) -> Self {
        let mut fleet = Self {
            vehicles: Vec::new(),
            rules,
            unknown_sources: BTreeMap::new(),
            unknown_destinations: BTreeMap::new(),
            duplicates: BTreeMap::new(),
            own_messages: 0,
        };
        let indices: BTreeMap<&VehicleId, usize> = recordings.keys().zip(0..).collect();
        for (name, recording) in recordings {
            fleet.count_unknown_destinations(recording, &indices);
            let messages = fleet.received_messages(name, recording, &indices);
            let track = Track::new(recording, reference);
            let active_spans = active_spans(recording, &messages);
            fleet.vehicles.push(Vehicle { name, recording, track, messages, active_spans });
        }
        fleet
    }

    fn count_unknown_destinations(&mut self, recording: &Recording, indices: &BTreeMap<&VehicleId, usize>) {
        let received = recording.arrivals.iter().flatten().filter_map(|arrival| arrival.destination.as_ref());
        let transmitted =
            recording.transmissions.iter().flatten().filter_map(|transmission| transmission.destination.as_ref());
        for destination in received.chain(transmitted).filter(|destination| !indices.contains_key(destination)) {
            *self.unknown_destinations.entry(destination.clone()).or_default() += 1;
        }
    }

    /// Assembles the messages that a vehicle received, by sender.
    fn received_messages(
        &mut self,
        name: &VehicleId,
        recording: &Recording,
        indices: &BTreeMap<&VehicleId, usize>,
    ) -> BTreeMap<usize, Vec<Message>> {
        let mut by_source = BTreeMap::new();
        for arrival in recording.arrivals.iter().flatten() {
            match indices.get(&arrival.source) {
                Some(_) if arrival.source == *name => self.own_messages += 1,
                Some(&source) => by_source.entry(source).or_insert_with(Vec::new).push(arrival),
                None => *self.unknown_sources.entry(arrival.source.clone()).or_default() += 1,
            }
        }
        let mut messages_by_sender = BTreeMap::new();
        for (source, arrivals) in by_source {
            let (messages, duplicates) = assemble_messages(arrivals, self.rules);
            self.duplicates.extend((duplicates > 0).then_some(((indices[name], source), duplicates)));
            messages_by_sender.insert(source, messages);
        }
        messages_by_sender
    }

    pub(crate) fn index_of(&self, name: &VehicleId) -> Option<usize> {
        self.vehicles.binary_search_by(|vehicle| vehicle.name.cmp(name)).ok()
    }

    /// Estimates the travel time of sound between two vehicles, in seconds; 0 if a position is unknown.
    ///
    /// Each end is a vehicle and the time of its position by its own clock.
    pub(crate) fn travel_s(&self, sender: (usize, f64), receiver: (usize, f64)) -> f64 {
        let position = |(vehicle, time_s): (usize, f64)| self.vehicles[vehicle].track.estimate(time_s);
        let Some((a, b)) = position(sender).zip(position(receiver)) else { return 0.0 };
        let depth_difference_m = a.depth_m.zip(b.depth_m).map_or(0.0, |(a, b)| a - b);
        (a.east_m - b.east_m).hypot(a.north_m - b.north_m).hypot(depth_difference_m) / self.rules.sound_m_per_s
    }

    /// Returns the times at which satellites set a vehicle's clock, except for the first.
    pub(crate) fn clock_sync_times_s(&self, vehicle: usize) -> Vec<f64> {
        let mut syncs = self.vehicles[vehicle].recording.clock_syncs.clone();
        syncs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let interval_s = median(syncs.windows(2).map(|pair| pair[1].0 - pair[0].0).collect());
        let silence_s = SATELLITE_SILENCE_S.max(SATELLITE_SILENCE_INTERVALS * interval_s);
        // The clock is set continuously while the vehicle receives satellites, so only the first fix after a loss
        // matters.
        let is_resync = |pair: &&[(f64, bool)]| pair[1].1 && (!pair[0].1 || pair[1].0 - pair[0].0 > silence_s);
        syncs.windows(2).filter(is_resync).map(|pair| pair[1].0).collect()
    }

    /// Returns the vehicle to whose clock times are corrected.
    pub(crate) fn reference_clock(&self) -> Option<usize> {
        self.rules.reference_clock.as_ref().and_then(|name| self.index_of(name))
    }

    /// Returns the vehicles with a record of receptions.
    pub(crate) fn receivers(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.vehicles.len()).filter(|&vehicle| self.vehicles[vehicle].recording.arrivals.is_some())
    }

    /// Returns the times of the first and the last record.
    pub(crate) fn span_s(&self) -> (f64, f64) {
        let times = self.vehicles.iter().flat_map(|vehicle| {
            let recording = vehicle.recording;
            let fixes = recording.fixes.iter().map(|fix| fix.time_s);
            let arrivals = recording.arrivals.iter().flatten().map(|arrival| arrival.time_s);
            fixes
                .chain(arrivals)
                .chain(recording.transmissions.iter().flatten().map(|transmission| transmission.time_s))
        });
        times.fold((f64::INFINITY, f64::NEG_INFINITY), |(first_s, last_s), time_s| {
            (first_s.min(time_s), last_s.max(time_s))
        })
    }

    /// Lists names, separated by commas.
    pub(crate) fn names(&self, vehicles: &BTreeSet<usize>) -> String {
        vehicles.iter().map(|&vehicle| self.vehicles[vehicle].name.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// Lists all names, separated by commas.
    pub(crate) fn all_names(&self) -> String {
        self.names(&(0..self.vehicles.len()).collect())
    }
}

/// Returns the intervals in which a modem listened: those that the user stated, or else from its first to its last
/// record in each file.
///
/// If a message bounds such an interval, the message lies outside of it. It is recorded only because it was heard, so
/// that it would always count as a success.
fn active_spans(recording: &Recording, messages: &BTreeMap<usize, Vec<Message>>) -> Vec<(f64, f64)> {
    if !recording.listening.is_empty() {
        return recording.listening.clone();
    }
    let exclude_bounding_messages = |&(from_s, to_s): &(f64, f64)| {
        let (mut start_s, mut end_s) = (from_s, to_s);
        for message in messages.values().flatten() {
            if message.time_s == from_s {
                start_s = from_s + BOUNDARY_S;
            }
            if message.last_s == to_s {
                end_s = end_s.min(message.time_s - BOUNDARY_S);
            }
        }
        (start_s, end_s)
    };
    recording.modem_activity.iter().map(exclude_bounding_messages).collect()
}
