//! How covariance falls with distance: every shape, its names, its parameters and its formulas.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result, in_range};

/// How correlation falls with the scaled distance r of two points.
///
/// A shape is written as its name, and its parameter after a colon where it has one: `matern32`,
/// `rational-quadratic:1.5`. Without the colon a parameter has its default.
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
    /// (1 + r²/2α)^−α: a mixture of squared exponentials of many length-scales, the wider the smaller α is.
    RationalQuadratic {
        /// α, from 0.001 to 1000.
        alpha: f64,
    },
    /// 1 where all columns are equal and none is negative, 0 elsewhere: columns are labels, each of which has an offset
    /// of its own, and a point with a negative label has none. There is no length-scale to learn.
    Label,
}

impl Shape {
    /// Every shape, with the defaults of its parameters.
    pub const ALL: &[Shape] = &[
        Shape::SquaredExponential,
        Shape::Matern12,
        Shape::Matern32,
        Shape::Matern52,
        Shape::RationalQuadratic { alpha: 1.0 },
        Shape::Label,
    ];

    /// What it is called in files and on command lines, without its parameter.
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

    /// What people call it.
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

    /// Whether columns are labels, which are equal or not, rather than places that have a distance.
    pub const fn is_of_labels(self) -> bool {
        matches!(self, Shape::Label)
    }

    /// Its parameters beside length-scales: all positive, learned as logarithms.
    pub fn parameters(&self) -> &[f64] {
        match self {
            Shape::RationalQuadratic { alpha } => std::slice::from_ref(alpha),
            _ => &[],
        }
    }

    /// The same kind of shape with other parameters, as [`Shape::parameters`] lays them out.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of parameters, [`Error::OutOfRange`].
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

    /// Correlation at squared scaled distance r².
    #[inline]
    pub(super) fn correlation(self, squared_distance: f64) -> f64 {
        self.correlation_and_slope(squared_distance).0
    }

    /// Correlation at squared scaled distance r², and its derivative by r².
    #[inline]
    pub(super) fn correlation_and_slope(self, squared_distance: f64) -> (f64, f64) {
        // Farther than numbers reach, where the products below would be 0 · ∞.
        if !squared_distance.is_finite() {
            return (0.0, 0.0);
        }
        match self {
            Shape::SquaredExponential => {
                let correlation = (-0.5 * squared_distance).exp();
                (correlation, -0.5 * correlation)
            }
            Shape::Matern12 => {
                let r = squared_distance.sqrt();
                let correlation = (-r).exp();
                // At distance 0 the slope is infinite, but whatever it is multiplied by there is 0.
                (correlation, if r > 0.0 { -0.5 * correlation / r } else { 0.0 })
            }
            Shape::Matern32 => {
                let r = (3.0 * squared_distance).sqrt();
                let decay = (-r).exp();
                (decay + r * decay, -1.5 * decay)
            }
            Shape::Matern52 => {
                let r = (5.0 * squared_distance).sqrt();
                let decay = (-r).exp();
                let linear = decay + r * decay;
                (linear + r * (r * decay) / 3.0, -5.0 / 6.0 * linear)
            }
            Shape::RationalQuadratic { alpha } => {
                let excess = squared_distance / (2.0 * alpha);
                let correlation = (-alpha * excess.ln_1p()).exp();
                (correlation, -0.5 * correlation / (1.0 + excess))
            }
            Shape::Label => (if squared_distance == 0.0 { 1.0 } else { 0.0 }, 0.0),
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
