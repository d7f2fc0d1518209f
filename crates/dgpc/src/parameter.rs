//! The kinds of parameters of a prior that can be learned.

#[cfg(feature = "learn")]
use std::ops::RangeInclusive;

/// The kind of a learned parameter of a prior. Logarithms are learned, except for an intercept and a reciprocity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Parameter {
    /// The variance of a kernel term.
    Variance,
    /// The reciprocity of a kernel term ([`crate::Term::reciprocity`]). Its log-odds are learned.
    Reciprocity,
    /// A length-scale, of one column or of several tied columns.
    LengthScale,
    /// A parameter of a kernel shape.
    Shape,
    /// A constant prior mean, or the value of a falling prior mean at distance zero.
    Intercept,
    /// The decrease of a falling prior mean per unit of distance.
    Slope,
}

#[cfg(feature = "learn")]
impl Parameter {
    /// Returns the learned value of a parameter: its logarithm, its log-odds, or itself.
    pub(crate) fn learned_value(self, value: f64) -> f64 {
        match self {
            Parameter::Variance | Parameter::LengthScale | Parameter::Shape | Parameter::Slope => value.ln(),
            Parameter::Reciprocity => (value / (1.0 - value)).ln(),
            Parameter::Intercept => value,
        }
    }

    /// Returns the parameter that has the given learned value.
    pub(crate) fn natural_value(self, learned: f64) -> f64 {
        match self {
            Parameter::Variance | Parameter::LengthScale | Parameter::Shape | Parameter::Slope => learned.exp(),
            Parameter::Reciprocity => 1.0 / (1.0 + (-learned).exp()),
            Parameter::Intercept => learned,
        }
    }

    /// Returns the values that a bound of the parameter can have.
    pub(crate) fn domain(self) -> RangeInclusive<f64> {
        match self {
            Parameter::Variance | Parameter::LengthScale | Parameter::Shape | Parameter::Slope => {
                f64::MIN_POSITIVE..=f64::MAX
            }
            Parameter::Reciprocity => 0.0..=1.0,
            Parameter::Intercept => f64::MIN..=f64::MAX,
        }
    }
}
