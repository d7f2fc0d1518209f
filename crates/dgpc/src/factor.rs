//! Kernel-free factors: summaries that depend on no prior ([`crate::method::summaries`]).

#[cfg(feature = "serde")]
use crate::error::Error;
use crate::error::{Result, all_finite, same_size};
use crate::inputs::Inputs;
use crate::linalg::Matrix;

/// A Gaussian factor exp(−½fᵀPf + ηᵀf) on f at M points. It depends on no kernel and no prior mean.
///
/// [`crate::Summary::factor`] computes it, and [`crate::Summary::from_factor`] reads it under any prior. Its numbers
/// are badly scaled if points are close to each other. To convert between two known priors, use
/// [`crate::Summary::under`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Factor {
    inducing_points: Inputs,
    precision: Matrix,
    shift: Vec<f64>,
}

impl Factor {
    /// Creates a factor at M points from P (M×M) and η (M). Only the symmetric part of P is used.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] and [`crate::Error::NotFinite`]. Negative eigenvalues of P are not detected here
    /// but when the factor is used.
    pub fn new(inducing_points: Inputs, mut precision: Matrix, shift: Vec<f64>) -> Result<Self> {
        let points = inducing_points.len();
        same_size("rows of a factor's precision, one per inducing point", points, precision.rows())?;
        same_size("columns of a factor's precision, one per inducing point", points, precision.columns())?;
        same_size("entries of a factor's shift, one per inducing point", points, shift.len())?;
        all_finite("factor shift", &shift)?;
        precision.check_finite("factor precision")?;
        precision.symmetrise();
        Ok(Self { inducing_points, precision, shift })
    }

    /// Returns the points of the factor, M×d.
    pub fn inducing_points(&self) -> &Inputs {
        &self.inducing_points
    }

    /// Returns the precision P = K_MM⁻¹GK_MM⁻¹, M×M.
    pub fn precision(&self) -> &Matrix {
        &self.precision
    }

    /// Returns the shift η = K_MM⁻¹b + Pμ₀(Z), M.
    pub fn shift(&self) -> &[f64] {
        &self.shift
    }
}

/// The serialised form of [`Factor`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    inducing_points: Inputs,
    precision: Matrix,
    shift: Vec<f64>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Factor {
    type Error = Error;

    fn try_from(Parts { inducing_points, precision, shift }: Parts) -> Result<Self> {
        Self::new(inducing_points, precision, shift)
    }
}

#[cfg(feature = "serde")]
impl From<Factor> for Parts {
    fn from(Factor { inducing_points, precision, shift }: Factor) -> Self {
        Self { inducing_points, precision, shift }
    }
}
