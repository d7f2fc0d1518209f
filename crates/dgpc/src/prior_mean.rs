//! Prior mean functions: what is expected of the latent function before the first event.

use crate::error::{Error, Result, finite, positive, same_size};
use crate::inputs::{Inputs, check_column};
use crate::parameter::Parameter;

/// The latent function expected before any event, μ₀(x).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
#[non_exhaustive]
pub enum PriorMean {
    /// μ₀ = 0: even odds everywhere.
    Zero,
    /// The same log-odds everywhere.
    Constant(f64),
    /// Log-odds that fall with the distance between two sets of columns.
    Range(RangeMean),
}

/// μ₀ = intercept − slope · ‖x\[from\] − x\[to\]‖: log-odds that fall with the distance between two sets of columns.
/// This is where a conservative range goes in: the odds are even at distance intercept / slope.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct RangeMean {
    intercept: f64,
    slope: f64,
    from: Vec<usize>,
    to: Vec<usize>,
}

impl RangeMean {
    /// Log-odds of `intercept` at distance zero, falling by `slope` per unit of the distance between the columns `from`
    /// and as many columns `to`.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a number that is not finite, [`Error::OutOfRange`] without columns or for one beyond
    /// [`crate::COLUMN_MAX`], [`Error::SizeMismatch`] where the columns do not pair up, [`Error::RepeatedColumn`].
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

    /// Log-odds at distance zero.
    pub fn intercept(&self) -> f64 {
        self.intercept
    }

    /// Log-odds lost per unit of distance.
    pub fn slope(&self) -> f64 {
        self.slope
    }

    /// Whether log-odds fall with distance.
    fn falls(&self) -> bool {
        self.slope > 0.0
    }

    /// The distance at which the odds are even; `None` where they do not fall.
    pub fn even_odds_distance(&self) -> Option<f64> {
        self.falls().then(|| self.intercept / self.slope)
    }

    /// Columns of one end.
    pub fn from(&self) -> &[usize] {
        &self.from
    }

    /// Columns of the other end, as many.
    pub fn to(&self) -> &[usize] {
        &self.to
    }

    /// Distance between the two ends of one row.
    fn distance(&self, row: &[f64]) -> f64 {
        let squares = self.from.iter().zip(&self.to).map(|(&a, &b)| (row[a] - row[b]).powi(2));
        squares.sum::<f64>().sqrt()
    }
}

impl PriorMean {
    /// Log-odds that fall with distance. See [`RangeMean::new`].
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

    /// Every column that the mean looks at.
    pub(crate) fn columns(&self) -> impl Iterator<Item = usize> {
        let ends: [&[usize]; 2] = match self {
            PriorMean::Range(range) => [&range.from, &range.to],
            _ => [&[], &[]],
        };
        ends.into_iter().flatten().copied()
    }

    /// Checks that inputs have every column that the mean looks at.
    pub(crate) fn check_columns(&self, inputs: &Inputs) -> Result<()> {
        let columns = inputs.dimension();
        match self.columns().find(|&column| column >= columns) {
            Some(column) => Err(Error::BadColumn { what: "range prior mean", column, columns }),
            None => Ok(()),
        }
    }

    /// μ₀ at every point. O(Nd).
    ///
    /// # Errors
    /// [`Error::BadColumn`] when a range prior mean names a column that the inputs do not have, [`Error::NotFinite`]
    /// where numbers near the end of the range overflow.
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

    /// Its numbers that can be learned: none, the constant, or the intercept and, where log-odds fall, the logarithm of
    /// the slope. A slope that is not positive is nothing that data can change.
    pub fn parameter_values(&self) -> Vec<f64> {
        match self {
            PriorMean::Zero => Vec::new(),
            PriorMean::Constant(value) => vec![*value],
            PriorMean::Range(range) if range.falls() => vec![range.intercept, range.slope.ln()],
            PriorMean::Range(range) => vec![range.intercept],
        }
    }

    /// What each of [`PriorMean::parameter_values`] is.
    pub fn parameters(&self) -> &'static [Parameter] {
        match self {
            PriorMean::Zero => &[],
            PriorMean::Constant(_) => &[Parameter::Intercept],
            PriorMean::Range(range) if range.falls() => &[Parameter::Intercept, Parameter::Slope],
            PriorMean::Range(_) => &[Parameter::Intercept],
        }
    }

    /// The same kind of mean with other numbers, as [`PriorMean::parameter_values`] lays them out.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of parameters, [`Error::NotFinite`], [`Error::OutOfRange`] where the
    /// slope leaves the range of numbers.
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

    /// Whether the other differs in nothing but numbers that can be learned.
    pub(crate) fn has_structure_of(&self, other: &PriorMean) -> bool {
        match (self, other) {
            (PriorMean::Range(own), PriorMean::Range(other)) => {
                own.from == other.from && own.to == other.to && own.falls() == other.falls()
            }
            (own, other) => std::mem::discriminant(own) == std::mem::discriminant(other),
        }
    }

    /// Σ_n w_n ∂μ₀(x_n)/∂(parameters).
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

/// A falling mean as it is written down.
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
