//! What a vehicle's own events say, under some prior.

use dgpc::{Candidates, MeanField, Observations, Posterior, Prior, Sites, Summary, mean_field};

use crate::limits::Limits;

/// How a fit went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitQuality {
    /// Whether the fixed point was reached.
    pub converged: bool,
    /// Largest change of a tilt in the last iteration.
    pub change: f64,
    /// What was added to a diagonal to factorise it (0 in the ordinary case).
    pub jitter: f64,
}

/// A fit of an agent's own events under some prior.
#[derive(Debug)]
pub(crate) struct Knowledge {
    pub(crate) quality: FitQuality,
    pub(crate) sites: Sites,
    /// Stands for the sites when they are too many to be used one by one.
    condensed: Option<Summary>,
}

impl Knowledge {
    /// Fits `observations` given what others said: densely up to [`Limits::dense_events_max`], sparsely beyond.
    pub(crate) fn fit(
        prior: &Prior,
        observations: &Observations,
        messages: &[&Summary],
        limits: &Limits,
    ) -> dgpc::Result<Self> {
        // Predictions move by far less than their own uncertainty at a tolerance of 1e-6 in the latent function.
        let options = mean_field::Options { tolerance: 1e-6, ..Default::default() };
        let quality = |fit: &MeanField| FitQuality { converged: fit.converged, change: fit.change, jitter: fit.jitter };
        if observations.len() <= limits.dense_events_max {
            let fit = mean_field::dense_with_messages(prior, observations, messages, &options)?;
            return Ok(Self { quality: quality(&fit), sites: fit.sites, condensed: None });
        }
        let candidates = limits.candidates(observations.inputs());
        let chosen = Candidates::new(prior.kernel(), &candidates)?.greedy(limits.inducing_points_max);
        let mut inducing_points = candidates.select(&chosen.indices);
        messages.iter().try_for_each(|message| inducing_points.append(message.inducing_points()))?;
        let fit = mean_field::sparse_with_messages(prior, observations, messages, &inducing_points, &options)?;
        let condensed = Some(Summary::variational(prior, &fit.sites, &inducing_points)?);
        Ok(Self { quality: quality(&fit), sites: fit.sites, condensed })
    }

    /// Own events and summaries, all under `prior`, put together.
    pub(crate) fn fuse(&self, prior: &Prior, summaries: &[&Summary]) -> dgpc::Result<Posterior> {
        match &self.condensed {
            None => Posterior::fuse(prior, &self.sites, summaries),
            Some(condensed) => {
                let none = Sites::empty(condensed.inducing_points().dimension());
                Posterior::fuse(prior, &none, &[summaries, &[condensed]].concat())
            }
        }
    }
}
