//! The clocks of a fleet, estimated from its transmissions and receptions.

use std::collections::{BTreeMap, BTreeSet};

use crate::assemble::clocks::clock::{Clock, Comparison, Peak, find_peak, fit};
use crate::assemble::median::median;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Reception, Transmission};

/// Estimated offsets of all clocks, and the delay between the arrival of a message and its record.
pub(crate) struct FleetClocks {
    /// One clock for each vehicle.
    pub(crate) clocks: Vec<Clock>,
    /// Time from the start of a message to the record of its reception without the travel time of sound, in seconds.
    pub(crate) delay_s: f64,
    /// Index of the vehicle whose clock has the offset 0.
    pub(crate) reference: usize,
    /// Warnings about ambiguous offsets, as sentences.
    pub(crate) warnings: Vec<String>,
}

/// Longest travel time of sound that is considered, in seconds.
const TRAVEL_S_MAX: f64 = 60.0;

/// The clocks of the earlier and the later time of comparisons, and whether the earlier time derives from a reception,
/// too.
type ClockPair = (usize, usize, bool);

impl FleetClocks {
    /// Returns clocks without any offset.
    fn with_zero_offsets(fleet: &Fleet, reference: usize) -> Self {
        let clocks = fleet.vehicles.iter().map(|_| Clock::constant(0.0, &[], true)).collect();
        Self { clocks, delay_s: 0.0, reference, warnings: Vec::new() }
    }

    /// Estimates a constant offset for each clock, before any reception is matched to a transmission.
    ///
    /// The offset of a pair of clocks is the one at which most receptions fit a transmission. A spanning tree from the
    /// reference clock combines the pairs, those with the most receptions first.
    pub(crate) fn estimate_offsets(fleet: &Fleet, transmissions: &[Vec<Transmission>]) -> Self {
        let peaks = pair_peaks(fleet, transmissions);
        let reference = fleet.rules.reference_clock.as_ref().and_then(|name| fleet.index_of(name));
        let mut clocks = Self::with_zero_offsets(fleet, reference.unwrap_or_else(|| best_reference(fleet, &peaks)));
        if let Some(vehicle) = reference.filter(|&vehicle| !fleet.clock_sync_times_s(vehicle).is_empty()) {
            clocks.warnings.push(format!(
                "the clock of {0}, to which times are corrected, was set during the mission; its times before that are used as they are \
                 (name another vehicle with --correct-clocks, unless the steps were small)",
                fleet.vehicles[vehicle].name
            ));
        }
        if fleet.rules.clock_offset_s_max == 0.0 {
            // The clocks agree, so a difference consists of the delay only.
            let sender_comparisons = candidates(fleet, transmissions).filter(|(pair, _)| !pair.2);
            let differences_s = sender_comparisons.map(|(_, comparison)| comparison.difference_s()).collect();
            let peak = find_peak(differences_s, fleet.rules.match_s);
            clocks.delay_s = peak.map_or(0.0, |peak| peak.difference_s.max(0.0));
            return clocks;
        }
        clocks.delay_s = round_trip_delay_s(&peaks);
        let offsets_s = clocks.spanning_tree_offsets_s(fleet, &peaks);
        for (vehicle, clock) in clocks.clocks.iter_mut().enumerate() {
            let offset_s = offsets_s.get(&vehicle).copied();
            let sync_times_s = fleet.clock_sync_times_s(vehicle);
            *clock = Clock::constant(offset_s.unwrap_or(0.0), &sync_times_s, offset_s.is_some());
        }
        clocks
    }

    /// Returns the offset of each clock that a chain of pairs connects to the reference clock.
    fn spanning_tree_offsets_s(&mut self, fleet: &Fleet, peaks: &BTreeMap<ClockPair, Peak>) -> BTreeMap<usize, f64> {
        let mut offsets_s = BTreeMap::from([(self.reference, 0.0)]);
        loop {
            let is_at_border =
                |(start, arrival, _): &ClockPair| offsets_s.contains_key(start) != offsets_s.contains_key(arrival);
            let border = peaks.iter().filter(|(pair, _)| is_at_border(pair));
            let Some((&(start, arrival, is_by_reception), peak)) = border.max_by_key(|(_, peak)| peak.count) else {
                return offsets_s;
            };
            let delay_s = if is_by_reception { 0.0 } else { self.delay_s };
            let difference_s = peak.difference_s - delay_s;
            match offsets_s.get(&start).copied() {
                Some(offset_s) => offsets_s.insert(arrival, offset_s + difference_s),
                None => offsets_s.insert(start, offsets_s[&arrival] - difference_s),
            };
            if let Some(rival_s) = peak.rival_s {
                let [a, b] = [arrival, start].map(|vehicle| fleet.vehicles[vehicle].name);
                let rival_s = rival_s - delay_s;
                self.warnings.push(format!(
                    "the clock of {a} fits that of {b} with an offset of {difference_s:+.1} s, which is used, and nearly as well with \
                     {rival_s:+.1} s; --clock-offset-s-max limits the offset"
                ));
            }
        }
    }

    /// Predicts when a receiver records a transmission, by the receiver's clock in seconds.
    pub(crate) fn expected_s(
        &self,
        fleet: &Fleet,
        (sender, transmission): (usize, &Transmission),
        receiver: usize,
    ) -> f64 {
        let true_s = self.true_s(transmission);
        let travel_s = fleet.travel_s(sender, receiver, true_s);
        true_s + self.clocks[receiver].offset_s(true_s) + travel_s + self.delay_s
    }

    /// Returns the start of a transmission by the clock that its time is of, in seconds.
    pub(crate) fn start_s(&self, transmission: &Transmission) -> f64 {
        transmission.time_s - if transmission.is_reception_time { self.delay_s } else { 0.0 }
    }

    /// Returns the start of a transmission by the reference clock, in seconds.
    pub(crate) fn true_s(&self, transmission: &Transmission) -> f64 {
        let start_s = self.start_s(transmission);
        start_s - self.clocks[transmission.clock].offset_s(start_s)
    }

    /// Returns the start of a transmission by the clock of a vehicle, in seconds.
    pub(crate) fn local_s(&self, transmission: &Transmission, vehicle: usize) -> f64 {
        if transmission.clock == vehicle {
            return self.start_s(transmission);
        }
        let true_s = self.true_s(transmission);
        true_s + self.clocks[vehicle].offset_s(true_s)
    }

    /// Fits the clocks to receptions that are matched to transmissions.
    pub(crate) fn refit(&mut self, fleet: &Fleet, receptions: &[Reception]) {
        let comparisons = self.comparisons(fleet, receptions);
        if fleet.rules.clock_offset_s_max > 0.0 {
            fit(&mut self.clocks, &comparisons, self.reference);
        }
    }

    /// Returns a comparison of two clocks for each reception.
    pub(crate) fn comparisons(&self, fleet: &Fleet, receptions: &[Reception]) -> Vec<Comparison> {
        let comparison = |&Reception { sender, transmission, receiver, time_s }: &Reception| {
            let start_s = self.start_s(transmission);
            let travel_s = fleet.travel_s(sender, receiver, start_s);
            Comparison { start: (transmission.clock, start_s), arrival: (receiver, time_s - travel_s - self.delay_s) }
        };
        receptions
            .iter()
            .filter(|reception| reception.transmission.clock != reception.receiver)
            .map(comparison)
            .collect()
    }

    /// Estimates the offset of each segment separately, for clocks that were set during the mission.
    pub(crate) fn search_segments(&mut self, fleet: &Fleet, transmissions: &[Vec<Transmission>]) {
        for vehicle in (0..self.clocks.len()).filter(|&vehicle| vehicle != self.reference) {
            if self.clocks[vehicle].segments().count() > 1 && self.clocks[vehicle].is_determined {
                let candidates =
                    candidates(fleet, transmissions).filter(|(pair, _)| [pair.0, pair.1].contains(&vehicle));
                let comparisons: Vec<Comparison> = candidates
                    .map(|(pair, mut comparison)| {
                        comparison.arrival.1 -= if pair.2 { 0.0 } else { self.delay_s };
                        comparison
                    })
                    .collect();
                let others = self.clocks.clone();
                self.clocks[vehicle].search(vehicle, &comparisons, &others, fleet.rules.match_s);
            }
        }
    }
}

/// Returns the vehicle with the most comparisons. A clock that was never set during the mission takes precedence.
fn best_reference(fleet: &Fleet, peaks: &BTreeMap<ClockPair, Peak>) -> usize {
    let mut comparisons = vec![0; fleet.vehicles.len()];
    for ((start, arrival, _), peak) in peaks {
        comparisons[*start] += peak.count;
        comparisons[*arrival] += peak.count;
    }
    let rank = |vehicle: usize| (fleet.clock_sync_times_s(vehicle).is_empty(), comparisons[vehicle]);
    (0..comparisons.len()).rev().max_by_key(|&vehicle| rank(vehicle)).unwrap_or(0)
}

/// Returns a comparison for each reception with each transmission of its sender that it may stem from.
fn candidates<'a>(
    fleet: &'a Fleet,
    transmissions: &'a [Vec<Transmission>],
) -> impl Iterator<Item = (ClockPair, Comparison)> + 'a {
    // A difference consists of the clock offset and the delay until a message is recorded.
    let difference_s_max = fleet.rules.clock_offset_s_max + fleet.rules.message_s;
    fleet.receivers().flat_map(move |receiver| {
        let messages = fleet.vehicles[receiver].messages.iter();
        messages.flat_map(move |(&sender, messages)| {
            messages.iter().flat_map(move |message| {
                let first = transmissions[sender].partition_point(|transmission| {
                    transmission.time_s < message.time_s - difference_s_max - TRAVEL_S_MAX
                });
                let candidates = transmissions[sender][first..]
                    .iter()
                    .take_while(move |transmission| transmission.time_s <= message.time_s + difference_s_max);
                candidates.filter(move |transmission| transmission.clock != receiver).filter_map(move |transmission| {
                    let travel_s = fleet.travel_s(sender, receiver, transmission.time_s);
                    let arrival_s = message.time_s - travel_s;
                    let comparison =
                        Comparison { start: (transmission.clock, transmission.time_s), arrival: (receiver, arrival_s) };
                    let is_near = comparison.difference_s().abs() <= difference_s_max;
                    is_near.then_some(((transmission.clock, receiver, transmission.is_reception_time), comparison))
                })
            })
        })
    })
}

/// Returns the most frequent difference of each pair of clocks.
fn pair_peaks(fleet: &Fleet, transmissions: &[Vec<Transmission>]) -> BTreeMap<ClockPair, Peak> {
    let mut differences_s: BTreeMap<ClockPair, Vec<f64>> = BTreeMap::new();
    for (pair, comparison) in candidates(fleet, transmissions) {
        differences_s.entry(pair).or_default().push(comparison.difference_s());
    }
    let peaks = differences_s
        .into_iter()
        .filter_map(|(pair, differences_s)| Some((pair, find_peak(differences_s, fleet.rules.match_s)?)));
    peaks.collect()
}

/// Estimates the recording delay as half of the round trip by the clocks of both ends: the median over all pairs, in
/// seconds.
///
/// Returns 0 if no pair of vehicles heard each other.
fn round_trip_delay_s(peaks: &BTreeMap<ClockPair, Peak>) -> f64 {
    let pairs: BTreeSet<(usize, usize)> = peaks.keys().filter(|pair| !pair.2).map(|pair| (pair.0, pair.1)).collect();
    let half_round_trip = |&(start, arrival): &(usize, usize)| {
        let outbound_s = peaks.get(&(start, arrival, false))?.difference_s;
        let return_s = peaks.get(&(arrival, start, false))?.difference_s;
        (start < arrival).then_some((outbound_s + return_s) / 2.0)
    };
    median(pairs.iter().filter_map(half_round_trip).collect()).max(0.0)
}
