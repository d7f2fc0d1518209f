//! Errors, with the offending values.

use std::fmt;
use std::ops::RangeInclusive;

/// The errors of `dgpc`. A function that returns a [`Result`] never returns a NaN in it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is NaN or infinite.
    #[error("{what} must be finite, found {value}{place}")]
    NotFinite {
        /// Name of the quantity that contains the number.
        what: &'static str,
        /// Place of the number in that quantity.
        place: Place,
        /// The number itself.
        value: f64,
    },
    /// A number lies outside its domain.
    #[error("{what} must be {expected}, found {value}")]
    OutOfRange {
        /// Name of the quantity.
        what: &'static str,
        /// The domain, in words.
        expected: &'static str,
        /// The number itself.
        value: f64,
    },
    /// Two sizes that must be equal differ.
    #[error("{what}: expected {expected}, found {found}")]
    SizeMismatch {
        /// Description of the compared sizes.
        what: &'static str,
        /// The required size.
        expected: usize,
        /// The actual size.
        found: usize,
    },
    /// A correlation, reflection or prior mean names a column twice.
    #[error("{what} names column {column} twice")]
    RepeatedColumn {
        /// The object that names the column.
        what: &'static str,
        /// The repeated column.
        column: usize,
    },
    /// A kernel term or prior mean uses a column that the inputs do not have.
    #[error("{what} names column {column}, but the inputs have {columns} columns")]
    BadColumn {
        /// The object that names the column.
        what: &'static str,
        /// The missing column.
        column: usize,
        /// Number of columns of the inputs.
        columns: usize,
    },
    /// No kernel shape has this name.
    #[error("no kernel shape is called {name:?}; expected one of {}", known.join(", "))]
    UnknownShape {
        /// The name that was given.
        name: String,
        /// The valid names.
        known: Vec<&'static str>,
    },
    /// The parameter of a kernel shape, after the colon, is not a number.
    #[error("the parameter of the kernel shape {shape} must be a number, found {found:?}")]
    BadShapeParameter {
        /// Name of the shape.
        shape: &'static str,
        /// The text after the colon.
        found: String,
    },
    /// A reflection is not an involution: applying it twice does not give the identity.
    #[error("a reflection must be an involution, but applying it twice changes column {column}")]
    NotAnInvolution {
        /// The first column that changes.
        column: usize,
    },
    /// A reflection is not an isometry of its kernel term. The reciprocal kernel would not be positive definite.
    #[error(
        "a reciprocal kernel needs equal length-scales in columns that its reflection exchanges: column {column} has \
         {length_scale}, column {partner} {}", has(*partner_length_scale)
    )]
    NotReciprocal {
        /// A column of the term.
        column: usize,
        /// The column that the reflection exchanges with `column`.
        partner: usize,
        /// Length-scale of `column`.
        length_scale: f64,
        /// Length-scale of `partner`; `None` if the correlation does not use that column.
        partner_length_scale: Option<f64>,
    },
    /// Columns of different length-scales were tied.
    #[error(
        "tied columns need equal length-scales: column {} has {}, column {} has {}",
        columns[0], length_scales[0], columns[1], length_scales[1]
    )]
    UnequalLengthScales {
        /// Two of the columns.
        columns: [usize; 2],
        /// Their length-scales.
        length_scales: [f64; 2],
    },
    /// A Cholesky factorisation failed.
    #[error("{what} is not positive definite: pivot {pivot} of {size} failed with {jitter:e} added to the diagonal")]
    NotPositiveDefinite {
        /// Name of the matrix.
        what: &'static str,
        /// Index of the pivot that was not positive.
        pivot: usize,
        /// Order of the matrix.
        size: usize,
        /// The jitter on the diagonal.
        jitter: f64,
    },
    /// A matrix that must be positive semi-definite has a clearly negative eigenvalue.
    #[error("{what} must be positive semi-definite, found the eigenvalue {eigenvalue:e}")]
    NegativeEigenvalue {
        /// Name of the matrix.
        what: &'static str,
        /// The smallest eigenvalue.
        eigenvalue: f64,
    },
    /// The computation of a matrix's eigenvalues failed.
    #[error("the eigenvalues of {what}, of order {size}, could not be computed")]
    NoEigenvalues {
        /// Name of the matrix.
        what: &'static str,
        /// Order of the matrix.
        size: usize,
    },
    /// A summary was combined with an object that belongs to another prior.
    #[error("{what} belong to different priors; read the summary under the other prior first (Summary::under)")]
    DifferentPriors {
        /// The combined objects.
        what: &'static str,
    },
    /// A posterior at points predicts only under extensions of its posterior.
    #[error("a posterior of {found} rows does not extend the posterior of {rows} rows that was prepared at the points")]
    NotAnExtension {
        /// Rows of the prepared posterior.
        rows: usize,
        /// Rows of the posterior that was given.
        found: usize,
    },
    /// Summaries with different inducing points were added or subtracted.
    #[error("summaries can be added or subtracted only if they have the same inducing points")]
    DifferentInducingPoints,
    /// The warm start of a search has another structure than its template.
    #[error(
        "template and warm start have different structures: other terms, columns, ties or another kind of prior mean"
    )]
    DifferentStructures,
    /// The callback of a [`crate::Monitor`] asked to stop.
    #[error("the computation was stopped by its monitor")]
    Stopped,
    /// The contribution of a shard answers another request.
    #[error("the contribution of a shard answers another request, or belongs to another fit")]
    WrongContribution,
    /// A result was requested before the end of a fit.
    #[error("the fit has not ended; its shards must answer further requests")]
    Unfinished,
    /// An event weight is not whole. Gibbs sampling draws PG(1, c) once for every unit of weight.
    #[error("Gibbs sampling needs whole event weights up to 1e6, event {event} has weight {weight}")]
    FractionalWeight {
        /// Index of the event.
        event: usize,
        /// Its weight.
        weight: f64,
    },
}

/// Place of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A scalar.
    Alone,
    /// An element of a list, counted from 0.
    Element(usize),
    /// An entry of a table, both indices counted from 0.
    Entry {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Alone => Ok(()),
            Place::Element(place) => write!(formatter, " at place {place}"),
            Place::Entry { row, column } => write!(formatter, " at row {row}, column {column}"),
        }
    }
}

/// A result with the [`Error`] of this crate.
pub type Result<T> = std::result::Result<T, Error>;

fn has(length_scale: Option<f64>) -> String {
    length_scale.map_or_else(|| "is not among its columns".to_owned(), |length_scale| format!("has {length_scale}"))
}

/// Checks that `value` is finite and positive.
pub(crate) fn positive(what: &'static str, value: f64) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Error::OutOfRange { what, expected: "a finite positive number", value })
    }
}

/// Checks that `value` is finite and not negative.
pub(crate) fn not_negative(what: &'static str, value: f64) -> Result<f64> {
    in_range(what, value, 0.0..=f64::MAX, "a finite number, at least 0")
}

/// Checks that `value` lies in `range`. The error describes the range as `expected`.
pub(crate) fn in_range(
    what: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
    expected: &'static str,
) -> Result<f64> {
    if range.contains(&value) { Ok(value) } else { Err(Error::OutOfRange { what, expected, value }) }
}

/// Checks that a scalar is finite.
pub(crate) fn finite(what: &'static str, value: f64) -> Result<f64> {
    if value.is_finite() { Ok(value) } else { Err(Error::NotFinite { what, place: Place::Alone, value }) }
}

/// Checks that every number of a list is finite.
pub(crate) fn all_finite(what: &'static str, values: &[f64]) -> Result<()> {
    match values.iter().position(|value| !value.is_finite()) {
        Some(place) => Err(Error::NotFinite { what, place: Place::Element(place), value: values[place] }),
        None => Ok(()),
    }
}

/// Checks that two sizes agree.
pub(crate) fn same_size(what: &'static str, expected: usize, found: usize) -> Result<()> {
    if expected == found { Ok(()) } else { Err(Error::SizeMismatch { what, expected, found }) }
}
