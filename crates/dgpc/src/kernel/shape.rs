//! Shapes: correlation as a function of distance, with names, parameters and formulas.

use std::fmt;
use std::str::FromStr;

use super::formula::{self, Correlations, CorrelationsAndSlopes};
use crate::error::{Error, Result, in_range};
use crate::linalg::widest;

/// Correlation as a function of the scaled distance r of two points.
///
/// A shape is written as its name. If the shape has a parameter, a colon and the parameter may follow: `matern32`,
/// `rational-quadratic:1.5`. Without the colon, the parameter has its default.
///
/// ```
/// use dgpc::Shape;
///
/// assert_eq!("matern52".parse::<Shape>()?, Shape::Matern52);
/// assert_eq!(Shape::RationalQuadratic { alpha: 1.5 }.to_string(), "rational-quadratic:1.5");
/// # Ok::<(), dgpc::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "String", into = "String")
)]
#[non_exhaustive]
pub enum Shape {
    /// exp(−r²/2): infinitely smooth.
    SquaredExponential,
    /// exp(−r): continuous, nowhere differentiable.
    Matern12,
    /// (1 + √3 r) exp(−√3 r): once differentiable.
    Matern32,
    /// (1 + √5 r + 5r²/3) exp(−√5 r): twice differentiable.
    Matern52,
    /// (1 + r²/2α)^−α: a mixture of squared exponentials of many length-scales, wider for smaller α.
    RationalQuadratic {
        /// α, from 0.001 to 1000.
        alpha: f64,
    },
    /// 1 if all columns are equal and none is negative, 0 otherwise. The columns are labels, and each label has its own
    /// offset. A point with a negative label has no offset. There is no length-scale to learn.
    Label,
}

impl Shape {
    /// Every shape, with the default values of its parameters.
    pub const ALL: &[Shape] = &[
        Shape::SquaredExponential,
        Shape::Matern12,
        Shape::Matern32,
        Shape::Matern52,
        Shape::RationalQuadratic { alpha: 1.0 },
        Shape::Label,
    ];

    /// Returns the name in files and on command lines, without the parameter.
    pub const fn name(self) -> &'static str {
        match self {
            Shape::SquaredExponential => "squared-exponential",
            Shape::Matern12 => "matern12",
            Shape::Matern32 => "matern32",
            Shape::Matern52 => "matern52",
            Shape::RationalQuadratic { .. } => "rational-quadratic",
            Shape::Label => "label",
        }
    }

    /// Returns the name for people.
    pub const fn title(self) -> &'static str {
        match self {
            Shape::SquaredExponential => "squared exponential",
            Shape::Matern12 => "Matérn 1/2",
            Shape::Matern32 => "Matérn 3/2",
            Shape::Matern52 => "Matérn 5/2",
            Shape::RationalQuadratic { .. } => "rational quadratic",
            Shape::Label => "label",
        }
    }

    /// Returns whether columns are labels, which are equal or not, instead of coordinates.
    pub const fn is_of_labels(self) -> bool {
        matches!(self, Shape::Label)
    }

    /// Returns the parameters other than length-scales. All are positive, and their logarithms are learned.
    pub fn parameters(&self) -> &[f64] {
        match self {
            Shape::RationalQuadratic { alpha } => std::slice::from_ref(alpha),
            _ => &[],
        }
    }

    /// Returns the shape with other parameters, in the order of [`Shape::parameters`].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the number of parameters differs, [`Error::OutOfRange`] for one outside its range.
    pub fn with_parameters(self, parameters: &[f64]) -> Result<Self> {
        let shape = match (self, parameters) {
            (Shape::RationalQuadratic { .. }, &[alpha]) => Shape::RationalQuadratic { alpha },
            (shape, []) if shape.parameters().is_empty() => shape,
            (shape, other) => {
                let (expected, found) = (shape.parameters().len(), other.len());
                return Err(Error::SizeMismatch { what: "parameters of a kernel shape", expected, found });
            }
        };
        shape.check()?;
        Ok(shape)
    }

    /// Checks that every parameter is in its range.
    pub(super) fn check(self) -> Result<()> {
        match self {
            Shape::RationalQuadratic { alpha } => {
                in_range("α of a rational quadratic", alpha, 1e-3..=1e3, "a number from 0.001 to 1000").map(drop)
            }
            _ => Ok(()),
        }
    }

    /// Replaces squared scaled distances by correlations.
    pub(super) fn correlations(self, values: &mut [f64]) {
        match self {
            Shape::SquaredExponential => widest(Correlations(values, formula::SquaredExponential)),
            Shape::Matern12 => widest(Correlations(values, formula::Matern12)),
            Shape::Matern32 => widest(Correlations(values, formula::Matern32)),
            Shape::Matern52 => widest(Correlations(values, formula::Matern52)),
            Shape::RationalQuadratic { alpha } => {
                values.iter_mut().for_each(|value| *value = rational_quadratic(alpha, *value).0);
            }
            Shape::Label => values.iter_mut().for_each(|value| *value = if *value == 0.0 { 1.0 } else { 0.0 }),
        }
    }

    /// Replaces squared scaled distances by correlations, and writes their derivatives by r² to `slopes`.
    pub(super) fn correlations_and_slopes(self, values: &mut [f64], slopes: &mut [f64]) {
        match self {
            Shape::SquaredExponential => widest(CorrelationsAndSlopes(values, slopes, formula::SquaredExponential)),
            Shape::Matern12 => widest(CorrelationsAndSlopes(values, slopes, formula::Matern12)),
            Shape::Matern32 => widest(CorrelationsAndSlopes(values, slopes, formula::Matern32)),
            Shape::Matern52 => widest(CorrelationsAndSlopes(values, slopes, formula::Matern52)),
            Shape::RationalQuadratic { alpha } => {
                let pairs = values.iter_mut().zip(slopes);
                pairs.for_each(|(value, slope)| (*value, *slope) = rational_quadratic(alpha, *value));
            }
            Shape::Label => {
                slopes.fill(0.0);
                self.correlations(values);
            }
        }
    }

    /// Adds `weight` · the derivative of the correlation by the logarithm of every parameter to `sums`.
    #[inline]
    pub(super) fn add_parameter_slopes(self, weight: f64, squared_distance: f64, sums: &mut [f64]) {
        if let (Shape::RationalQuadratic { alpha }, [sum], true) = (self, sums, squared_distance.is_finite()) {
            let excess = squared_distance / (2.0 * alpha);
            let log_base = excess.ln_1p();
            *sum += weight * (-alpha * log_base).exp() * alpha * (excess / (1.0 + excess) - log_base);
        }
    }
}

/// Returns (1 + r²/(2α))^−α and its derivative by r².
fn rational_quadratic(alpha: f64, squared_distance: f64) -> (f64, f64) {
    // At an infinite distance the products below would be 0 · ∞.
    if !squared_distance.is_finite() {
        return (0.0, 0.0);
    }
    let excess = squared_distance / (2.0 * alpha);
    let correlation = (-alpha * excess.ln_1p()).exp();
    (correlation, -0.5 * correlation / (1.0 + excess))
}

impl fmt::Display for Shape {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())?;
        self.parameters().iter().try_for_each(|parameter| write!(formatter, ":{parameter}"))
    }
}

impl FromStr for Shape {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let unknown = || Error::UnknownShape {
            name: text.to_owned(),
            known: Shape::ALL.iter().map(|shape| shape.name()).collect(),
        };
        let mut parts = text.split(':');
        let name = parts.next().unwrap_or_default();
        let shape = *Shape::ALL.iter().find(|shape| shape.name() == name).ok_or_else(unknown)?;
        let bad = |part: &str| Error::BadShapeParameter { shape: shape.name(), found: part.to_owned() };
        let parameters = parts.map(|part| part.parse().map_err(|_| bad(part))).collect::<Result<Vec<f64>>>()?;
        if parameters.is_empty() { Ok(shape) } else { shape.with_parameters(&parameters) }
    }
}

impl TryFrom<String> for Shape {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<Shape> for String {
    fn from(shape: Shape) -> Self {
        shape.to_string()
    }
}
