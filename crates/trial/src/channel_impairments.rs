//! Impairments of the channel between two vehicles.

use rand::RngExt;

use crate::streams::{self, stream};

/// Probabilities of impairments of a packet. They are independent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ChannelImpairments {
    /// Probability that a packet is lost.
    pub loss: f64,
    /// Probability that a packet that arrives is duplicated.
    pub duplicate: f64,
    /// Probability that a packet arrives after packets that were sent later.
    pub reorder: f64,
}

/// Largest delay in packets.
const OVERTAKEN_MAX: f64 = 8.0;

/// Words of the random stream per packet: five numbers of two words each.
const WORDS: u128 = 10;

impl ChannelImpairments {
    /// Returns the indices of the packets that a receiver gets from a sender, in the order of arrival. The impairments
    /// of a packet do not depend on the number of later packets.
    pub fn arrivals(&self, count: usize, seed: u64, sender: usize, receiver: usize) -> Vec<usize> {
        let arrived = |place| {
            self.delays(place, seed, sender, receiver).into_iter().map(move |late| (place as f64 + late, place))
        };
        let mut arrivals: Vec<(f64, usize)> = (0..count).flat_map(arrived).collect();
        arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
        arrivals.into_iter().map(|(_, place)| place).collect()
    }

    /// Returns the delay, in packets, of each arrival of the packet at `place`: none, one or two arrivals.
    pub(crate) fn delays(&self, place: usize, seed: u64, sender: usize, receiver: usize) -> Vec<f64> {
        // Each pair has a stream, and each packet a part of the stream.
        let mut rng = stream(seed, streams::CHANNEL + ((sender as u64) << 32 | receiver as u64));
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
    fn impairments_of_a_packet_do_not_depend_on_later_packets() {
        let impairments = ChannelImpairments { loss: 0.3, duplicate: 0.2, reorder: 0.5 };
        let arrived = |count| {
            let mut arrived = impairments.arrivals(count, 7, 1, 2);
            arrived.sort_unstable();
            arrived
        };
        let (few, many) = (arrived(50), arrived(500));
        assert_eq!(few, many.iter().copied().filter(|&place| place < 50).collect::<Vec<_>>());
        assert_ne!(impairments.arrivals(50, 7, 1, 2), impairments.arrivals(50, 7, 2, 1));
    }

    #[test]
    fn shares_of_impairments_are_as_requested() {
        let count = 20_000;
        let arrivals = ChannelImpairments { loss: 0.3, duplicate: 0.1, reorder: 0.0 }.arrivals(count, 1, 0, 1);
        assert!(arrivals.is_sorted());
        let share = arrivals.len() as f64 / count as f64;
        // 0.7 · 1.1, and five standard errors.
        assert!((share - 0.77).abs() < 0.02, "{share}");
        assert_eq!(ChannelImpairments::default().arrivals(5, 1, 0, 1), [0, 1, 2, 3, 4]);
        let shuffled = ChannelImpairments { reorder: 0.5, ..ChannelImpairments::default() }.arrivals(100, 1, 0, 1);
        assert!(!shuffled.is_sorted() && shuffled.len() == 100);
    }
}
