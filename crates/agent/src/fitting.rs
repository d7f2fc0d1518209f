//! A vehicle's own events under some prior: all of them with as many inducing points as its limits ask for, or one beside
//! what is known.

use dgpc::{Candidates, Fit, FitOptions, Inputs, Observations, Posterior, Prior, Summary, spread_out};

use crate::agent_error::AgentError;
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

/// Iterations of a sparse fit that begins at the last one: so many take less than a second with 20 000 events, and what
/// is left to do the next one does.
const WARM_ITERATIONS_MAX: usize = 4;

/// Where a fit begins: at an earlier one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Begin<'a> {
    /// The inducing points of that, if it was sparse and had no messages.
    pub(crate) inducing_points: Option<&'a Inputs>,
    /// Tilts to begin with, one per event.
    pub(crate) tilts: &'a [f64],
    /// Events that were not in it.
    pub(crate) new: &'a [usize],
}

/// Fits `observations` given what others said: densely up to [`Limits::dense_events_max`], sparsely beyond. What begins
/// at an earlier fit is, if it is sparse, not always at its fixed point when it ends ([`FitQuality::converged`]).
pub(crate) fn fit(
    prior: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    limits: &Limits,
    begin: Option<Begin<'_>>,
) -> dgpc::Result<Fit> {
    let mut options = FitOptions::default().tolerance(TOLERANCE).messages(messages);
    options.start = begin.map(|begin| begin.tilts);
    if observations.len() <= limits.dense_events_max {
        return dgpc::fit(prior, observations, &options);
    }
    if begin.is_some() {
        options = options.iterations_max(WARM_ITERATIONS_MAX);
    }
    let inputs = observations.inputs();
    let spread = |places: &[usize]| -> Vec<usize> {
        spread_out(places.len(), limits.candidates_max).into_iter().map(|place| places[place]).collect()
    };
    let candidates = match begin.and_then(|begin| Some((begin.inducing_points?, begin.new))) {
        // Those of the earlier fit stand for all events before.
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

/// Takes an event into both posteriors. Under its own model it has another site.
pub(crate) fn absorb_event(
    observation: &Observations,
    own: &mut Posterior,
    fused: &mut Posterior,
    has_own_model: bool,
) -> Result<(), AgentError> {
    let site = dgpc::absorb_observations(own, observation)?;
    match has_own_model {
        true => drop(dgpc::absorb_observations(fused, observation)?),
        false => fused.absorb_events(&site)?,
    }
    Ok(())
}
