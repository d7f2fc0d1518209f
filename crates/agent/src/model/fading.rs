//! Fading: the correlation of successive outcomes of one link, and the weights of events that follow from it
//! (docs/method/repeats.md).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::types::bounds::{self, Bounds};
use crate::types::event::{Event, VehicleId};

/// The correlation of outcomes of one transmitter at one receiver while both are nearly stationary.
///
/// It is the correlation that remains after the position is accounted for. For two outcomes t seconds apart it is
/// correlation · exp(−t/memory_s − (v/drift_m_per_s)²). Here v is the sum of the mean speeds of both ends between the
/// outcomes, in metres per second. Moorings and drifting vehicles repeat a transmission every few seconds, so each
/// outcome carries less information than an isolated one. For vehicles under way time and position change together, and
/// the kernel models their correlation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fading {
    /// Correlation of two outcomes at equal times and positions, from 0 to 1.
    pub correlation: f64,
    /// Time constant of the exponential decay, in seconds.
    pub memory_s: f64,
    /// Speed of both ends together at which the correlation falls to 1/e, in metres per second.
    pub drift_m_per_s: f64,
}

impl Default for Fading {
    /// Returns the fading that is assumed without data. Under it 300 outcomes in 300 seconds at one position count as
    /// 44.
    fn default() -> Self {
        Self { correlation: 0.35, memory_s: 10.0, drift_m_per_s: 0.15 }
    }
}

/// Largest lag with a correlation, as a multiple of the time constant.
const LAG_MAX_MEMORIES: f64 = 3.0;

/// Smallest motion factor of a pair of outcomes from which fading is estimated.
#[cfg(feature = "learn")]
const MOTION_FACTOR_MIN: f64 = 0.05;

/// Largest lag of a pair of outcomes from which fading is estimated, in seconds.
#[cfg(feature = "learn")]
const ESTIMATION_LAG_MAX_S: f64 = 120.0;

/// Weight of the assumed fading in an estimate, in outcomes.
#[cfg(feature = "learn")]
const PRIOR_WEIGHT: f64 = 30.0;

/// Largest estimate of the correlation. It is below 1, because no outcome determines the next one.
#[cfg(feature = "learn")]
const CORRELATION_MAX: f64 = 0.95;

/// Largest number of earlier outcomes of a pair that are compared with a new one. With more of them its weight is close
/// to zero anyway.
const EARLIER_MAX: usize = 1000;

impl Fading {
    /// Fading without correlation. Every outcome has weight 1.
    pub const NONE: Self = Self { correlation: 0.0, memory_s: 1.0, drift_m_per_s: 1.0 };

    /// Returns the key in a model file, the value and the bounds of every parameter.
    pub fn entries(&self) -> [(&'static str, f64, Bounds); 3] {
        [
            ("fading.correlation", self.correlation, bounds::SHARE),
            ("fading.memory_s", self.memory_s, bounds::POSITIVE),
            ("fading.drift_m_per_s", self.drift_m_per_s, bounds::POSITIVE),
        ]
    }

    /// Computes the weight of every event, N values.
    ///
    /// The weight is 1/(1 + 2Σc), with c the correlations with earlier events of the same pair of vehicles. The weights
    /// of steady repetitions add up to the effective sample size of their mean. Takes O(N log N), plus O(1) for every
    /// pair of outcomes within the largest lag. An event has at most a thousand such pairs.
    pub fn weights(&self, events: &[&Event]) -> Vec<f64> {
        let mut weights = vec![1.0; events.len()];
        for indices in group_by_pair(events).into_values() {
            for (done, &index) in indices.iter().enumerate() {
                let earlier = indices[..done].iter().rev().map(|&index| events[index]);
                weights[index] = self.weight(events[index], earlier);
            }
        }
        weights
    }

    /// Computes the weight of an event given earlier events, which are ordered from the latest to the earliest.
    pub(crate) fn weight<'a>(&self, event: &Event, earlier: impl Iterator<Item = &'a Event>) -> f64 {
        let within = earlier.take_while(|earlier| event.time_s - earlier.time_s <= LAG_MAX_MEMORIES * self.memory_s);
        let repeated = within.filter(|earlier| is_same_pair(earlier, event)).take(EARLIER_MAX);
        let correlation =
            |earlier| self.correlation * self.motion_factor(earlier, event) * self.lag_factor(earlier, event);
        let sum: f64 = repeated.map(correlation).sum();
        1.0 / (1.0 + 2.0 * sum)
    }

    /// Estimates fading from the residuals of predictions of `events`. `probabilities` has one entry per event.
    ///
    /// The estimate is a least-squares fit to products of standardised residuals. Each product is of two outcomes of
    /// one pair of vehicles, and the products of each outcome have weight 1 together. The present fading enters as a
    /// prior with the weight of thirty outcomes. The drift does not change. The cost is that of [`Fading::weights`]
    /// with a largest lag of two minutes.
    #[cfg(feature = "learn")]
    pub(crate) fn reestimate(&self, events: &[&Event], probabilities: &[f64]) -> Self {
        let residual = |n: usize| {
            let p = probabilities[n].clamp(1e-3, 1.0 - 1e-3);
            (f64::from(u8::from(events[n].success)) - p) / (p * (1.0 - p)).sqrt()
        };
        let mut fits = MemoryFit::ALL_MEMORIES_S.map(MemoryFit::new);
        let mut add = |products: &[ResidualProduct], weight| fits.iter_mut().for_each(|fit| fit.add(products, weight));
        add(&self.prior_products(), PRIOR_WEIGHT);
        for indices in group_by_pair(events).into_values() {
            for (done, &later) in indices.iter().enumerate() {
                let lag_s = |earlier: usize| events[later].time_s - events[earlier].time_s;
                let stationary = |&earlier: &usize| {
                    let motion_factor = self.motion_factor(events[earlier], events[later]);
                    let product = residual(earlier) * residual(later);
                    let lag_s = lag_s(earlier);
                    (motion_factor >= MOTION_FACTOR_MIN).then_some(ResidualProduct { lag_s, motion_factor, product })
                };
                let within =
                    indices[..done].iter().rev().take_while(|&&earlier| lag_s(earlier) <= ESTIMATION_LAG_MAX_S);
                add(&within.take(EARLIER_MAX).filter_map(stationary).collect::<Vec<_>>(), 1.0);
            }
        }
        let best = fits.into_iter().reduce(|best, next| if next.explained() > best.explained() { next } else { best });
        best.map_or(*self, |best| Self { correlation: best.correlation(), memory_s: best.memory_s, ..*self })
    }

    /// Returns the residual products that this fading predicts, at lags up to three time constants.
    #[cfg(feature = "learn")]
    fn prior_products(&self) -> Vec<ResidualProduct> {
        const POINTS: u32 = 30;
        let at = |step: u32| {
            let memories = LAG_MAX_MEMORIES * f64::from(step) / f64::from(POINTS);
            let product = self.correlation * (-memories).exp();
            ResidualProduct { lag_s: memories * self.memory_s, motion_factor: 1.0, product }
        };
        (1..=POINTS).map(at).collect()
    }

    /// Returns the factor by which the lag between two events reduces their correlation.
    fn lag_factor(&self, earlier: &Event, later: &Event) -> f64 {
        (-(later.time_s - earlier.time_s) / self.memory_s).exp()
    }

    /// Returns the factor by which motion of the ends reduces the correlation of two events. It is 1 without motion.
    fn motion_factor(&self, earlier: &Event, later: &Event) -> f64 {
        let (moved_m, drift_m) = (displacement_m(earlier, later), self.drift_m_per_s * (later.time_s - earlier.time_s));
        if moved_m == 0.0 { 1.0 } else { (-(moved_m / drift_m).powi(2)).exp() }
    }
}

/// The product of the standardised residuals of two outcomes.
#[cfg(feature = "learn")]
struct ResidualProduct {
    lag_s: f64,
    /// Factor by which motion reduces the correlation of the outcomes.
    motion_factor: f64,
    product: f64,
}

/// A least-squares estimate of the correlation for one value of the time constant.
#[cfg(feature = "learn")]
struct MemoryFit {
    memory_s: f64,
    /// Weighted sum of expected times observed products, for correlation 1.
    cross: f64,
    /// Weighted sum of squared expected products, for correlation 1.
    square: f64,
}

#[cfg(feature = "learn")]
impl MemoryFit {
    /// Candidate time constants, in seconds.
    const ALL_MEMORIES_S: [f64; 13] = [2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 15.0, 22.0, 30.0, 42.0, 60.0, 85.0, 120.0];

    /// Returns a fit without data.
    fn new(memory_s: f64) -> Self {
        Self { memory_s, cross: 0.0, square: 0.0 }
    }

    /// Adds products. `weight` is the weight of all of them together.
    fn add(&mut self, products: &[ResidualProduct], weight: f64) {
        let each = weight / products.len().max(1) as f64;
        for ResidualProduct { lag_s, motion_factor, product } in products {
            let expected = motion_factor * (-lag_s / self.memory_s).exp();
            self.cross += each * expected * product;
            self.square += each * expected * expected;
        }
    }

    /// Returns the estimated correlation, clamped to its range.
    fn correlation(&self) -> f64 {
        (self.cross / self.square.max(f64::MIN_POSITIVE)).clamp(0.0, CORRELATION_MAX)
    }

    /// Returns the reduction of the sum of squares by this fit.
    fn explained(&self) -> f64 {
        let correlation = self.correlation();
        correlation * (2.0 * self.cross - correlation * self.square)
    }
}

/// Returns true if both events have the same transmitter and the same receiver.
fn is_same_pair(a: &Event, b: &Event) -> bool {
    a.transmitter_id == b.transmitter_id && a.receiver_id == b.receiver_id
}

/// Returns the indices of the events of every pair of vehicles, in canonical order.
fn group_by_pair<'a>(events: &[&'a Event]) -> BTreeMap<(&'a VehicleId, &'a VehicleId), Vec<usize>> {
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by(|&a, &b| events[a].canonical_order(events[b]));
    let mut pairs: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for index in order {
        pairs.entry((&events[index].transmitter_id, &events[index].receiver_id)).or_default().push(index);
    }
    pairs
}

/// Returns the sum of the displacements of both ends between two events, in metres.
fn displacement_m(earlier: &Event, later: &Event) -> f64 {
    let ends = earlier.link.ends().into_iter().zip(later.link.ends());
    ends.map(|(from, to)| {
        let down_m = from.depth_m.zip(to.depth_m).map_or(0.0, |(from_m, to_m)| to_m - from_m);
        (to.east_m - from.east_m).hypot(to.north_m - from.north_m).hypot(down_m)
    })
    .sum()
}
