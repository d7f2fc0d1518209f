//! The hyperprior: a distribution of the parameters of a prior.

use crate::error::{Result, not_negative};
use crate::parameter::Parameter;
use crate::prior::Prior;

/// A distribution over priors: independent normal distributions of the parameters about the template's values.
///
/// All parameters but the intercept are distributed on the logarithmic scale, and a reciprocity on the scale of
/// log-odds. The standard deviations determine how far
/// the data may move each parameter. A parameter with standard deviation 0 is fixed.
///
/// The default is weak: a length-scale may change by a factor of 4.5 for half a nat. It is strong enough to keep
/// parameters at the template's value if the events contain no information about them.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct HyperPrior {
    /// Standard deviation of the logarithm of every length-scale.
    pub length_scale: f64,
    /// Standard deviation of the logarithm of every variance.
    pub variance: f64,
    /// Standard deviation of the log-odds of every reciprocity.
    pub reciprocity: f64,
    /// Standard deviation of the logarithm of every parameter of a kernel shape.
    pub shape: f64,
    /// Standard deviation of a constant prior mean, or of the intercept of a range prior mean.
    pub intercept: f64,
    /// Standard deviation of the logarithm of the slope of a range prior mean.
    pub slope: f64,
}

impl Default for HyperPrior {
    fn default() -> Self {
        Self { length_scale: 1.5, variance: 1.5, reciprocity: 2.0, shape: 1.0, intercept: 1.0, slope: 0.25 }
    }
}

impl HyperPrior {
    /// Sets [`HyperPrior::length_scale`].
    #[must_use]
    pub fn length_scale(self, length_scale: f64) -> Self {
        Self { length_scale, ..self }
    }

    /// Sets [`HyperPrior::variance`].
    #[must_use]
    pub fn variance(self, variance: f64) -> Self {
        Self { variance, ..self }
    }

    /// Sets [`HyperPrior::reciprocity`].
    #[must_use]
    pub fn reciprocity(self, reciprocity: f64) -> Self {
        Self { reciprocity, ..self }
    }

    /// Sets [`HyperPrior::shape`].
    #[must_use]
    pub fn shape(self, shape: f64) -> Self {
        Self { shape, ..self }
    }

    /// Sets [`HyperPrior::intercept`].
    #[must_use]
    pub fn intercept(self, intercept: f64) -> Self {
        Self { intercept, ..self }
    }

    /// Sets [`HyperPrior::slope`].
    #[must_use]
    pub fn slope(self, slope: f64) -> Self {
        Self { slope, ..self }
    }

    /// Checks that every number is finite and not negative.
    pub(super) fn check(&self) -> Result<()> {
        let all = [self.length_scale, self.variance, self.reciprocity, self.shape, self.intercept, self.slope];
        all.into_iter().try_for_each(|value| not_negative("standard deviation of a hyperprior", value).map(drop))
    }

    /// Returns the standard deviation of every parameter of a prior, in the order of [`Prior::parameter_values`].
    pub(super) fn of_parameters(&self, prior: &Prior) -> Vec<f64> {
        let of = |parameter: &Parameter| match parameter {
            Parameter::Variance => self.variance,
            Parameter::LengthScale => self.length_scale,
            Parameter::Reciprocity => self.reciprocity,
            Parameter::Shape => self.shape,
            Parameter::Intercept => self.intercept,
            Parameter::Slope => self.slope,
        };
        prior.parameters().iter().map(of).collect()
    }
}
