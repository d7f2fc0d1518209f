//! Fits observations within the limits of a vehicle.

use dgpc::{Candidates, Fit, FitOptions, Inputs, Observations, Prior, Summary, spread_out};

use crate::types::interrupt::Interrupt;
use crate::types::limits::Limits;

/// Numerical quality of a fit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FitQuality {
    /// Whether the iteration reached its fixed point.
    pub converged: bool,
    /// Largest change of a tilt in the last iteration.
    pub change: f64,
    /// Jitter that a factorisation added to a diagonal. Usually 0.
    pub jitter: f64,
}

impl FitQuality {
    pub(crate) fn of(fit: &Fit) -> Self {
        Self { converged: fit.converged(), change: fit.change(), jitter: fit.jitter() }
    }
}

/// Tolerance of the tilts, on the scale of the latent function. It is far below the uncertainty of any prediction.
const TOLERANCE: f64 = 1e-6;

/// Maximum number of iterations of a sparse fit with a warm start. It bounds the time of a refit; the next refit
/// continues the iteration.
const WARM_ITERATIONS_MAX: usize = 4;

/// A warm start: the result of an earlier fit from which a new one starts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WarmStart<'a> {
    /// Inducing points of the earlier fit, if it was sparse and the new fit has no messages.
    pub(crate) inducing_points: Option<&'a Inputs>,
    /// Initial tilts, one for each event.
    pub(crate) tilts: &'a [f64],
    /// Indices of the events that the earlier fit does not have.
    pub(crate) new: &'a [usize],
}

/// Fits `observations`, given the summaries in `messages`. The fit is dense up to [`Limits::dense_events_max`] events,
/// and sparse above.
///
/// A request of the [`Interrupt`] of the thread stops the fit.
///
/// A sparse fit with a warm start has a limited number of iterations. It may end before its fixed point: see
/// [`FitQuality::converged`].
pub(crate) fn fit(
    prior: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    limits: &Limits,
    start: Option<WarmStart<'_>>,
) -> dgpc::Result<Fit> {
    let interrupt = Interrupt::attached();
    let monitor = |progress| interrupt.monitor(progress);
    let mut options = FitOptions::default().tolerance(TOLERANCE).messages(messages).monitor(&monitor);
    options.start = start.map(|start| start.tilts);
    if observations.len() <= limits.dense_events_max {
        return dgpc::fit(prior, observations, &options);
    }
    if start.is_some() {
        options = options.iterations_max(WARM_ITERATIONS_MAX);
    }
    let inputs = observations.inputs();
    let spread = |indices: &[usize]| -> Vec<usize> {
        spread_out(indices.len(), limits.candidates_max).into_iter().map(|nth| indices[nth]).collect()
    };
    let candidates = match start.and_then(|start| Some((start.inducing_points?, start.new))) {
        // The inducing points of the earlier fit represent its events.
        Some((points, new)) => {
            let mut candidates = points.clone();
            candidates.append(&inputs.select(&spread(new)))?;
            candidates
        }
        None => inputs.select(&spread(&(0..inputs.len()).collect::<Vec<_>>())),
    };
    let chosen = Candidates::new(prior.kernel(), &candidates)?.greedy(limits.inducing_points_max);
    dgpc::fit(prior, observations, &options.inducing_points(&candidates.select(&chosen.indices)))
}
