//! The kinds of parameters of a prior that can be learned.

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
