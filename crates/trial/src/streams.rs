//! Streams of random numbers. Each use of a seed has its own streams.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// Split i uses stream i, counted from 0.
pub(crate) const SPLITS: u64 = 0;

/// Decisions between links.
pub(crate) const DECISIONS: u64 = 1 << 58;

/// Alternative uses of the same bytes, one stream for every vehicle.
pub(crate) const ALTERNATIVES: u64 = 1 << 59;

/// The paper's experiment.
pub(crate) const PAPER: u64 = 1 << 60;

/// Simulated trials.
pub(crate) const SIMULATION: u64 = 1 << 61;

/// Impairments of the channel, one stream for every pair of vehicles.
pub(crate) const CHANNEL: u64 = 1 << 62;

/// Thinning of a log.
pub(crate) const THINNING: u64 = u64::MAX;

/// Returns stream `stream` of a seed. Streams are independent of each other and of the number of threads.
pub(crate) fn stream(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn no_two_uses_share_a_stream() {
        // First stream of each use, and the largest number of its streams.
        let uses = [
            (SPLITS, 1 << 32),
            (DECISIONS, 1),
            (ALTERNATIVES, 1 << 32),
            (PAPER, 1 << 59),
            (SIMULATION, 1 << 32),
            (CHANNEL, 1 << 61),
            (THINNING, 1),
        ];
        for pair in uses.windows(2) {
            assert!(pair[0].0.checked_add(pair[0].1).is_some_and(|end| end <= pair[1].0), "{pair:?}");
        }
        let first = |place: u64| stream(1, place).random::<u64>();
        assert_ne!(first(SPLITS), first(ALTERNATIVES));
        assert_eq!(first(PAPER), first(PAPER));
    }
}
