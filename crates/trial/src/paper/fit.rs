//! One agent in one permutation: the posterior of its region's training events, and the chosen points.

use std::collections::BTreeMap;

use dgpc::{
    Candidates, Error, FitOptions, Gibbs, Observations, Posterior, Prior, Selection, Sites, Summary,
    effective_sample_size,
};
use pingmap_agent::Interrupt;
use rand_chacha::ChaCha8Rng;

use super::choice::{Choice, Omega};

/// Sweeps of a chain before the first draw.
pub const BURN_IN: usize = 100;

/// Number of draws of a chain.
pub const DRAWS: usize = 100;

/// A quantity that depends on ω, for every draw of the Gibbs chain and for the mean field.
pub(super) struct Draws<T> {
    draws: Vec<T>,
    mean_field: T,
}

impl<T> Draws<T> {
    /// Returns the values over which predictions are averaged.
    pub(super) fn of(&self, omega: Omega) -> &[T] {
        match omega {
            Omega::LastDraw => &self.draws[DRAWS - 1..],
            Omega::AveragedDraws => &self.draws,
            Omega::MeanField => std::slice::from_ref(&self.mean_field),
        }
    }

    fn try_map<U>(&self, of: impl Fn(&T) -> Result<U, Error>) -> Result<Draws<U>, Error> {
        let draws = self.draws.iter().map(&of).collect::<Result<_, Error>>()?;
        Ok(Draws { draws, mean_field: of(&self.mean_field)? })
    }
}

/// ω of some events by all estimators.
pub(super) struct Fit {
    pub(super) sites: Draws<Sites>,
    pub(super) effective_draws: EffectiveDraws,
}

/// Number of independent draws to which the draws of f are equivalent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectiveDraws {
    /// Mean over events.
    pub mean: f64,
    /// Smallest number over events.
    pub least: f64,
}

impl Fit {
    pub(super) fn new(prior: &Prior, events: &Observations, rng: &mut ChaCha8Rng) -> Result<Self, Error> {
        let mut chain = Gibbs::new(prior, events.clone())?;
        for _ in 0..BURN_IN {
            Interrupt::check()?;
            chain.sweep(rng)?;
        }
        let mut latent = vec![Vec::with_capacity(DRAWS); events.len()];
        let mut draws = Vec::with_capacity(DRAWS);
        for _ in 0..DRAWS {
            Interrupt::check()?;
            chain.sweep(rng)?;
            draws.push(chain.sites()?);
            latent.iter_mut().zip(chain.latent()).for_each(|(latent, &draw)| latent.push(draw));
        }
        let sizes: Vec<f64> = latent.iter().map(|draws| effective_sample_size(draws)).collect();
        let least = sizes.iter().copied().fold(f64::INFINITY, f64::min);
        let mean_field = dgpc::fit(prior, events, &FitOptions::default())?.sites().clone();
        let effective_draws = EffectiveDraws { mean: sizes.iter().sum::<f64>() / sizes.len() as f64, least };
        Ok(Self { sites: Draws { draws, mean_field }, effective_draws })
    }
}

/// An agent's region: its fit, the posterior of its events, and the points of every choice.
pub(super) struct RegionFit {
    pub(super) fit: Fit,
    /// Posterior given all events of the region.
    pub(super) own: Draws<Posterior>,
    pub(super) choices: BTreeMap<Choice, Chosen>,
}

/// Chosen points, and their variational packets as in the paper.
pub(super) struct Chosen {
    pub(super) selection: Selection,
    pub(super) packets: Draws<Summary>,
}

impl RegionFit {
    /// # Errors
    /// As the samplers and fits of `dgpc`, on numbers near the end of the range.
    pub(super) fn new(prior: &Prior, events: &Observations, rng: &mut ChaCha8Rng) -> Result<Self, Error> {
        let candidates = Candidates::new(prior.kernel(), events.inputs())?;
        let selections: Vec<(Choice, Selection)> =
            Choice::all().map(|choice| (choice, choice.policy.choose(&candidates, choice.points, rng))).collect();
        let fit = Fit::new(prior, events, rng)?;
        let own = fit.sites.try_map(|sites| Posterior::of_sites(prior, sites))?;
        let chosen = |(choice, selection): (Choice, Selection)| {
            let points = events.inputs().select(&selection.indices);
            let packets = fit.sites.try_map(|sites| Summary::variational(prior, sites, &points))?;
            Ok((choice, Chosen { selection, packets }))
        };
        let choices = selections.into_iter().map(chosen).collect::<Result<_, Error>>()?;
        Ok(Self { fit, own, choices })
    }

    /// Returns the packets of a choice over which predictions are averaged.
    pub(super) fn packets(&self, choice: Choice, omega: Omega) -> &[Summary] {
        self.choices[&choice].packets.of(omega)
    }
}

/// Returns the mean probability over several posteriors, at `count` inputs.
pub(super) fn average(
    probabilities: impl ExactSizeIterator<Item = Result<Vec<f64>, Error>>,
    count: usize,
) -> Result<Vec<f64>, Error> {
    let posteriors = probabilities.len() as f64;
    let mut mean = vec![0.0; count];
    for probability in probabilities {
        mean.iter_mut().zip(&probability?).for_each(|(mean, p)| *mean += p / posteriors);
    }
    Ok(mean)
}
