//! Fixed point of the mean field, dense (over all events) or sparse (on inducing points).

use super::dense::DenseEngines;
use super::mean_field::MeanField;
use super::options::FitOptions;
use super::{fixed_point, sparse};
use crate::error::Result;
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::prior::Prior;

/// Returns the fixed point, supported on `points` if they are given.
pub(crate) fn solve(
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: Option<&Inputs>,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    solve_with(&DenseEngines::default(), prior, likelihood, points, options)
}

/// Returns the fixed point as [`solve`] does, with one of the given engines if the fit is dense.
pub(crate) fn solve_with(
    engines: &DenseEngines,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: Option<&Inputs>,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    let Some(points) = points else {
        return engines.run(prior, likelihood, |engine| fixed_point::iterate(engine, prior, likelihood, options));
    };
    sparse::solve(prior, likelihood, points, options)
}

/// Returns the fixed point, and the gradient of E there by all learned parameters of the prior. At the fixed point E
/// does not change with the tilts to first order. The gradient at fixed ω is therefore the total gradient.
pub(crate) fn solve_with_gradient(
    engines: &DenseEngines,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: Option<&Inputs>,
    options: &FitOptions<'_>,
) -> Result<(MeanField, Vec<f64>)> {
    let Some(points) = points else {
        return engines.run(prior, likelihood, |engine| {
            let fixed_point = fixed_point::iterate(engine, prior, likelihood, options)?;
            Ok((fixed_point, engine.gradient(prior, likelihood)))
        });
    };
    sparse::solve_with_gradient(prior, likelihood, points, options)
}
