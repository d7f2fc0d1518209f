//! A vehicle's own events under some prior, with as many inducing points as its limits ask for.

use dgpc::{Candidates, Fit, FitOptions, Observations, Prior, Summary, spread_out};

use crate::limits::Limits;

/// How a fit went.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FitQuality {
    /// Whether the fixed point was reached.
    pub converged: bool,
    /// Largest change of a tilt in the last iteration.
    pub change: f64,
    /// What was added to a diagonal to factorise it (0 in the ordinary case).
    pub jitter: f64,
}

impl FitQuality {
    pub(crate) fn of(fit: &Fit) -> Self {
        Self { converged: fit.converged(), change: fit.change(), jitter: fit.jitter() }
    }
}

/// Predictions move by far less than their own uncertainty at this tolerance in the latent function.
const TOLERANCE: f64 = 1e-6;

/// Fits `observations` given what others said: densely up to [`Limits::dense_events_max`], sparsely beyond. From these
/// tilts, if some are given.
pub(crate) fn fit(
    prior: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    limits: &Limits,
    start: Option<&[f64]>,
) -> dgpc::Result<Fit> {
    let mut options = FitOptions::default().tolerance(TOLERANCE).messages(messages);
    options.start = start;
    if observations.len() <= limits.dense_events_max {
        return dgpc::fit(prior, observations, &options);
    }
    let inputs = observations.inputs();
    let candidates = inputs.select(&spread_out(inputs.len(), limits.candidates_max));
    let chosen = Candidates::new(prior.kernel(), &candidates)?.greedy(limits.inducing_points_max);
    dgpc::fit(prior, observations, &options.inducing_points(&candidates.select(&chosen.indices)))
}
