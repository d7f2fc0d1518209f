//! A mean field by whichever Gaussian posterior suits: over all events, or on inducing points.

use super::dense::Dense;
use super::mean_field::MeanField;
use super::options::FitOptions;
use super::sparse::Sparse;
use super::{fixed_point, natural, sparse_gradient};
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
    let Some(points) = points else {
        return fixed_point::iterate(&mut Dense::new(prior, likelihood)?, prior, likelihood, options);
    };
    let mut engine = Sparse::new(prior, likelihood, points)?;
    let found = natural::iterate(&mut engine, prior, likelihood, options)?;
    found.mean_field(engine, likelihood)
}

/// The fixed point, and the gradient of E there by everything that can be learned of the prior. E does not change with the tilts
/// there, so that it is the gradient at fixed ω.
pub(crate) fn solve_with_gradient(
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: Option<&Inputs>,
    options: &FitOptions<'_>,
) -> Result<(MeanField, Vec<f64>)> {
    let Some(points) = points else {
        let mut engine = Dense::new(prior, likelihood)?;
        let found = fixed_point::iterate(&mut engine, prior, likelihood, options)?;
        return Ok((found, engine.gradient(prior, likelihood)));
    };
    let mut engine = Sparse::new(prior, likelihood, points)?;
    let found = natural::iterate(&mut engine, prior, likelihood, options)?;
    let gradient = sparse_gradient::gradient(&engine, &found, prior, likelihood)?;
    Ok((found.mean_field(engine, likelihood)?, gradient))
}
