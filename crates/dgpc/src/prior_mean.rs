//! What is believed before the first event: prior mean functions, and the prior they form with a kernel.

use crate::error::{Error, Result, finite, same_size, size_mismatch};
use crate::inputs::Inputs;
use crate::kernel::Kernel;

/// The latent function expected before any event, μ₀(x).
#[derive(Debug, Clone, PartialEq)]
pub enum PriorMean {
    /// μ₀ = 0: even odds everywhere.
    Zero,
    /// The same log-odds everywhere.
    Constant(f64),
    /// μ₀ = intercept − slope · ‖x\[from\] − x\[to\]‖: log-odds that fall with the distance between two sets of columns. This is
    /// where a conservative range goes in: the odds are even at distance intercept / slope.
    Range {
        /// Log-odds at distance zero.
        intercept: f64,
        /// Log-odds lost per unit of distance.
        slope: f64,
        /// Columns of one end.
        from: Vec<usize>,
        /// Columns of the other end, as many.
        to: Vec<usize>,
    },
}

impl PriorMean {
    /// Checks that the numbers are finite and the columns pair up.
    fn check(&self) -> Result<()> {
        match self {
            PriorMean::Zero => Ok(()),
            PriorMean::Constant(value) => finite("prior mean", *value).map(drop),
            PriorMean::Range { intercept, slope, from, to } => {
                finite("prior mean intercept", *intercept)?;
                finite("prior mean slope", *slope)?;
                same_size("columns of the two ends of a range prior mean", from.len(), to.len())
            }
        }
    }

    /// Every column that the mean looks at.
    fn columns(&self) -> impl Iterator<Item = usize> {
        let ends: [&[usize]; 2] = match self {
            PriorMean::Range { from, to, .. } => [from, to],
            _ => [&[], &[]],
        };
        ends.into_iter().flatten().copied()
    }

    /// Checks that inputs have every column that the mean looks at.
    fn check_columns(&self, inputs: &Inputs) -> Result<()> {
        let columns = inputs.dimension();
        match self.columns().find(|&column| column >= columns) {
            Some(column) => Err(Error::BadColumn { what: "range prior mean", column, columns }),
            None => Ok(()),
        }
    }

    /// μ₀ at every point. O(Nd).
    ///
    /// # Errors
    /// [`Error::BadColumn`] when a range prior mean names a column that the inputs do not have.
    pub fn values(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        match self {
            PriorMean::Zero => Ok(vec![0.0; inputs.len()]),
            PriorMean::Constant(value) => Ok(vec![*value; inputs.len()]),
            PriorMean::Range { intercept, slope, from, to } => {
                self.check_columns(inputs)?;
                Ok(inputs.rows().map(|row| intercept - slope * distance(row, from, to)).collect())
            }
        }
    }

    /// What is learned of a prior mean: nothing, the constant, or intercept and slope.
    pub fn parameters(&self) -> Vec<f64> {
        match self {
            PriorMean::Zero => Vec::new(),
            PriorMean::Constant(value) => vec![*value],
            PriorMean::Range { intercept, slope, .. } => vec![*intercept, *slope],
        }
    }

    /// The same kind of mean with other parameters, as [`PriorMean::parameters`] lays them out.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] for another number of parameters, [`crate::Error::NotFinite`].
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let mean = match (self, parameters) {
            (PriorMean::Zero, []) => PriorMean::Zero,
            (PriorMean::Constant(_), &[value]) => PriorMean::Constant(value),
            (PriorMean::Range { from, to, .. }, &[intercept, slope]) => {
                PriorMean::Range { intercept, slope, from: from.clone(), to: to.clone() }
            }
            _ => return Err(size_mismatch("parameters of a prior mean", self.parameters().len(), parameters.len())),
        };
        mean.check()?;
        Ok(mean)
    }

    /// Σ_n w_n ∂μ₀(x_n)/∂(parameters).
    pub(crate) fn gradient(&self, inputs: &Inputs, weights: &[f64]) -> Vec<f64> {
        match self {
            PriorMean::Zero => Vec::new(),
            PriorMean::Constant(_) => vec![weights.iter().sum()],
            PriorMean::Range { from, to, .. } => {
                let by_slope = inputs.rows().zip(weights).map(|(row, weight)| -weight * distance(row, from, to));
                vec![weights.iter().sum(), by_slope.sum()]
            }
        }
    }
}

/// Distance between two sets of columns of one row.
fn distance(row: &[f64], from: &[usize], to: &[usize]) -> f64 {
    from.iter().zip(to).map(|(&a, &b)| (row[a] - row[b]).powi(2)).sum::<f64>().sqrt()
}

/// A Gaussian-process prior f ~ GP(μ₀, k).
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    kernel: Kernel,
    mean: PriorMean,
}

impl Prior {
    /// Puts a kernel and a prior mean together.
    ///
    /// # Errors
    /// [`Error::NotFinite`] or [`Error::SizeMismatch`] when the prior mean is not well formed.
    pub fn new(kernel: Kernel, mean: PriorMean) -> Result<Self> {
        mean.check()?;
        Ok(Self { kernel, mean })
    }

    /// Checks that inputs have every column that kernel and mean look at.
    pub(crate) fn check(&self, inputs: &Inputs) -> Result<()> {
        self.kernel.check(inputs)?;
        self.mean.check_columns(inputs)
    }

    /// The fewest columns that inputs can have.
    pub(crate) fn dimension_min(&self) -> usize {
        self.kernel.columns().chain(self.mean.columns()).max().map_or(1, |column| column + 1)
    }

    /// The covariance function.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// Whether the other differs in nothing but the numbers that can be learned.
    pub fn has_structure_of(&self, other: &Prior) -> bool {
        let same_mean = match (&self.mean, &other.mean) {
            (PriorMean::Range { from, to, .. }, PriorMean::Range { from: other_from, to: other_to, .. }) => {
                from == other_from && to == other_to
            }
            (own, other) => std::mem::discriminant(own) == std::mem::discriminant(other),
        };
        same_mean && self.kernel.has_structure_of(&other.kernel)
    }

    /// Everything that can be learned: [`Kernel::log_parameters`], then [`PriorMean::parameters`].
    pub fn parameters(&self) -> Vec<f64> {
        [self.kernel.log_parameters(), self.mean.parameters()].concat()
    }

    /// A prior of the same structure with other parameters, as [`Prior::parameters`] lays them out.
    ///
    /// # Errors
    /// As [`Kernel::with_log_parameters`] and [`PriorMean::with_parameters`].
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let (kernel, mean) = parameters.split_at(self.kernel.parameter_count().min(parameters.len()));
        Self::new(self.kernel.with_log_parameters(kernel)?, self.mean.with_parameters(mean)?)
    }

    /// The mean function.
    pub fn mean(&self) -> &PriorMean {
        &self.mean
    }
}
