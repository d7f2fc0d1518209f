//! The evidence bound E and its exact gradient by all learned parameters of a prior ([`crate::method::learning`]).

use crate::error::Result;
use crate::fit::{DenseEngines, Fit, FitOptions, solve_with_gradient};
use crate::likelihood::Likelihood;
use crate::observations::Observations;
use crate::prior::Prior;

/// The evidence bound E at one prior, and its gradient by the prior's parameters.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Evidence {
    /// The fit; [`Fit::evidence`] is E.
    pub fit: Fit,
    /// ∂E/∂θ for every θ of [`Prior::parameter_values`]. It is exact if the fit has converged to its fixed point.
    pub gradient: Vec<f64>,
}

/// Returns the evidence bound of events and of messages from peers, and its gradient. The cost is that of
/// [`crate::fit`].
///
/// A message counts with its kernel-free factor, whatever prior it was formed under. E then bounds the log of a
/// marginal likelihood in which the factors replace the likelihood of the events behind them. Inducing points stay in
/// place.
///
/// # Errors
/// As [`crate::fit`].
pub fn evidence(prior: &Prior, observations: &Observations, options: &FitOptions<'_>) -> Result<Evidence> {
    let likelihood = Likelihood::new(observations, options.messages)?;
    let support = options.support()?;
    let (found, gradient) =
        solve_with_gradient(&DenseEngines::default(), prior, &likelihood, support.as_ref(), options)?;
    Ok(Evidence { fit: Fit::new(prior, found, support.as_ref(), options.messages)?, gradient })
}
