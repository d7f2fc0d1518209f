//! Statistics over permutations: means, paired differences, and the rank correlation between bounds and NLL.

use super::choice::{Choice, Fusion, Omega};
use super::fit::EffectiveDraws;
use super::permutation::{Bounds, LocalOutcome, TeamOutcome};
use super::shape::{Claim, rank_correlation};
use crate::score::{Estimate, MeanScore, Score};

/// A score of predictions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    /// Negative log-likelihood.
    Nll,
    /// Share of events whose more probable outcome occurred.
    Accuracy,
}

impl Metric {
    /// Both metrics.
    pub const ALL: [Metric; 2] = [Metric::Nll, Metric::Accuracy];

    /// Returns the name of the metric.
    pub fn name(self) -> &'static str {
        match self {
            Metric::Nll => "NLL",
            Metric::Accuracy => "ACC",
        }
    }

    /// Returns the score such that lower is better.
    pub fn cost(self, score: &Score) -> f64 {
        match self {
            Metric::Nll => score.nll,
            Metric::Accuracy => -score.accuracy,
        }
    }
}

/// Accessor of one of [`Bounds`].
pub type BoundOf = fn(&Bounds) -> f64;

/// Returns the mean score over permutations; `None` without any.
pub fn mean<T>(outcomes: &[T], of: impl Fn(&T) -> Score) -> Option<MeanScore> {
    MeanScore::over(&outcomes.iter().map(of).collect::<Vec<_>>(), 0.0)
}

/// Returns the mean score of an agent alone.
pub fn local_score(outcomes: &[&LocalOutcome], choice: Choice, omega: Omega) -> Option<MeanScore> {
    mean(outcomes, |outcome| outcome.scores[&(choice, omega)])
}

/// Returns the mean score of a team.
pub fn team_score(outcomes: &[&TeamOutcome], choice: Choice, fusion: Fusion, omega: Omega) -> Option<MeanScore> {
    mean(outcomes, |outcome| outcome.scores[&(choice, fusion, omega)])
}

/// Returns the difference of a claim for an agent alone, at the last draw of ω.
pub fn local_difference(outcomes: &[&LocalOutcome], claim: &Claim, metric: Metric) -> Option<Estimate> {
    let cost = |local: &&LocalOutcome, choice| metric.cost(&local.scores[&(choice, Omega::LastDraw)]);
    claim.difference(|choice| outcomes.iter().map(|local| cost(local, choice)).collect())
}

/// Returns the difference of a claim for a team, with concatenated packets and the last draw of ω.
pub fn team_difference(outcomes: &[&TeamOutcome], claim: &Claim, metric: Metric) -> Option<Estimate> {
    let key = |choice| (choice, Fusion::Concatenation, Omega::LastDraw);
    claim.difference(|choice| outcomes.iter().map(|team| metric.cost(&team.scores[&key(choice)])).collect())
}

/// Returns the mean of a bound over permutations.
pub fn mean_bound(outcomes: &[&LocalOutcome], choice: Choice, of: BoundOf) -> Option<Estimate> {
    Estimate::over(&outcomes.iter().map(|outcome| of(&outcome.bounds[&choice])).collect::<Vec<_>>())
}

/// Returns the rank correlation between a bound and the NLL over the six choices of a permutation. The mean is over
/// permutations in which the correlation is defined.
pub fn bound_orders_nll(outcomes: &[&LocalOutcome], of: BoundOf) -> Option<Estimate> {
    let within = |outcome: &&LocalOutcome| {
        let bounds: Vec<f64> = Choice::all().map(|choice| of(&outcome.bounds[&choice])).collect();
        let nll: Vec<f64> = Choice::all().map(|choice| outcome.scores[&(choice, Omega::LastDraw)].nll).collect();
        rank_correlation(&bounds, &nll)
    };
    Estimate::over(&outcomes.iter().filter_map(within).collect::<Vec<_>>())
}

/// Returns the number of independent draws to which a chain is equivalent, over permutations.
pub fn effective_draws(outcomes: &[&LocalOutcome]) -> Option<EffectiveDraws> {
    let mean = Estimate::over(&outcomes.iter().map(|outcome| outcome.effective_draws.mean).collect::<Vec<_>>())?.mean;
    let least = outcomes.iter().map(|outcome| outcome.effective_draws.least).fold(f64::INFINITY, f64::min);
    Some(EffectiveDraws { mean, least })
}
