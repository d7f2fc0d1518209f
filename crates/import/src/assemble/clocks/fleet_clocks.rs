//! The clocks of a fleet, estimated from its transmissions and receptions.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;

use crate::assemble::clocks::clock::{Clock, Comparison, fit};
use crate::assemble::clocks::delays::Delays;
use crate::assemble::clocks::peak::{Peak, find_peak};
use crate::assemble::clocks::step::ClockStep;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Reception, Transmission};

/// Estimated offsets of all clocks, and the delays between the records of transmissions and receptions.
pub(crate) struct FleetClocks {
    /// One clock for each vehicle.
    pub(crate) clocks: Vec<Clock>,
    /// Delays between the record of a transmission and the record of its reception.
    pub(crate) delays: Delays,
    /// Index of the vehicle whose clock has the offset 0.
    pub(crate) reference: usize,
    /// Clocks with several offsets that fit equally well.
    pub(crate) ambiguities: Vec<ClockAmbiguity>,
    /// Steps of clocks that no record shows, by vehicle.
    pub(crate) steps: Vec<(usize, ClockStep)>,
    /// The most frequent difference of each pair of clocks.
    peaks: BTreeMap<ClockPair, Peak>,
    /// The differences of records of receptions to those of transmissions, in seconds, by sender and receiver.
    pub(crate) differences_s: BTreeMap<(usize, usize), f64>,
}

/// Several offsets between two clocks that fit the receptions equally well, because slots repeat.
#[derive(Debug, Clone, PartialEq)]
pub struct ClockAmbiguity {
    /// The vehicle whose clock is compared.
    pub clock: VehicleId,
    /// The vehicle whose clock it is compared with.
    pub other: VehicleId,
    /// The offset that is used, in seconds.
    pub offset_s: f64,
    /// The other offsets, in seconds.
    pub others_s: Vec<f64>,
}

/// Longest travel time of sound that is considered, in seconds.
const TRAVEL_S_MAX: f64 = 60.0;

/// Clock offsets are searched up to this limit, in seconds, even if the rules state a lower one. A larger offset than
/// that of the rules is used only if its residuals are clearly smaller.
const SEARCH_S_MIN: f64 = 60.0;

/// The clocks of the earlier and the later time of comparisons, and whether the earlier time derives from a reception,
/// too.
type ClockPair = (usize, usize, bool);

impl FleetClocks {
    /// Returns clocks without any offset.
    fn with_zero_offsets(fleet: &Fleet, reference: usize) -> Self {
        let clocks = fleet.vehicles.iter().map(|_| Clock::constant(0.0, &[], true)).collect();
        let delays = Delays::constant(fleet.vehicles.len(), 0.0);
        let (peaks, differences_s) = (BTreeMap::new(), BTreeMap::new());
        Self { clocks, delays, reference, ambiguities: Vec::new(), steps: Vec::new(), peaks, differences_s }
    }

    /// Estimates a constant offset for each clock, before any reception is matched to a transmission.
    ///
    /// The offset of a pair of clocks is the one at which most receptions fit a transmission. A spanning tree from the
    /// reference clock combines the pairs, those with the most receptions first.
    pub(crate) fn estimate_offsets(fleet: &Fleet, transmissions: &[Vec<Transmission>]) -> Self {
        let limit_s = difference_s_max(fleet);
        if fleet.rules.clock_offset_s_max == 0.0 {
            // The clocks agree, so a difference consists of the delay only.
            let mut clocks = Self::with_zero_offsets(fleet, fleet.reference_clock().unwrap_or(0));
            let by_sender = candidates(fleet, transmissions, limit_s).filter(|(pair, _)| !pair.2);
            let points = by_sender.map(|(_, comparison)| comparison.point()).collect();
            let delay_s = find_peak(points, limit_s).map_or(0.0, |peak| peak.difference_s.max(0.0));
            clocks.delays = Delays::constant(fleet.vehicles.len(), delay_s);
            return clocks;
        }
        let peaks = pair_peaks(fleet, transmissions);
        let reference = fleet.reference_clock().unwrap_or_else(|| best_reference(fleet, &peaks));
        let mut clocks = Self::with_zero_offsets(fleet, reference);
        let by_sender = peaks.iter().filter(|(pair, _)| !pair.2);
        clocks.differences_s = by_sender.map(|(pair, peak)| ((pair.0, pair.1), peak.difference_s)).collect();
        clocks.peaks = peaks;
        clocks.set_offsets(fleet);
        clocks
    }

    /// Sets the delays and a constant offset for each clock from the peaks.
    pub(crate) fn set_offsets(&mut self, fleet: &Fleet) {
        self.delays = Delays::from_round_trips(fleet.vehicles.len(), &self.differences_s);
        self.ambiguities.clear();
        let offsets_s = self.spanning_tree_offsets_s(fleet);
        for (vehicle, clock) in self.clocks.iter_mut().enumerate() {
            let offset_s = offsets_s.get(&vehicle).copied();
            let sync_times_s = fleet.clock_sync_times_s(vehicle);
            *clock = Clock::constant(offset_s.unwrap_or(0.0), &sync_times_s, offset_s.is_some());
        }
    }

    /// Returns the offset of each clock that a chain of pairs connects to the reference clock.
    fn spanning_tree_offsets_s(&mut self, fleet: &Fleet) -> BTreeMap<usize, f64> {
        let mut offsets_s = BTreeMap::from([(self.reference, 0.0)]);
        loop {
            let is_at_border =
                |(start, arrival, _): &ClockPair| offsets_s.contains_key(start) != offsets_s.contains_key(arrival);
            let border = self.peaks.iter().filter(|(pair, _)| is_at_border(pair));
            let Some((&(start, arrival, is_by_reception), peak)) = border.max_by_key(|(_, peak)| peak.count) else {
                return offsets_s;
            };
            let delay_s = if is_by_reception { 0.0 } else { self.delays.of_sender_s(start) };
            let offset_s = peak.difference_s - delay_s;
            match offsets_s.get(&start).copied() {
                Some(start_offset_s) => offsets_s.insert(arrival, start_offset_s + offset_s),
                None => offsets_s.insert(start, offsets_s[&arrival] - offset_s),
            };
            if !peak.rivals_s.is_empty() {
                let [clock, other] = [arrival, start].map(|vehicle| fleet.vehicles[vehicle].name.clone());
                let others_s = peak.rivals_s.iter().map(|rival_s| rival_s - delay_s).collect();
                self.ambiguities.push(ClockAmbiguity { clock, other, offset_s, others_s });
            }
        }
    }

    /// Predicts when a receiver records a transmission, by the receiver's clock in seconds. The further delay of the
    /// message's kind is not included.
    pub(crate) fn expected_s(
        &self,
        fleet: &Fleet,
        (sender, transmission): (usize, &Transmission),
        receiver: usize,
    ) -> f64 {
        let true_s = self.true_s(transmission);
        let receiver_s = true_s + self.clocks[receiver].offset_s(true_s);
        let travel_s = fleet.travel_s((sender, self.local_s(transmission, sender)), (receiver, receiver_s));
        receiver_s + travel_s + self.delays.of_sender_s(sender)
    }

    /// Returns the start of a transmission by the clock that its time is of, in seconds.
    pub(crate) fn start_s(&self, transmission: &Transmission) -> f64 {
        let delay_s = || self.delays.delay_s(transmission.sender, transmission.kind.as_ref());
        transmission.time_s - if transmission.is_reception_time { delay_s() } else { 0.0 }
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

    /// Fits the clocks, and the delays of kinds of messages, to receptions that are matched to transmissions.
    pub(crate) fn refit(&mut self, fleet: &Fleet, receptions: &[Reception]) {
        if fleet.rules.clock_offset_s_max > 0.0 {
            let comparisons: Vec<Comparison> = self.comparisons(fleet, receptions).map(|(_, one)| one).collect();
            fit(&mut self.clocks, &comparisons, self.reference);
        }
        let residuals: Vec<_> = self
            .comparisons(fleet, receptions)
            .filter_map(|(reception, comparison)| {
                Some((reception.sender, reception.kind?, comparison.residual_s(&self.clocks)))
            })
            .collect();
        self.delays.refit_kinds(residuals.into_iter());
    }

    /// Returns a comparison of two clocks for each reception.
    pub(crate) fn comparisons<'a, 'r>(
        &'a self,
        fleet: &'a Fleet,
        receptions: &'a [Reception<'r>],
    ) -> impl Iterator<Item = (&'a Reception<'r>, Comparison)> {
        receptions.iter().filter(|reception| reception.transmission.clock != reception.receiver).map(|reception| {
            let &Reception { sender, transmission, receiver, time_s, kind } = reception;
            let start_s = self.start_s(transmission);
            let travel_s = fleet.travel_s((sender, self.local_s(transmission, sender)), (receiver, time_s));
            let delay_s = travel_s + self.delays.delay_s(sender, kind);
            let comparison = Comparison { start: (transmission.clock, start_s), arrival: (receiver, time_s - delay_s) };
            (reception, comparison)
        })
    }

    /// Estimates the offset of each segment separately, for clocks that were set during the mission. A segment without
    /// a peak keeps its offset.
    pub(crate) fn search_segments(&mut self, fleet: &Fleet, transmissions: &[Vec<Transmission>]) {
        let limit_s = difference_s_max(fleet);
        for vehicle in (0..self.clocks.len()).filter(|&vehicle| vehicle != self.reference) {
            if self.clocks[vehicle].segments().count() > 1 && self.clocks[vehicle].is_determined {
                let with_vehicle = candidates(fleet, transmissions, limit_s)
                    .filter(|(pair, _)| [pair.0, pair.1].contains(&vehicle))
                    .map(|(pair, mut comparison)| {
                        comparison.arrival.1 -= if pair.2 { 0.0 } else { self.delays.of_sender_s(pair.0) };
                        comparison
                    });
                let comparisons: Vec<Comparison> = with_vehicle.collect();
                let points = self.clocks[vehicle].implied_offsets(vehicle, &comparisons, &self.clocks);
                for (segment, points) in points.into_iter().enumerate() {
                    if let Some(peak) = find_peak(points, limit_s) {
                        self.clocks[vehicle].set_offset(segment, peak.difference_s);
                    }
                }
            }
        }
    }
}

/// Returns the largest difference between the records of a transmission and a reception: the clock offset and the delay
/// until a message is recorded.
fn difference_s_max(fleet: &Fleet) -> f64 {
    fleet.rules.clock_offset_s_max + fleet.rules.message_s
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
    difference_s_max: f64,
) -> impl Iterator<Item = (ClockPair, Comparison)> + 'a {
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
                    let travel_s = fleet.travel_s((sender, transmission.time_s), (receiver, message.time_s));
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
    let limit_s = difference_s_max(fleet);
    let mut points: BTreeMap<ClockPair, Vec<(f64, f64)>> = BTreeMap::new();
    for (pair, comparison) in candidates(fleet, transmissions, limit_s.max(SEARCH_S_MIN)) {
        points.entry(pair).or_default().push(comparison.point());
    }
    points.into_iter().filter_map(|(pair, points)| Some((pair, find_peak(points, limit_s)?))).collect()
}
