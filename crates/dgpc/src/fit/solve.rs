//! A mean field by whichever Gaussian posterior suits: over all events, or on inducing points.

use super::dense::Dense;
use super::fixed_point::{Engine, MeanField, iterate};
use super::options::FitOptions;
use super::sparse::Sparse;
use crate::error::Result;
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::prior::Prior;

/// The fixed point, supported on `points` if there are any.
pub(crate) fn solve(
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: Option<&Inputs>,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    let (found, _) = match points {
        Some(points) => iterate(&mut Sparse::new(prior, likelihood, points)?, prior, likelihood, options)?,
        None => iterate(&mut Dense::new(prior, likelihood)?, prior, likelihood, options)?,
    };
    Ok(found)
}

/// The fixed point, and the gradient of E there by everything that can be learned of the prior.
pub(crate) fn solve_with_gradient(
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: Option<&Inputs>,
    options: &FitOptions<'_>,
) -> Result<(MeanField, Vec<f64>)> {
    match points {
        Some(points) => with_gradient(Sparse::new(prior, likelihood, points)?, prior, likelihood, options),
        None => with_gradient(Dense::new(prior, likelihood)?, prior, likelihood, options),
    }
}

/// At the fixed point E does not change with the tilts, so that its gradient is that at fixed ω.
fn with_gradient(
    mut engine: impl Engine,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<(MeanField, Vec<f64>)> {
    let (found, omega) = iterate(&mut engine, prior, likelihood, options)?;
    let mut gradient = engine.kernel_gradient(prior, likelihood, &omega);
    gradient.extend(likelihood.mean_gradient(prior.mean(), engine.alpha()));
    Ok((found, gradient))
}
