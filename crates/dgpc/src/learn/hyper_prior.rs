//! How far data may move the parameters of a prior.

use crate::error::{Result, not_negative};
use crate::parameter::Parameter;
use crate::prior::Prior;

/// A distribution over priors: independent normal distributions of the parameters about the template's values, of their
/// logarithms for all but the intercept. Its standard deviations say how far the data may
/// move each; at 0 the parameter stays what it is.
///
/// They are weak: the default lets a length-scale move by a factor of 4.5 for half a nat. And they are strong enough
/// that a parameter of which the events say nothing stays where the template has it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct HyperPrior {
    /// Of the logarithm of every length-scale.
    pub length_scale: f64,
    /// Of the logarithm of every variance.
    pub variance: f64,
    /// Of the logarithm of every parameter of a kernel shape.
    pub shape: f64,
    /// Of a constant prior mean, or the intercept of a range prior mean.
    pub intercept: f64,
    /// Of the logarithm of the slope of a range prior mean.
    pub slope: f64,
}

impl Default for HyperPrior {
    fn default() -> Self {
        Self { length_scale: 1.5, variance: 1.5, shape: 1.0, intercept: 1.0, slope: 0.25 }
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
        let all = [self.length_scale, self.variance, self.shape, self.intercept, self.slope];
        all.into_iter().try_for_each(|value| not_negative("standard deviation of a hyperprior", value).map(drop))
    }

    /// The standard deviation of every parameter of a prior, in the order of [`Prior::parameter_values`].
    pub(super) fn of_parameters(&self, prior: &Prior) -> Vec<f64> {
        let of = |parameter: &Parameter| match parameter {
            Parameter::Variance => self.variance,
            Parameter::LengthScale => self.length_scale,
            Parameter::Shape => self.shape,
            Parameter::Intercept => self.intercept,
            Parameter::Slope => self.slope,
        };
        prior.parameters().iter().map(of).collect()
    }
}
