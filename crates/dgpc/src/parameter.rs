//! What can be learned of a prior.

/// What a number is that can be learned of a prior. All but the intercept are positive and learned as logarithms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Parameter {
    /// The variance of a kernel term.
    Variance,
    /// A length-scale, of one column or of several that are tied.
    LengthScale,
    /// A parameter of a kernel shape.
    Shape,
    /// A constant prior mean, or that of a falling one at distance zero.
    Intercept,
    /// What a falling prior mean loses per unit of distance.
    Slope,
}
