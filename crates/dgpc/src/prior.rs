//! The prior: a kernel and a prior mean together.

use crate::error::Result;
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::parameter::Parameter;
use crate::prior_mean::PriorMean;

/// A Gaussian-process prior f ~ GP(μ₀, k).
///
/// Two priors are equal when they say the same of every set of points; how their parameters are tied for learning does
/// not count.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Prior {
    kernel: Kernel,
    mean: PriorMean,
}

impl Prior {
    /// Puts a kernel and a prior mean together.
    ///
    /// # Errors
    /// [`crate::Error::NotFinite`] for a constant prior mean that is not finite.
    pub fn new(kernel: Kernel, mean: PriorMean) -> Result<Self> {
        mean.check()?;
        Ok(Self { kernel, mean })
    }

    /// The covariance function.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// The mean function.
    pub fn mean(&self) -> &PriorMean {
        &self.mean
    }

    /// Checks that inputs have every column that kernel and mean look at.
    pub(crate) fn check(&self, inputs: &Inputs) -> Result<()> {
        self.kernel.check(inputs)?;
        self.mean.check_columns(inputs)
    }

    /// Whether these are the same points in the same order, as far as kernel and mean look at them. O(N · columns).
    pub fn sees_alike(&self, a: &Inputs, b: &Inputs) -> bool {
        let columns = self.columns();
        let value = |row: &[f64], column: usize| row.get(column).copied();
        a.len() == b.len()
            && a.rows().zip(b.rows()).all(|(a, b)| columns.iter().all(|&column| value(a, column) == value(b, column)))
    }

    /// The columns that kernel and mean look at, in order.
    pub(crate) fn columns(&self) -> Vec<usize> {
        let mut columns: Vec<usize> = self.kernel.columns().chain(self.mean.columns()).collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    /// The fewest columns that inputs can have.
    pub(crate) fn dimension_min(&self) -> usize {
        self.kernel.columns().chain(self.mean.columns()).max().map_or(1, |column| column + 1)
    }

    /// Whether the other differs in nothing but the numbers that can be learned: terms, columns, ties and the kind of
    /// mean agree.
    pub fn has_structure_of(&self, other: &Prior) -> bool {
        self.mean.has_structure_of(&other.mean) && self.kernel.has_structure_of(&other.kernel)
    }

    /// The numbers that can be learned: [`Kernel::log_parameters`], then [`PriorMean::parameter_values`].
    pub fn parameter_values(&self) -> Vec<f64> {
        [self.kernel.log_parameters(), self.mean.parameter_values()].concat()
    }

    /// What each of [`Prior::parameter_values`] is.
    pub fn parameters(&self) -> Vec<Parameter> {
        self.kernel.parameters().chain(self.mean.parameters().iter().copied()).collect()
    }

    /// A prior of the same structure with other numbers, as [`Prior::parameter_values`] lays them out.
    ///
    /// # Errors
    /// As [`Kernel::with_log_parameters`] and [`PriorMean::with_parameters`].
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let (kernel, mean) = parameters.split_at(self.kernel.parameter_count().min(parameters.len()));
        Self::new(self.kernel.with_log_parameters(kernel)?, self.mean.with_parameters(mean)?)
    }

    /// The same prior with all length-scales multiplied by a positive factor.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] or [`crate::Error::NotFinite`] where a length-scale leaves the range of numbers.
    pub fn with_length_scales_times(&self, factor: f64) -> Result<Self> {
        self.with_times(Parameter::LengthScale, factor)
    }

    /// The same prior with all variances multiplied by a positive factor.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] or [`crate::Error::NotFinite`] where a variance leaves the range of numbers.
    pub fn with_variances_times(&self, factor: f64) -> Result<Self> {
        self.with_times(Parameter::Variance, factor)
    }

    fn with_times(&self, which: Parameter, factor: f64) -> Result<Self> {
        let (mut values, parameters) = (self.parameter_values(), self.parameters());
        let chosen = values.iter_mut().zip(&parameters).filter(|(_, parameter)| **parameter == which);
        chosen.for_each(|(value, _)| *value += factor.ln());
        self.with_parameters(&values)
    }
}

/// A prior as it is written down.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    kernel: Kernel,
    mean: PriorMean,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Prior {
    type Error = crate::error::Error;

    fn try_from(Parts { kernel, mean }: Parts) -> Result<Self> {
        Self::new(kernel, mean)
    }
}

#[cfg(feature = "serde")]
impl From<Prior> for Parts {
    fn from(Prior { kernel, mean }: Prior) -> Self {
        Self { kernel, mean }
    }
}
