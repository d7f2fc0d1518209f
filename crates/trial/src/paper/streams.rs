//! Random numbers of the experiment. Every use has its own stream, so that results do not depend on threads or on other
//! computations.

use rand_chacha::ChaCha8Rng;

use crate::streams::{self, stream};

/// The streams of one permutation of one data set.
#[derive(Debug, Clone, Copy)]
pub(super) struct Streams {
    pub(super) seed: u64,
    pub(super) for_use: Use,
    pub(super) set: usize,
    pub(super) permutation: usize,
}

/// Use of the random numbers.
#[derive(Debug, Clone, Copy)]
pub(super) enum Use {
    Tables,
    Sweep,
}

/// Number of the team's stream, among those of its agents.
const TEAM: usize = 0xFFFF;

impl Streams {
    pub(super) fn agent(self, agent: usize) -> ChaCha8Rng {
        let Self { seed, for_use, set, permutation } = self;
        let kind = streams::PAPER + ((for_use as u64) << 58);
        stream(seed, kind + ((set as u64 & 0x3FF) << 48) + ((agent as u64 & 0xFFFF) << 32) + permutation as u64)
    }

    pub(super) fn team(self) -> ChaCha8Rng {
        self.agent(TEAM)
    }
}
