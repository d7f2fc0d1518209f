//! The kinds of parameters of a prior that can be learned.

/// The kind of a learned parameter of a prior. All but the intercept are positive, and their logarithms are learned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Parameter {
    /// The variance of a kernel term.
    Variance,
    /// A length-scale, of one column or of several tied columns.
    LengthScale,
    /// A parameter of a kernel shape.
    Shape,
    /// A constant prior mean, or the value of a falling prior mean at distance zero.
    Intercept,
    /// The decrease of a falling prior mean per unit of distance.
    Slope,
}
