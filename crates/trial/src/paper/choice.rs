//! Dimensions of the comparison: policies, numbers of points, estimators of ω, and fusion of packets.

use dgpc::{Candidates, Selection};
use rand::Rng;

/// The paper's radius of a locality region, in standardised units.
pub const RADIUS: f64 = 0.4;

/// The paper's radius divided by its length-scale, 0.4 / 0.289: √(−2 ln ε) for ε = 0.384.
pub const RADIUS_LENGTH_SCALES: f64 = 1.384;

/// Policy of choosing the inducing points among the events of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Policy {
    /// The points that minimise tr K̃: the paper's policy.
    Good,
    /// Points drawn uniformly.
    Random,
    /// The points that maximise tr K̃.
    Bad,
}

impl Policy {
    /// All policies, from the expected best to the expected worst.
    pub const ALL: [Policy; 3] = [Policy::Good, Policy::Random, Policy::Bad];

    /// Chooses `points` of the candidates. Only [`Policy::Random`] uses random numbers.
    pub fn choose<R: Rng + ?Sized>(self, candidates: &Candidates, points: usize, rng: &mut R) -> Selection {
        match self {
            Policy::Good => candidates.minimise_trace(points),
            Policy::Random => candidates.random(points, rng),
            Policy::Bad => candidates.maximise_trace(points),
        }
    }

    /// Returns the name of the policy.
    pub fn name(self) -> &'static str {
        match self {
            Policy::Good => "good",
            Policy::Random => "random",
            Policy::Bad => "bad",
        }
    }
}

/// A number of points, and the policy of choosing them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Choice {
    /// The policy.
    pub policy: Policy,
    /// The number of points.
    pub points: usize,
}

impl Choice {
    /// Returns the paper's six choices: one and two points by each policy.
    pub fn all() -> impl Iterator<Item = Choice> {
        Policy::ALL.into_iter().flat_map(|policy| [1, 2].map(|points| Choice { policy, points }))
    }
}

/// Estimator of ω ([`dgpc::method::inference`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Omega {
    /// The last draw of a Gibbs chain, as in the paper.
    LastDraw,
    /// All draws of the chain after its burn-in; probabilities are averaged over them.
    AveragedDraws,
    /// The mean field.
    MeanField,
}

impl Omega {
    /// All estimators, the paper's first.
    pub const ALL: [Omega; 3] = [Omega::LastDraw, Omega::AveragedDraws, Omega::MeanField];

    /// Returns the name of the estimator.
    pub fn name(self) -> &'static str {
        match self {
            Omega::LastDraw => "last draw",
            Omega::AveragedDraws => "averaged draws",
            Omega::MeanField => "mean field",
        }
    }
}

/// Data from which a team predicts ([`dgpc::method::fusion`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fusion {
    /// The packets of all agents, concatenated as in the paper.
    Concatenation,
    /// The packets of all agents, fused as sites.
    SiteFusion,
    /// Each agent's own raw events of its region, and the packets of the others. Scores are means over agents.
    OwnAndPackets,
}

impl Fusion {
    /// All methods, the paper's first.
    pub const ALL: [Fusion; 3] = [Fusion::Concatenation, Fusion::SiteFusion, Fusion::OwnAndPackets];

    /// Returns the name of the method.
    pub fn name(self) -> &'static str {
        match self {
            Fusion::Concatenation => "concatenation",
            Fusion::SiteFusion => "site fusion",
            Fusion::OwnAndPackets => "own events + packets",
        }
    }
}
