//! One agent in one permutation: what its training events in its region say, and the points that stand for them.

use std::collections::BTreeMap;

use dgpc::{
    Candidates, Error, Gibbs, Inputs, Observations, Posterior, Prior, Selection, Sites, Summary, effective_sample_size,
    mean_field,
};
use rand_chacha::ChaCha8Rng;

use super::choice::{Choice, Omega};

/// Sweeps of a chain before its draws count.
pub const BURN_IN: usize = 100;

/// Draws of a chain that count.
pub const DRAWS: usize = 100;

/// ω of some events, in all three ways.
pub(super) struct Fit {
    /// The draws of the Gibbs chain after its burn-in.
    draws: Vec<Sites>,
    mean_field: Sites,
    pub(super) effective_draws: EffectiveDraws,
}

/// How many independent draws the draws of f are worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectiveDraws {
    /// The mean over events.
    pub mean: f64,
    /// The least.
    pub least: f64,
}

impl Fit {
    pub(super) fn new(prior: &Prior, events: &Observations, rng: &mut ChaCha8Rng) -> Result<Self, Error> {
        let mut chain = Gibbs::new(prior, events.clone())?;
        for _ in 0..BURN_IN {
            chain.sweep(rng)?;
        }
        let mut latent = vec![Vec::with_capacity(DRAWS); events.len()];
        let mut draws = Vec::with_capacity(DRAWS);
        for _ in 0..DRAWS {
            chain.sweep(rng)?;
            draws.push(chain.sites()?);
            latent.iter_mut().zip(chain.latent()).for_each(|(latent, &draw)| latent.push(draw));
        }
        let sizes: Vec<f64> = latent.iter().map(|draws| effective_sample_size(draws)).collect();
        let least = sizes.iter().copied().fold(f64::INFINITY, f64::min);
        let mean_field = mean_field::dense(prior, events, &mean_field::Options::default())?.sites;
        let effective_draws = EffectiveDraws { mean: sizes.iter().sum::<f64>() / sizes.len() as f64, least };
        Ok(Self { draws, mean_field, effective_draws })
    }

    /// The sites over which predictions are averaged.
    pub(super) fn sites(&self, omega: Omega) -> &[Sites] {
        match omega {
            Omega::LastDraw => &self.draws[DRAWS - 1..],
            Omega::AveragedDraws => &self.draws,
            Omega::MeanField => std::slice::from_ref(&self.mean_field),
        }
    }
}

/// An agent's region: its fit, and the points of every choice.
pub(super) struct RegionFit {
    pub(super) fit: Fit,
    pub(super) choices: BTreeMap<Choice, Selection>,
    inputs: Inputs,
}

impl RegionFit {
    /// # Errors
    /// As the samplers and fits of `dgpc`, on numbers near the end of the range.
    pub(super) fn new(prior: &Prior, events: &Observations, rng: &mut ChaCha8Rng) -> Result<Self, Error> {
        let candidates = Candidates::new(prior.kernel(), events.inputs())?;
        let choose = |choice: Choice| (choice, choice.policy.choose(&candidates, choice.points, rng));
        let choices = Choice::all().map(choose).collect();
        Ok(Self { fit: Fit::new(prior, events, rng)?, choices, inputs: events.inputs().clone() })
    }

    pub(super) fn points(&self, choice: Choice) -> Inputs {
        self.inputs.select(&self.choices[&choice].indices)
    }

    /// The packets of a choice, one for each of the sites over which predictions are averaged: variational, as in the paper.
    pub(super) fn packets(&self, prior: &Prior, choice: Choice, omega: Omega) -> Result<Vec<Summary>, Error> {
        let points = self.points(choice);
        self.fit.sites(omega).iter().map(|sites| Summary::variational(prior, sites, &points)).collect()
    }
}

/// The mean of the probabilities that several posteriors predict.
pub(super) fn average(
    posteriors: impl ExactSizeIterator<Item = Result<Posterior, Error>>,
    inputs: &Inputs,
) -> Result<Vec<f64>, Error> {
    let count = posteriors.len() as f64;
    let mut mean = vec![0.0; inputs.len()];
    for posterior in posteriors {
        let probability = posterior?.probability(inputs)?;
        mean.iter_mut().zip(&probability).for_each(|(mean, p)| *mean += p / count);
    }
    Ok(mean)
}
