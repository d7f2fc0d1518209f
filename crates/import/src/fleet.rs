//! All vehicles, by number.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::VehicleId;

use crate::message::{Message, messages};
use crate::recording::Recordings;
use crate::reference::Reference;
use crate::rules::Rules;
use crate::track::Track;

/// One vehicle among others.
pub(crate) struct Vehicle<'a> {
    pub(crate) name: &'a VehicleId,
    pub(crate) recording: &'a crate::recording::Recording,
    pub(crate) track: Track,
    /// What reached it, by sender.
    pub(crate) messages: BTreeMap<usize, Vec<Message>>,
}

/// All vehicles of which something was recorded, in the order of their names.
pub(crate) struct Fleet<'a> {
    pub(crate) vehicles: Vec<Vehicle<'a>>,
    pub(crate) rules: &'a Rules,
    /// Messages from somebody of whom nothing was recorded.
    pub(crate) strangers: BTreeMap<VehicleId, usize>,
    /// Arrivals that were recorded twice.
    pub(crate) twice: usize,
    /// Messages that a vehicle heard of itself.
    pub(crate) own: usize,
}

impl<'a> Fleet<'a> {
    pub(crate) fn new(recordings: &'a Recordings, reference: &Reference, rules: &'a Rules) -> Self {
        let mut fleet = Self { vehicles: Vec::new(), rules, strangers: BTreeMap::new(), twice: 0, own: 0 };
        let numbers: BTreeMap<&VehicleId, usize> = recordings.keys().zip(0..).collect();
        for (name, recording) in recordings {
            let mut by_source = BTreeMap::new();
            for arrival in recording.arrivals.iter().flatten() {
                match numbers.get(&arrival.source) {
                    Some(_) if arrival.source == *name => fleet.own += 1,
                    Some(&source) => by_source.entry(source).or_insert_with(Vec::new).push(arrival),
                    None => *fleet.strangers.entry(arrival.source.clone()).or_default() += 1,
                }
            }
            let mut gathered = BTreeMap::new();
            for (source, arrivals) in by_source {
                let (messages, twice) = messages(arrivals, rules);
                fleet.twice += twice;
                gathered.insert(source, messages);
            }
            let track = Track::of(recording, reference);
            fleet.vehicles.push(Vehicle { name, recording, track, messages: gathered });
        }
        fleet
    }

    pub(crate) fn number(&self, name: &VehicleId) -> Option<usize> {
        self.vehicles.binary_search_by(|vehicle| vehicle.name.cmp(name)).ok()
    }

    /// How long sound takes from one vehicle to another, as far as one knows where they are.
    pub(crate) fn travel_s(&self, from: usize, to: usize, time_s: f64) -> f64 {
        let at = |vehicle: usize| self.vehicles[vehicle].track.near(time_s);
        let Some((a, b)) = at(from).zip(at(to)) else { return 0.0 };
        let deep_m = a.depth_m.zip(b.depth_m).map_or(0.0, |(a, b)| a - b);
        (a.east_m - b.east_m).hypot(a.north_m - b.north_m).hypot(deep_m) / self.rules.sound_m_per_s
    }

    /// The times at which a clock was set, but for the first.
    pub(crate) fn set_s(&self, vehicle: usize) -> Vec<f64> {
        let mut fixes: Vec<(f64, bool)> =
            self.vehicles[vehicle].recording.fixes.iter().map(|fix| (fix.time_s, fix.clock_set)).collect();
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0));
        // While it hears satellites it is set all the time.
        fixes.windows(2).filter(|pair| pair[1].1 && !pair[0].1).map(|pair| pair[1].0).collect()
    }

    /// Whoever listened.
    pub(crate) fn receivers(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.vehicles.len()).filter(|&vehicle| self.vehicles[vehicle].recording.arrivals.is_some())
    }

    /// From the first to the last thing that was recorded.
    pub(crate) fn span_s(&self) -> (f64, f64) {
        let times = self.vehicles.iter().flat_map(|vehicle| {
            let recording = vehicle.recording;
            let fixes = recording.fixes.iter().map(|fix| fix.time_s);
            let arrivals = recording.arrivals.iter().flatten().map(|arrival| arrival.time_s);
            fixes.chain(arrivals).chain(recording.sent.iter().flatten().map(|sent| sent.time_s))
        });
        times.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), time_s| (from.min(time_s), to.max(time_s)))
    }

    /// Names for people.
    pub(crate) fn names(&self, vehicles: &BTreeSet<usize>) -> String {
        vehicles.iter().map(|&vehicle| self.vehicles[vehicle].name.as_str()).collect::<Vec<_>>().join(", ")
    }
}
