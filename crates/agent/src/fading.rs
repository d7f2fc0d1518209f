//! Outcomes of one link seconds apart, which are not independent, and how much each of them counts (docs/method.md,
//! section 8).

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};
use crate::event::{Event, VehicleId};

/// Fading: how alike the outcomes of one transmitter at one receiver are while both lie still, beyond what the place
/// explains. Of two outcomes t seconds apart, between which the ends moved at v metres a second in all, the correlation is
/// correlation · exp(−t/memory_s − (v/drift_m_per_s)²). Moorings and vehicles adrift ask every few seconds what a
/// survey asks once; each answer says less than one that comes by itself. Where vehicles are under way, time and place go
/// together, and what is alike from one second to the next is the place's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fading {
    /// Correlation of two outcomes at one moment and place, from 0 to 1.
    pub correlation: f64,
    /// How long it remembers, in seconds.
    pub memory_s: f64,
    /// How fast both ends together may move and still lie still, in metres a second.
    pub drift_m_per_s: f64,
}

impl Default for Fading {
    /// What is assumed where nobody has lain still yet: 300 outcomes in 300 seconds at one place count as 44.
    fn default() -> Self {
        Self { correlation: 0.35, memory_s: 10.0, drift_m_per_s: 0.15 }
    }
}

/// Beyond so many times its memory, fading counts as gone.
const REACH: f64 = 3.0;

/// Below this share vehicles that moved say nothing of it.
#[cfg(feature = "learn")]
const STILL: f64 = 0.05;

/// Outcomes farther apart say nothing of it, in seconds.
#[cfg(feature = "learn")]
const LEARNED_OVER_S: f64 = 120.0;

/// So many outcomes weigh as much as what is assumed.
#[cfg(feature = "learn")]
const ASSUMED: f64 = 30.0;

/// No outcome makes the next one certain.
#[cfg(feature = "learn")]
const CORRELATION_MAX: f64 = 0.95;

/// And among so many earlier outcomes of one pair: with more a new one says next to nothing anyway.
const EARLIER_MAX: usize = 1000;

impl Fading {
    /// No fading: every outcome counts in full.
    pub const NONE: Self = Self { correlation: 0.0, memory_s: 1.0, drift_m_per_s: 1.0 };

    /// Every number of it: its key in a model file, what it is, and its bounds.
    pub fn entries(&self) -> [(&'static str, f64, Bounds); 3] {
        [
            ("fading.correlation", self.correlation, bounds::SHARE),
            ("fading.memory_s", self.memory_s, bounds::POSITIVE),
            ("fading.drift_m_per_s", self.drift_m_per_s, bounds::POSITIVE),
        ]
    }

    /// How much each of these events counts: 1/(1 + 2Σc), c its correlations with earlier ones of the same pair of
    /// vehicles. Of steady repeats so much is left that they count as many independent ones as their mean is worth. O(N log N),
    /// plus one for every two outcomes within reach, of which one has a thousand at most.
    pub fn weights(&self, events: &[&Event]) -> Vec<f64> {
        let mut weights = vec![1.0; events.len()];
        for places in in_pairs(events).into_values() {
            for (done, &place) in places.iter().enumerate() {
                let earlier = places[..done].iter().rev().map(|&place| events[place]);
                weights[place] = self.weight(events[place], earlier);
            }
        }
        weights
    }

    /// How much an event counts beside earlier ones, the latest first.
    pub(crate) fn weight<'a>(&self, event: &Event, earlier: impl Iterator<Item = &'a Event>) -> f64 {
        let within = earlier.take_while(|earlier| event.time_s - earlier.time_s <= REACH * self.memory_s);
        let repeated = within.filter(|earlier| is_of_one_pair(earlier, event)).take(EARLIER_MAX);
        let alike = |earlier| self.correlation * self.stillness(earlier, event) * self.left_after(earlier, event);
        let alike: f64 = repeated.map(alike).sum();
        1.0 / (1.0 + 2.0 * alike)
    }

    /// This, corrected by what was predicted of `events` and is left unexplained: least squares over the products of
    /// standardised residuals of two outcomes of one pair of vehicles, every outcome counting once, and beside them as much of
    /// what this says as thirty outcomes weigh. The drift stays. Costs as [`Fading::weights`], over two minutes.
    #[cfg(feature = "learn")]
    pub(crate) fn learned(&self, events: &[&Event], probabilities: &[f64]) -> Self {
        let residual = |n: usize| {
            let p = probabilities[n].clamp(1e-3, 1.0 - 1e-3);
            (f64::from(u8::from(events[n].success)) - p) / (p * (1.0 - p)).sqrt()
        };
        let mut fits = Remembering::ALL_MEMORIES_S.map(Remembering::of);
        let mut add = |products: &[Product], weight| fits.iter_mut().for_each(|fit| fit.add(products, weight));
        add(&self.assumed(), ASSUMED);
        for places in in_pairs(events).into_values() {
            for (done, &later) in places.iter().enumerate() {
                let apart_s = |earlier: usize| events[later].time_s - events[earlier].time_s;
                let near = |&earlier: &usize| {
                    let share = self.stillness(events[earlier], events[later]);
                    let product = residual(earlier) * residual(later);
                    (share >= STILL).then_some(Product { apart_s: apart_s(earlier), share, product })
                };
                let within = places[..done].iter().rev().take_while(|&&earlier| apart_s(earlier) <= LEARNED_OVER_S);
                add(&within.take(EARLIER_MAX).filter_map(near).collect::<Vec<_>>(), 1.0);
            }
        }
        let best = fits.into_iter().reduce(|best, next| if next.explained() > best.explained() { next } else { best });
        best.map_or(*self, |best| Self { correlation: best.correlation(), memory_s: best.memory_s, ..*self })
    }

    /// What this says of the seconds up to three times its memory.
    #[cfg(feature = "learn")]
    fn assumed(&self) -> Vec<Product> {
        const POINTS: u32 = 30;
        let at = |step: u32| {
            let memories = REACH * f64::from(step) / f64::from(POINTS);
            let product = self.correlation * (-memories).exp();
            Product { apart_s: memories * self.memory_s, share: 1.0, product }
        };
        (1..=POINTS).map(at).collect()
    }

    /// Share of the correlation that is left after the time between.
    fn left_after(&self, earlier: &Event, later: &Event) -> f64 {
        (-(later.time_s - earlier.time_s) / self.memory_s).exp()
    }

    /// Share of the correlation that is left by vehicles that moved: 1 where they did not.
    fn stillness(&self, earlier: &Event, later: &Event) -> f64 {
        let (moved_m, drift_m) = (moved_m(earlier, later), self.drift_m_per_s * (later.time_s - earlier.time_s));
        if moved_m == 0.0 { 1.0 } else { (-(moved_m / drift_m).powi(2)).exp() }
    }
}

/// The product of the residuals of two outcomes, and how much of the correlation at one place it should show.
#[cfg(feature = "learn")]
struct Product {
    apart_s: f64,
    share: f64,
    product: f64,
}

/// The correlation by least squares if fading remembers so long.
#[cfg(feature = "learn")]
struct Remembering {
    memory_s: f64,
    along: f64,
    square: f64,
}

#[cfg(feature = "learn")]
impl Remembering {
    /// What is tried.
    const ALL_MEMORIES_S: [f64; 13] = [2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 15.0, 22.0, 30.0, 42.0, 60.0, 85.0, 120.0];

    fn of(memory_s: f64) -> Self {
        Self { memory_s, along: 0.0, square: 0.0 }
    }

    /// Takes in products that have this weight together.
    fn add(&mut self, products: &[Product], weight: f64) {
        let each = weight / products.len().max(1) as f64;
        for Product { apart_s, share, product } in products {
            let expected = share * (-apart_s / self.memory_s).exp();
            self.along += each * expected * product;
            self.square += each * expected * expected;
        }
    }

    fn correlation(&self) -> f64 {
        (self.along / self.square.max(f64::MIN_POSITIVE)).clamp(0.0, CORRELATION_MAX)
    }

    /// By how much it lowers the sum of squares.
    fn explained(&self) -> f64 {
        let correlation = self.correlation();
        correlation * (2.0 * self.along - correlation * self.square)
    }
}

fn is_of_one_pair(a: &Event, b: &Event) -> bool {
    a.transmitter_id == b.transmitter_id && a.receiver_id == b.receiver_id
}

/// The events of every pair of vehicles, in canonical order.
fn in_pairs<'a>(events: &[&'a Event]) -> BTreeMap<(&'a VehicleId, &'a VehicleId), Vec<usize>> {
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by(|&a, &b| events[a].canonical_order(events[b]));
    let mut pairs: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for place in order {
        pairs.entry((&events[place].transmitter_id, &events[place].receiver_id)).or_default().push(place);
    }
    pairs
}

/// By how much both ends moved, together.
fn moved_m(earlier: &Event, later: &Event) -> f64 {
    let ends = earlier.link.ends().into_iter().zip(later.link.ends());
    ends.map(|(from, to)| {
        let down_m = from.depth_m.zip(to.depth_m).map_or(0.0, |(from_m, to_m)| to_m - from_m);
        (to.east_m - from.east_m).hypot(to.north_m - from.north_m).hypot(down_m)
    })
    .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Link, Position};

    fn event(time_s: f64, receiver: &str, east_m: f64) -> Event {
        let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, 0.0) };
        let (transmitter_id, receiver_id) = (VehicleId::new("auv1"), VehicleId::new(receiver));
        Event { time_s, transmitter_id, receiver_id, link, kind: None, success: true }
    }

    #[test]
    fn only_earlier_outcomes_of_the_same_pair_near_by_count_against_one() {
        let fading = Fading { correlation: 0.5, memory_s: 10.0, drift_m_per_s: 0.4 };
        let events = [
            event(5.0, "auv2", 2.0),
            event(0.0, "auv2", 0.0),
            event(6.0, "auv3", 0.0),
            event(7.0, "auv2", 1000.0),
            event(900.0, "auv2", 0.0),
        ];
        let weights = fading.weights(&events.iter().collect::<Vec<_>>());
        let alike = 0.5 * f64::exp(-0.5 - 1.0);
        for (found, expected) in weights.iter().zip([1.0 / (1.0 + 2.0 * alike), 1.0, 1.0, 1.0, 1.0]) {
            assert!((found - expected).abs() < 1e-12, "{weights:?}");
        }
        assert_eq!(fading.weight(&events[0], [&events[1]].into_iter()), weights[0]);
        assert_eq!(Fading::NONE.weights(&events.iter().collect::<Vec<_>>()), [1.0; 5]);
    }

    #[test]
    fn steady_repeats_count_as_many_as_their_mean_is_worth() {
        let fading = Fading::default();
        let events: Vec<Event> = (0..3000).map(|n| event(f64::from(n), "auv2", 0.0)).collect();
        let counted: f64 = fading.weights(&events.iter().collect::<Vec<_>>()).iter().sum();
        // The variance of the mean of outcomes of unit variance.
        let correlation = |lag: i32| if lag <= 30 { fading.correlation * f64::from(-lag).exp().powf(0.1) } else { 0.0 };
        let variance: f64 =
            1.0 + 2.0 * (1..3000).map(|lag| (1.0 - f64::from(lag) / 3000.0) * correlation(lag)).sum::<f64>();
        assert!((counted * variance / 3000.0 - 1.0).abs() < 0.01, "{counted} {variance}");
    }
}
