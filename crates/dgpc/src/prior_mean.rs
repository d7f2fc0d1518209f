//! Prior mean functions: the expected latent function before the first event.

use crate::error::{Error, Result, finite, positive, same_size};
use crate::inputs::{Inputs, check_column};
use crate::parameter::Parameter;

/// The prior mean μ₀(x): the expected latent function before any event.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum PriorMean {
    /// μ₀ = 0: even odds everywhere.
    Zero,
    /// Constant log-odds.
    Constant(f64),
    /// Log-odds that fall with the distance between two sets of columns.
    Range(RangeMean),
}

/// Log-odds that fall with the distance between two sets of columns: μ₀ = intercept − slope · ‖x\[from\] − x\[to\]‖.
/// The odds are even at distance intercept / slope. Use it to encode a conservative communication range.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct RangeMean {
    intercept: f64,
    slope: f64,
    from: Vec<usize>,
    to: Vec<usize>,
}

impl RangeMean {
    /// Creates a mean with log-odds of `intercept` at distance zero, which fall by `slope` per unit of distance. The
    /// distance is that between the columns `from` and the columns `to`, which must be equally many.
    ///
    /// # Errors
    /// * [`Error::NotFinite`] for a number that is not finite.
    /// * [`Error::OutOfRange`] for an empty list of columns, and for a column beyond [`crate::COLUMN_MAX`].
    /// * [`Error::SizeMismatch`] if the numbers of columns of the two ends differ.
    /// * [`Error::RepeatedColumn`] if one end names a column twice.
    pub fn new(intercept: f64, slope: f64, from: &[usize], to: &[usize]) -> Result<Self> {
        finite("prior mean intercept", intercept)?;
        finite("prior mean slope", slope)?;
        positive("number of columns of a range prior mean", from.len() as f64)?;
        same_size("columns of the two ends of a range prior mean", from.len(), to.len())?;
        for end in [from, to] {
            for (n, &column) in end.iter().enumerate() {
                check_column(column)?;
                if end[..n].contains(&column) {
                    return Err(Error::RepeatedColumn { what: "range prior mean", column });
                }
            }
        }
        Ok(Self { intercept, slope, from: from.to_vec(), to: to.to_vec() })
    }

    /// Returns the log-odds at distance zero.
    pub fn intercept(&self) -> f64 {
        self.intercept
    }

    /// Returns the decrease of the log-odds per unit of distance.
    pub fn slope(&self) -> f64 {
        self.slope
    }

    /// Returns whether the log-odds fall with distance.
    fn falls(&self) -> bool {
        self.slope > 0.0
    }

    /// Returns the distance at which the odds are even, or `None` if the log-odds do not fall.
    pub fn even_odds_distance(&self) -> Option<f64> {
        self.falls().then(|| self.intercept / self.slope)
    }

    /// Returns the columns of one end.
    pub fn from(&self) -> &[usize] {
        &self.from
    }

    /// Returns the columns of the other end.
    pub fn to(&self) -> &[usize] {
        &self.to
    }

    /// Returns the distance between the two ends of one row.
    fn distance(&self, row: &[f64]) -> f64 {
        let squares = self.from.iter().zip(&self.to).map(|(&a, &b)| (row[a] - row[b]).powi(2));
        squares.sum::<f64>().sqrt()
    }
}

impl PriorMean {
    /// Creates a mean with log-odds that fall with distance. See [`RangeMean::new`].
    ///
    /// # Errors
    /// As [`RangeMean::new`].
    pub fn range(intercept: f64, slope: f64, from: &[usize], to: &[usize]) -> Result<Self> {
        RangeMean::new(intercept, slope, from, to).map(Self::Range)
    }

    /// Checks that the numbers are finite.
    pub(crate) fn check(&self) -> Result<()> {
        match self {
            PriorMean::Constant(value) => finite("prior mean", *value).map(drop),
            PriorMean::Zero | PriorMean::Range(_) => Ok(()),
        }
    }

    /// Returns every column that the mean uses.
    pub(crate) fn columns(&self) -> impl Iterator<Item = usize> {
        let ends: [&[usize]; 2] = match self {
            PriorMean::Range(range) => [&range.from, &range.to],
            _ => [&[], &[]],
        };
        ends.into_iter().flatten().copied()
    }

    /// Checks that inputs have every column that the mean uses.
    pub(crate) fn check_columns(&self, inputs: &Inputs) -> Result<()> {
        let columns = inputs.dimension();
        match self.columns().find(|&column| column >= columns) {
            Some(column) => Err(Error::BadColumn { what: "range prior mean", column, columns }),
            None => Ok(()),
        }
    }

    /// Returns μ₀ at every point. O(Nd).
    ///
    /// # Errors
    /// [`Error::BadColumn`] if a range prior mean names a column that the inputs do not have, [`Error::NotFinite`] if
    /// numbers near the end of the floating-point range overflow.
    pub fn values(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        match self {
            PriorMean::Zero => Ok(vec![0.0; inputs.len()]),
            PriorMean::Constant(value) => Ok(vec![finite("prior mean", *value)?; inputs.len()]),
            PriorMean::Range(range) => {
                self.check_columns(inputs)?;
                let value = |row: &[f64]| finite("prior mean", range.intercept - range.slope * range.distance(row));
                inputs.rows().map(value).collect()
            }
        }
    }

    /// Returns the learned parameters. A constant mean has its constant, and a range mean has its intercept. A falling
    /// range mean also has the logarithm of its slope. A slope that is not positive is not learned.
    pub fn parameter_values(&self) -> Vec<f64> {
        match self {
            PriorMean::Zero => Vec::new(),
            PriorMean::Constant(value) => vec![*value],
            PriorMean::Range(range) if range.falls() => vec![range.intercept, range.slope.ln()],
            PriorMean::Range(range) => vec![range.intercept],
        }
    }

    /// Returns the kind of each entry of [`PriorMean::parameter_values`].
    pub fn parameters(&self) -> &'static [Parameter] {
        match self {
            PriorMean::Zero => &[],
            PriorMean::Constant(_) => &[Parameter::Intercept],
            PriorMean::Range(range) if range.falls() => &[Parameter::Intercept, Parameter::Slope],
            PriorMean::Range(_) => &[Parameter::Intercept],
        }
    }

    /// Returns the mean with other parameters, in the order of [`PriorMean::parameter_values`].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the number of parameters differs, [`Error::NotFinite`] for a parameter that is not
    /// finite, and [`Error::OutOfRange`] if the slope leaves the floating-point range.
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        match (self, parameters) {
            (PriorMean::Zero, []) => Ok(PriorMean::Zero),
            (PriorMean::Constant(_), &[value]) => finite("prior mean", value).map(PriorMean::Constant),
            (PriorMean::Range(range), &[intercept, log_slope]) if range.falls() => {
                let slope = positive("prior mean slope", log_slope.exp())?;
                Self::range(intercept, slope, &range.from, &range.to)
            }
            (PriorMean::Range(range), &[intercept]) if !range.falls() => {
                Self::range(intercept, range.slope, &range.from, &range.to)
            }
            _ => {
                let (expected, found) = (self.parameters().len(), parameters.len());
                Err(Error::SizeMismatch { what: "parameters of a prior mean", expected, found })
            }
        }
    }

    /// Returns whether the two means differ in learned parameters only.
    pub(crate) fn has_structure_of(&self, other: &PriorMean) -> bool {
        match (self, other) {
            (PriorMean::Range(own), PriorMean::Range(other)) => {
                own.from == other.from && own.to == other.to && own.falls() == other.falls()
            }
            (own, other) => std::mem::discriminant(own) == std::mem::discriminant(other),
        }
    }

    /// Returns Σ_n w_n ∂μ₀(x_n)/∂(parameters).
    pub(crate) fn gradient(&self, inputs: &Inputs, weights: &[f64]) -> Vec<f64> {
        match self {
            PriorMean::Zero => Vec::new(),
            PriorMean::Constant(_) => vec![weights.iter().sum()],
            PriorMean::Range(range) => {
                let by_intercept = weights.iter().sum();
                if !range.falls() {
                    return vec![by_intercept];
                }
                let distances = inputs.rows().zip(weights).map(|(row, weight)| weight * range.distance(row));
                vec![by_intercept, -range.slope * distances.sum::<f64>()]
            }
        }
    }
}

/// The serialised form of [`RangeMean`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    intercept: f64,
    slope: f64,
    from: Vec<usize>,
    to: Vec<usize>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for RangeMean {
    type Error = Error;

    fn try_from(Parts { intercept, slope, from, to }: Parts) -> Result<Self> {
        Self::new(intercept, slope, &from, &to)
    }
}

#[cfg(feature = "serde")]
impl From<RangeMean> for Parts {
    fn from(RangeMean { intercept, slope, from, to }: RangeMean) -> Self {
        Self { intercept, slope, from, to }
    }
}
