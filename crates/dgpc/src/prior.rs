//! The prior: a kernel and a prior mean.

use crate::error::Result;
use crate::inputs::Inputs;
use crate::kernel::Kernel;
use crate::parameter::Parameter;
use crate::prior_mean::PriorMean;

/// A Gaussian-process prior f ~ GP(μ₀, k).
///
/// Two priors are equal if they give equal moments at every set of points. Ties between parameters, which only learning
/// uses, do not count.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Prior {
    kernel: Kernel,
    mean: PriorMean,
}

impl Prior {
    /// Creates a prior from a kernel and a prior mean.
    ///
    /// # Errors
    /// [`crate::Error::NotFinite`] for a constant prior mean that is not finite.
    pub fn new(kernel: Kernel, mean: PriorMean) -> Result<Self> {
        mean.check()?;
        Ok(Self { kernel, mean })
    }

    /// Returns the covariance function.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// Returns the mean function.
    pub fn mean(&self) -> &PriorMean {
        &self.mean
    }

    /// Checks that inputs have every column that the kernel or the mean uses.
    pub(crate) fn check(&self, inputs: &Inputs) -> Result<()> {
        self.kernel.check(inputs)?;
        self.mean.check_columns(inputs)
    }

    /// Returns whether `a` and `b` agree, point by point, in all columns that the kernel or the mean uses. O(N ·
    /// columns).
    pub fn sees_alike(&self, a: &Inputs, b: &Inputs) -> bool {
        let columns = self.columns();
        let value = |row: &[f64], column: usize| row.get(column).copied();
        a.len() == b.len()
            && a.rows().zip(b.rows()).all(|(a, b)| columns.iter().all(|&column| value(a, column) == value(b, column)))
    }

    /// Returns the columns that the kernel or the mean uses, in ascending order.
    pub(crate) fn columns(&self) -> Vec<usize> {
        let mut columns: Vec<usize> = self.kernel.columns().chain(self.mean.columns()).collect();
        columns.sort_unstable();
        columns.dedup();
        columns
    }

    /// Returns the smallest number of columns that inputs can have.
    pub(crate) fn dimension_min(&self) -> usize {
        self.kernel.columns().chain(self.mean.columns()).max().map_or(1, |column| column + 1)
    }

    /// Returns whether the two priors differ in learned parameters only. Terms, columns, ties and the kind of mean must
    /// agree.
    pub fn has_structure_of(&self, other: &Prior) -> bool {
        self.mean.has_structure_of(&other.mean) && self.kernel.has_structure_of(&other.kernel)
    }

    /// Returns the learned parameters: [`Kernel::parameter_values`], then [`PriorMean::parameter_values`].
    pub fn parameter_values(&self) -> Vec<f64> {
        [self.kernel.parameter_values(), self.mean.parameter_values()].concat()
    }

    /// Returns the kind of each entry of [`Prior::parameter_values`].
    pub fn parameters(&self) -> Vec<Parameter> {
        self.kernel.parameters().chain(self.mean.parameters().iter().copied()).collect()
    }

    /// Returns a prior of the same structure with other parameters, in the order of [`Prior::parameter_values`].
    ///
    /// # Errors
    /// As [`Kernel::with_parameters`] and [`PriorMean::with_parameters`].
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let (kernel, mean) = parameters.split_at(self.kernel.parameter_count().min(parameters.len()));
        Self::new(self.kernel.with_parameters(kernel)?, self.mean.with_parameters(mean)?)
    }

    /// Returns the prior with all length-scales multiplied by a positive factor.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] or [`crate::Error::NotFinite`] if a length-scale leaves the floating-point range.
    pub fn with_length_scales_times(&self, factor: f64) -> Result<Self> {
        self.with_times(Parameter::LengthScale, factor)
    }

    /// Returns the prior with all variances multiplied by a positive factor.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] or [`crate::Error::NotFinite`] if a variance leaves the floating-point range.
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

/// The serialised form of [`Prior`].
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
