//! All vehicles, by number.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::VehicleId;

use crate::clock::median;
use crate::message::{Message, messages};
use crate::recording::{Recording, Recordings};
use crate::reference::Reference;
use crate::rules::Rules;
use crate::track::Track;

/// A receiver of satellites that says nothing for longer was under water: in seconds, and in times of what is usual for it.
const SATELLITES_S: f64 = 60.0;
const SATELLITES_TIMES: f64 = 5.0;

/// One vehicle among others.
pub(crate) struct Vehicle<'a> {
    pub(crate) name: &'a VehicleId,
    pub(crate) recording: &'a Recording,
    pub(crate) track: Track,
    /// What reached it, by sender.
    pub(crate) messages: BTreeMap<usize, Vec<Message>>,
    /// From when to when its modem was at work for all that anybody knows.
    pub(crate) at_work: Vec<(f64, f64)>,
}

/// All vehicles of which something was recorded, in the order of their names.
pub(crate) struct Fleet<'a> {
    pub(crate) vehicles: Vec<Vehicle<'a>>,
    pub(crate) rules: &'a Rules,
    /// Messages from somebody of whom nothing was recorded.
    pub(crate) strangers: BTreeMap<VehicleId, usize>,
    /// Messages to somebody of whom nothing was recorded.
    pub(crate) to_strangers: BTreeMap<VehicleId, usize>,
    /// Arrivals that were recorded twice, by receiver and sender.
    pub(crate) twice: BTreeMap<(usize, usize), usize>,
    /// Messages that a vehicle heard of itself.
    pub(crate) own: usize,
}

impl<'a> Fleet<'a> {
    pub(crate) fn new(recordings: &'a Recordings, reference: &Reference, rules: &'a Rules) -> Self {
        let (strangers, to_strangers) = (BTreeMap::new(), BTreeMap::new());
        let mut fleet = Self { vehicles: Vec::new(), rules, strangers, to_strangers, twice: BTreeMap::new(), own: 0 };
        let numbers: BTreeMap<&VehicleId, usize> = recordings.keys().zip(0..).collect();
        for (name, recording) in recordings {
            let received = recording.arrivals.iter().flatten().filter_map(|arrival| arrival.destination.as_ref());
            let sent = recording.sent.iter().flatten().filter_map(|sent| sent.destination.as_ref());
            for to in received.chain(sent).filter(|to| !numbers.contains_key(to)) {
                *fleet.to_strangers.entry(to.clone()).or_default() += 1;
            }
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
                fleet.twice.extend((twice > 0).then_some(((numbers[name], source), twice)));
                gathered.insert(source, messages);
            }
            let track = Track::of(recording, reference);
            let at_work = at_work(recording, &gathered, rules.match_s);
            fleet.vehicles.push(Vehicle { name, recording, track, messages: gathered, at_work });
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
        let mut told = self.vehicles[vehicle].recording.clock_set.clone();
        told.sort_by(|a, b| a.0.total_cmp(&b.0));
        let usual_s = median(told.windows(2).map(|pair| pair[1].0 - pair[0].0).collect());
        let silence_s = SATELLITES_S.max(SATELLITES_TIMES * usual_s);
        // While it hears satellites it is set all the time.
        let is_anew = |pair: &&[(f64, bool)]| pair[1].1 && (!pair[0].1 || pair[1].0 - pair[0].0 > silence_s);
        told.windows(2).filter(is_anew).map(|pair| pair[1].0).collect()
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

/// When a modem was at work: when it is said to have listened, and from the first to the last sign of it. Where such a sign is a message,
/// that one is left out: it is there because it was heard, and would be among what counts each time.
fn at_work(recording: &Recording, messages: &BTreeMap<usize, Vec<Message>>, match_s: f64) -> Vec<(f64, f64)> {
    let between = |&(from_s, to_s): &(f64, f64)| {
        let (mut after_s, mut before_s) = (from_s, to_s);
        for message in messages.values().flatten() {
            if message.time_s == from_s {
                after_s = from_s + match_s;
            }
            if message.last_s == to_s {
                before_s = before_s.min(message.time_s - match_s);
            }
        }
        (after_s, before_s)
    };
    recording.signs.iter().map(between).chain(recording.listening.iter().copied()).collect()
}
