//! What is compared: policies, numbers of points, ways to ω, ways to use packets.

use dgpc::{Candidates, Selection};
use rand::Rng;

/// The paper's radius of a locality region, in standardised units.
pub const RADIUS: f64 = 0.4;

/// The paper's radius in its length-scales, 0.4 / 0.289: √(−2 ln ε) for ε = 0.384.
pub const RADIUS_LENGTH_SCALES: f64 = 1.384;

/// Which events of a region become its inducing points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Policy {
    /// Those that minimise tr K̃: the paper's policy.
    Good,
    /// Drawn uniformly.
    Random,
    /// Those that maximise tr K̃.
    Bad,
}

impl Policy {
    /// All of them, from what should be best to what should be worst.
    pub const ALL: [Policy; 3] = [Policy::Good, Policy::Random, Policy::Bad];

    /// So many of the candidates; only [`Policy::Random`] draws random numbers.
    pub fn choose<R: Rng + ?Sized>(self, candidates: &Candidates, points: usize, rng: &mut R) -> Selection {
        match self {
            Policy::Good => candidates.minimise_trace(points),
            Policy::Random => candidates.random(points, rng),
            Policy::Bad => candidates.maximise_trace(points),
        }
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Policy::Good => "good",
            Policy::Random => "random",
            Policy::Bad => "bad",
        }
    }
}

/// So many points by a policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Choice {
    /// The policy.
    pub policy: Policy,
    /// The number of points.
    pub points: usize,
}

impl Choice {
    /// The paper's six: one and two points by each policy.
    pub fn all() -> impl Iterator<Item = Choice> {
        Policy::ALL.into_iter().flat_map(|policy| [1, 2].map(|points| Choice { policy, points }))
    }
}

/// Where ω comes from (section 2 of [`dgpc::method`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Omega {
    /// The last draw of a Gibbs chain: the paper's.
    LastDraw,
    /// All draws of the chain after its burn-in: probabilities are averaged over them.
    AveragedDraws,
    /// The mean field.
    MeanField,
}

impl Omega {
    /// All of them, the paper's first.
    pub const ALL: [Omega; 3] = [Omega::LastDraw, Omega::AveragedDraws, Omega::MeanField];

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Omega::LastDraw => "last draw",
            Omega::AveragedDraws => "averaged draws",
            Omega::MeanField => "mean field",
        }
    }
}

/// What a team predicts from (section 6 of [`dgpc::method`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fusion {
    /// Everybody's packets, concatenated: the paper's.
    Concatenation,
    /// Everybody's packets, fused as sites.
    SiteFusion,
    /// Each agent's own raw events of its region, and the packets of the others; the mean over agents.
    OwnAndPackets,
}

impl Fusion {
    /// All of them, the paper's first.
    pub const ALL: [Fusion; 3] = [Fusion::Concatenation, Fusion::SiteFusion, Fusion::OwnAndPackets];

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Fusion::Concatenation => "concatenation",
            Fusion::SiteFusion => "site fusion",
            Fusion::OwnAndPackets => "own events + packets",
        }
    }
}
