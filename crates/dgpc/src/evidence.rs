//! The evidence bound E and its exact gradient by everything that can be learned of a prior (section 7 of
//! [`crate::method`]).

use crate::error::Result;
use crate::fit::{Fit, FitOptions, solve_with_gradient};
use crate::likelihood::Likelihood;
use crate::observations::Observations;
use crate::prior::Prior;

/// The evidence bound E at one prior, and how it changes with it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Evidence {
    /// The fit; [`Fit::evidence`] is E.
    pub fit: Fit,
    /// ∂E/∂θ for every θ of [`Prior::parameter_values`], exact where the fit has reached its fixed point.
    pub gradient: Vec<f64>,
}

/// The evidence bound of events and of what others said, and its gradient. A message counts with its kernel-free
/// factor, whatever prior it was formed under, so that E then bounds the log of a marginal likelihood in which the
/// factors stand for the likelihood of the events behind them. Inducing points stay where they are. As dear as
/// [`crate::fit`].
///
/// # Errors
/// As [`crate::fit`].
pub fn evidence(prior: &Prior, observations: &Observations, options: &FitOptions<'_>) -> Result<Evidence> {
    let likelihood = Likelihood::new(observations, options.messages)?;
    let support = options.support()?;
    let (found, gradient) = solve_with_gradient(prior, &likelihood, support.as_ref(), options)?;
    Ok(Evidence { fit: Fit::new(prior, found, support.as_ref(), options.messages)?, gradient })
}
