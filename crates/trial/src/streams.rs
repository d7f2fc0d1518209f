//! Streams of random numbers: who takes which, so that no two uses of one seed ever share any.

use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// Split i takes stream i: from 0 on.
pub(crate) const SPLITS: u64 = 0;

/// Decisions between places.
pub(crate) const DECISIONS: u64 = 1 << 58;

/// Other uses of the same bytes, one for every vehicle.
pub(crate) const ALTERNATIVES: u64 = 1 << 59;

/// The paper's experiment.
pub(crate) const PAPER: u64 = 1 << 60;

/// Simulated trials.
pub(crate) const SIMULATION: u64 = 1 << 61;

/// What happens to packets, one for every pair of vehicles.
pub(crate) const WATER: u64 = 1 << 62;

/// Thinning of a log.
pub(crate) const THINNING: u64 = u64::MAX;

/// Stream `stream` of a seed: independent of all others, whatever the thread count.
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
        // Where each begins, and how many there may be.
        let uses = [
            (SPLITS, 1 << 32),
            (DECISIONS, 1),
            (ALTERNATIVES, 1 << 32),
            (PAPER, 1 << 59),
            (SIMULATION, 1 << 32),
            (WATER, 1 << 61),
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
