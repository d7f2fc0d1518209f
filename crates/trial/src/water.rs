//! What happens to a packet between two vehicles.

use rand::RngExt;

use crate::streams::{self, stream};

/// Chances of what happens to a packet on its way to a receiver, each by itself.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Water {
    /// Probability that it is lost.
    pub loss: f64,
    /// Probability that one that arrives does so twice.
    pub duplicate: f64,
    /// Probability that it is overtaken by packets sent later.
    pub reorder: f64,
}

/// How far packets are overtaken at most.
const OVERTAKEN_MAX: f64 = 8.0;

/// Words of the stream that the fate of one packet takes: five numbers of two words.
const WORDS: u128 = 10;

impl Water {
    /// The places of those of `count` packets that one receiver hears of one sender, in the order of arrival. What
    /// happens to a packet does not depend on how many follow.
    pub fn arrivals(&self, count: usize, seed: u64, sender: usize, receiver: usize) -> Vec<usize> {
        let heard = |place| {
            self.delays(place, seed, sender, receiver).into_iter().map(move |late| (place as f64 + late, place))
        };
        let mut arrivals: Vec<(f64, usize)> = (0..count).flat_map(heard).collect();
        arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
        arrivals.into_iter().map(|(_, place)| place).collect()
    }

    /// By how many packets the one at `place` is late, for every time it arrives: never, once or twice.
    pub(crate) fn delays(&self, place: usize, seed: u64, sender: usize, receiver: usize) -> Vec<f64> {
        // A stream for each pair, and a part of it for each packet.
        let mut rng = stream(seed, streams::WATER + ((sender as u64) << 32 | receiver as u64));
        rng.set_word_pos(WORDS * place as u128);
        let [lost, twice, overtaken] = [self.loss, self.duplicate, self.reorder].map(|p| rng.random::<f64>() < p);
        let delays: [f64; 2] = [rng.random(), rng.random()];
        let times = if lost { 0 } else { 1 + usize::from(twice) };
        delays[..times].iter().map(|delay| if overtaken { OVERTAKEN_MAX * delay } else { 0.0 }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_happens_to_a_packet_does_not_depend_on_later_ones() {
        let water = Water { loss: 0.3, duplicate: 0.2, reorder: 0.5 };
        let heard = |count| {
            let mut heard = water.arrivals(count, 7, 1, 2);
            heard.sort_unstable();
            heard
        };
        let (few, many) = (heard(50), heard(500));
        assert_eq!(few, many.iter().copied().filter(|&place| place < 50).collect::<Vec<_>>());
        assert_ne!(water.arrivals(50, 7, 1, 2), water.arrivals(50, 7, 2, 1));
    }

    #[test]
    fn shares_are_as_asked_for() {
        let count = 20_000;
        let arrivals = Water { loss: 0.3, duplicate: 0.1, reorder: 0.0 }.arrivals(count, 1, 0, 1);
        assert!(arrivals.is_sorted());
        let share = arrivals.len() as f64 / count as f64;
        // 0.7 · 1.1, and five standard errors.
        assert!((share - 0.77).abs() < 0.02, "{share}");
        assert_eq!(Water::default().arrivals(5, 1, 0, 1), [0, 1, 2, 3, 4]);
        let shuffled = Water { reorder: 0.5, ..Water::default() }.arrivals(100, 1, 0, 1);
        assert!(!shuffled.is_sorted() && shuffled.len() == 100);
    }
}
