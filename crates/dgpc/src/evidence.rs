//! The evidence bound E and its exact gradient by everything that can be learned of a prior (docs/method.md, section 7).

use crate::data::Data;
use crate::dense::Dense;
use crate::error::Result;
use crate::inputs::Inputs;
use crate::mean_field::{Engine, MeanField, Options, iterate};
use crate::prior_mean::Prior;
use crate::sites::Observations;
use crate::sparse::Sparse;
use crate::summary::Summary;

/// E at one prior, and how it changes with it.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The fit; [`MeanField::evidence`] is E.
    pub fit: MeanField,
    /// ∂E/∂θ for every θ of [`Prior::parameters`], exact where the fit has reached its fixed point.
    pub gradient: Vec<f64>,
}

/// E with the full Gaussian posterior of events and of messages from others. A message counts with its kernel-free factor, whatever
/// prior it was formed under, so that E then bounds the log of a marginal likelihood in which the factors stand for the
/// likelihood of the events behind them. O(n³) for n = events + all inducing points of the messages.
///
/// # Errors
/// As [`crate::mean_field::dense`]; [`crate::Error::NotPositiveDefinite`] for a message with a clearly negative eigenvalue.
pub fn dense(prior: &Prior, observations: &Observations, messages: &[&Summary], options: &Options) -> Result<Evidence> {
    dense_of(prior, &Data::new(observations, messages)?, options)
}

/// E with a Gaussian posterior supported on M inducing points; those of the messages should be among them. The inducing points
/// stay where they are. O(nM²).
///
/// # Errors
/// As [`dense`] and [`crate::mean_field::sparse`].
pub fn sparse(
    prior: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    inducing_points: &Inputs,
    options: &Options,
) -> Result<Evidence> {
    sparse_of(prior, &Data::new(observations, messages)?, inducing_points, options)
}

pub(crate) fn dense_of(prior: &Prior, data: &Data<'_>, options: &Options) -> Result<Evidence> {
    evaluate(Dense::new(prior, data)?, prior, data, options)
}

pub(crate) fn sparse_of(prior: &Prior, data: &Data<'_>, points: &Inputs, options: &Options) -> Result<Evidence> {
    evaluate(Sparse::new(prior, data, points)?, prior, data, options)
}

pub(crate) fn dense_fit(prior: &Prior, data: &Data<'_>, options: &Options) -> Result<MeanField> {
    Ok(iterate(&mut Dense::new(prior, data)?, prior, data, options)?.0)
}

pub(crate) fn sparse_fit(prior: &Prior, data: &Data<'_>, points: &Inputs, options: &Options) -> Result<MeanField> {
    Ok(iterate(&mut Sparse::new(prior, data, points)?, prior, data, options)?.0)
}

/// At the fixed point E does not change with the tilts, so that its gradient is that at fixed ω.
fn evaluate(mut engine: impl Engine, prior: &Prior, data: &Data<'_>, options: &Options) -> Result<Evidence> {
    let (fit, omega) = iterate(&mut engine, prior, data, options)?;
    let mut gradient = engine.kernel_gradient(prior, data, &omega);
    gradient.extend(data.mean_gradient(prior.mean(), engine.alpha()));
    Ok(Evidence { fit, gradient })
}
