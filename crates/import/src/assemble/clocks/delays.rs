//! Delays between the recorded time of a transmission and the record of its reception.

use std::collections::BTreeMap;

use pingmap_agent::MessageKind;

use crate::assemble::median::median;

/// Rounds of the estimate. Each round estimates every delay once from the others.
const ROUNDS: usize = 60;

/// Smallest number of receptions from which the delay of one kind of message is estimated.
const KIND_RECEPTIONS_MIN: usize = 5;

/// The delays of all senders, without the travel time of sound.
///
/// The delay from the record of a transmission to the record of its reception depends on both programs. They record the
/// start or the end of a packet, or the time at which they polled the modem. Only the sum of the delays in both
/// directions of a pair can be separated from the clock offset. One delay for each vehicle explains all these sums. The
/// remaining part acts as a clock offset.
#[derive(Debug, Clone, Default)]
pub(crate) struct Delays {
    by_sender_s: Vec<f64>,
    /// Further delay of one kind of message, relative to the most common kind of the sender.
    by_kind_s: BTreeMap<(usize, MessageKind), f64>,
}

impl Delays {
    /// Returns one delay for all `vehicles`.
    pub(crate) fn constant(vehicles: usize, delay_s: f64) -> Self {
        Self { by_sender_s: vec![delay_s; vehicles], by_kind_s: BTreeMap::new() }
    }

    /// Estimates a delay for each vehicle from the differences of pairs: `differences_s` by sender and receiver.
    ///
    /// The sum of the differences in both directions is the sum of both delays, because the clock offset cancels. If no
    /// pair with a vehicle has both directions, the vehicle gets the median delay.
    pub(crate) fn from_round_trips(vehicles: usize, differences_s: &BTreeMap<(usize, usize), f64>) -> Self {
        let mut sums: Vec<Vec<(usize, f64)>> = vec![Vec::new(); vehicles];
        for (&(a, b), out_s) in differences_s {
            if let Some(back_s) = differences_s.get(&(b, a)) {
                sums[a].push((b, out_s + back_s));
            }
        }
        let halves = sums.iter().flatten().map(|(_, sum_s)| sum_s / 2.0).collect();
        let common_s = median(halves);
        let mut delays_s = vec![common_s; vehicles];
        for _ in 0..ROUNDS {
            for vehicle in (0..vehicles).filter(|&vehicle| !sums[vehicle].is_empty()) {
                delays_s[vehicle] =
                    median(sums[vehicle].iter().map(|&(other, sum_s)| sum_s - delays_s[other]).collect());
            }
        }
        Self { by_sender_s: delays_s, by_kind_s: BTreeMap::new() }
    }

    /// Returns the delay of messages of a sender and a kind, in seconds.
    pub(crate) fn delay_s(&self, sender: usize, kind: Option<&MessageKind>) -> f64 {
        let by_kind_s = kind.and_then(|kind| self.by_kind_s.get(&(sender, kind.clone())));
        self.by_sender_s[sender] + by_kind_s.copied().unwrap_or(0.0)
    }

    /// Returns the delay of the most common kind of a sender, in seconds.
    pub(crate) fn of_sender_s(&self, sender: usize) -> f64 {
        self.by_sender_s[sender]
    }

    /// Returns the median delay over all senders, in seconds.
    pub(crate) fn median_s(&self) -> f64 {
        median(self.by_sender_s.clone())
    }

    /// Adds the median residual of each kind, relative to the most common kind of its sender.
    pub(crate) fn refit_kinds<'a>(&mut self, residuals: impl Iterator<Item = (usize, &'a MessageKind, f64)>) {
        let mut by_sender: BTreeMap<usize, BTreeMap<&MessageKind, Vec<f64>>> = BTreeMap::new();
        for (sender, kind, residual_s) in residuals {
            by_sender.entry(sender).or_default().entry(kind).or_default().push(residual_s);
        }
        for (sender, kinds) in by_sender {
            let Some(common) = kinds.values().max_by_key(|residuals_s| residuals_s.len()) else { continue };
            let common_s = median(common.clone());
            for (kind, residuals_s) in kinds {
                if residuals_s.len() >= KIND_RECEPTIONS_MIN {
                    *self.by_kind_s.entry((sender, kind.clone())).or_default() += median(residuals_s) - common_s;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trips_separate_late_records_of_transmissions_from_clock_offsets() {
        // Vehicle 0 records its transmissions 5 s late. The clock of vehicle 2 is 3 s ahead. All records of receptions
        // are 1 s late.
        let (clocks_s, delays_s) = ([0.0, 0.0, 3.0], [-4.0, 1.0, 1.0]);
        let pairs = (0..3).flat_map(|a| (0..3).map(move |b| (a, b))).filter(|(a, b)| a != b);
        let differences_s = pairs.map(|(a, b)| ((a, b), clocks_s[b] - clocks_s[a] + delays_s[a])).collect();
        let found = Delays::from_round_trips(3, &differences_s);
        for (vehicle, delay_s) in delays_s.into_iter().enumerate() {
            assert!((found.of_sender_s(vehicle) - delay_s).abs() < 1e-6, "{vehicle}: {found:?}");
        }
        // Two vehicles determine the mean of their delays only.
        let found = Delays::from_round_trips(2, &BTreeMap::from([((0, 1), 1.0), ((1, 0), 2.0)]));
        assert_eq!((found.of_sender_s(0), found.of_sender_s(1)), (1.5, 1.5));
    }

    #[test]
    fn delays_of_kinds_are_relative_to_the_most_common_kind() {
        let [short, long] = ["short", "long"].map(MessageKind::new);
        let residuals = (0..20).map(|n| if n < 12 { (0, &short, 0.1) } else { (0, &long, 2.1) });
        let mut delays = Delays::constant(1, 1.0);
        delays.refit_kinds(residuals);
        let found = [None, Some(&short), Some(&long)].map(|kind| delays.delay_s(0, kind));
        assert!((found[0] - 1.0).abs() + (found[1] - 1.0).abs() + (found[2] - 3.0).abs() < 1e-9, "{found:?}");
    }
}
