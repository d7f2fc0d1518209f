//! What the outcomes of all permutations come to: means, paired differences, and whether a bound orders choices as NLL
//! does.

use super::choice::{Choice, Fusion, Omega};
use super::fit::EffectiveDraws;
use super::permutation::{Bounds, LocalOutcome, TeamOutcome};
use super::shape::{Claim, rank_correlation};
use crate::score::{Estimate, MeanScore, Score};

/// What is good: a low NLL, or a high accuracy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Negative log-likelihood.
    Nll,
    /// Share of events on the right side of ½.
    Accuracy,
}

impl Metric {
    /// Both.
    pub const ALL: [Metric; 2] = [Metric::Nll, Metric::Accuracy];

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Metric::Nll => "NLL",
            Metric::Accuracy => "ACC",
        }
    }

    /// What should be low.
    pub fn cost(self, score: &Score) -> f64 {
        match self {
            Metric::Nll => score.nll,
            Metric::Accuracy => -score.accuracy,
        }
    }
}

/// A number of [`Bounds`].
pub type BoundOf = fn(&Bounds) -> f64;

/// Mean score over permutations; `None` without any.
pub fn mean<T>(outcomes: &[T], of: impl Fn(&T) -> Score) -> Option<MeanScore> {
    MeanScore::over(&outcomes.iter().map(of).collect::<Vec<_>>(), 0.0)
}

/// Mean score of an agent by itself.
pub fn local_score(outcomes: &[&LocalOutcome], choice: Choice, omega: Omega) -> Option<MeanScore> {
    mean(outcomes, |outcome| outcome.scores[&(choice, omega)])
}

/// Mean score of a team.
pub fn team_score(outcomes: &[&TeamOutcome], choice: Choice, fusion: Fusion, omega: Omega) -> Option<MeanScore> {
    mean(outcomes, |outcome| outcome.scores[&(choice, fusion, omega)])
}

/// By how much a claim holds for an agent by itself, at the last draw of ω.
pub fn local_difference(outcomes: &[&LocalOutcome], claim: &Claim, metric: Metric) -> Option<Estimate> {
    let cost = |local: &&LocalOutcome, choice| metric.cost(&local.scores[&(choice, Omega::LastDraw)]);
    claim.difference(|choice| outcomes.iter().map(|local| cost(local, choice)).collect())
}

/// By how much a claim holds for a team, packets concatenated, at the last draw of ω.
pub fn team_difference(outcomes: &[&TeamOutcome], claim: &Claim, metric: Metric) -> Option<Estimate> {
    let key = |choice| (choice, Fusion::Concatenation, Omega::LastDraw);
    claim.difference(|choice| outcomes.iter().map(|team| metric.cost(&team.scores[&key(choice)])).collect())
}

/// The mean of a bound over permutations.
pub fn mean_bound(outcomes: &[&LocalOutcome], choice: Choice, of: BoundOf) -> Option<Estimate> {
    Estimate::over(&outcomes.iter().map(|outcome| of(&outcome.bounds[&choice])).collect::<Vec<_>>())
}

/// Does a smaller bound mean a smaller NLL? The rank correlation over the six choices within a permutation, its mean
/// over those in which it is defined.
pub fn bound_orders_nll(outcomes: &[&LocalOutcome], of: BoundOf) -> Option<Estimate> {
    let within = |outcome: &&LocalOutcome| {
        let bounds: Vec<f64> = Choice::all().map(|choice| of(&outcome.bounds[&choice])).collect();
        let nll: Vec<f64> = Choice::all().map(|choice| outcome.scores[&(choice, Omega::LastDraw)].nll).collect();
        rank_correlation(&bounds, &nll)
    };
    Estimate::over(&outcomes.iter().filter_map(within).collect::<Vec<_>>())
}

/// How many independent draws the draws of a chain are worth, over permutations.
pub fn effective_draws(outcomes: &[&LocalOutcome]) -> Option<EffectiveDraws> {
    let mean = Estimate::over(&outcomes.iter().map(|outcome| outcome.effective_draws.mean).collect::<Vec<_>>())?.mean;
    let least = outcomes.iter().map(|outcome| outcome.effective_draws.least).fold(f64::INFINITY, f64::min);
    Some(EffectiveDraws { mean, least })
}
