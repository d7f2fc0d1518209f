//! What can go wrong, with the offending values.

use std::fmt;
use std::ops::RangeInclusive;

/// Everything that `dgpc` can refuse to do. No function that returns a [`Result`] returns a NaN in it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is NaN or infinite.
    #[error("{what} must be finite, found {value}{place}")]
    NotFinite {
        /// What the number is, or belongs to.
        what: &'static str,
        /// Where in it.
        place: Place,
        /// The number itself.
        value: f64,
    },
    /// A number lies outside its domain.
    #[error("{what} must be {expected}, found {value}")]
    OutOfRange {
        /// What the number is.
        what: &'static str,
        /// The domain, in words.
        expected: &'static str,
        /// The number itself.
        value: f64,
    },
    /// Two things that belong together differ in size.
    #[error("{what}: expected {expected}, found {found}")]
    SizeMismatch {
        /// Which sizes were compared.
        what: &'static str,
        /// The size that was needed.
        expected: usize,
        /// The size that was given.
        found: usize,
    },
    /// A correlation, reflection or prior mean names a column twice.
    #[error("{what} names column {column} twice")]
    RepeatedColumn {
        /// Who names the column.
        what: &'static str,
        /// The column that was named.
        column: usize,
    },
    /// A kernel term or prior mean looks at a column that the inputs do not have.
    #[error("{what} names column {column}, but the inputs have {columns} columns")]
    BadColumn {
        /// Who names the column.
        what: &'static str,
        /// The column that was named.
        column: usize,
        /// How many columns there are.
        columns: usize,
    },
    /// A name that no kernel shape has.
    #[error("no kernel shape is called {name:?}; expected one of {}", known.join(", "))]
    UnknownShape {
        /// The name as it was written.
        name: String,
        /// The names that there are.
        known: Vec<&'static str>,
    },
    /// What stands after the colon of a kernel shape is no number.
    #[error("the parameter of the kernel shape {shape} must be a number, found {found:?}")]
    BadShapeParameter {
        /// The shape.
        shape: &'static str,
        /// What stands there.
        found: String,
    },
    /// A reflection that does not lead back when it is done twice.
    #[error("a reflection done twice must lead back, but column {column} does not come back as it was")]
    NotAnInvolution {
        /// The first such column.
        column: usize,
    },
    /// A reflection is not an isometry of its kernel term, so that the reciprocal kernel would not be positive
    /// definite.
    #[error(
        "a reciprocal kernel needs equal length-scales in columns that its reflection exchanges: column {column} has \
         {length_scale}, column {partner} {}", has(*partner_length_scale)
    )]
    NotReciprocal {
        /// A column of the term.
        column: usize,
        /// The column it is exchanged with.
        partner: usize,
        /// Length-scale of `column`.
        length_scale: f64,
        /// Length-scale of `partner`; `None` where the correlation does not look at it.
        partner_length_scale: Option<f64>,
    },
    /// Columns of different length-scale were tied.
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
    /// A factorisation failed.
    #[error("{what} is not positive definite: pivot {pivot} of {size} failed with {jitter:e} added to the diagonal")]
    NotPositiveDefinite {
        /// Which matrix.
        what: &'static str,
        /// Index of the pivot that was not positive.
        pivot: usize,
        /// Order of the matrix.
        size: usize,
        /// What had been added to the diagonal.
        jitter: f64,
    },
    /// A matrix that must be positive semi-definite has a clearly negative eigenvalue.
    #[error("{what} must be positive semi-definite, found the eigenvalue {eigenvalue:e}")]
    NegativeEigenvalue {
        /// Which matrix.
        what: &'static str,
        /// The smallest eigenvalue.
        eigenvalue: f64,
    },
    /// The eigenvalues of a matrix could not be computed.
    #[error("the eigenvalues of {what}, of order {size}, could not be computed")]
    NoEigenvalues {
        /// Which matrix.
        what: &'static str,
        /// Its order.
        size: usize,
    },
    /// A summary was put together with something of another prior.
    #[error("{what} belong to different priors; read the summary under the other prior first (Summary::under)")]
    DifferentPriors {
        /// What was put together.
        what: &'static str,
    },
    /// Summaries about different inducing points were added or subtracted.
    #[error("summaries can be added or subtracted at the same inducing points only")]
    DifferentInducingPoints,
    /// A search was to start from a prior of another structure than its template.
    #[error(
        "template and warm start have different structures: other terms, columns, ties or another kind of prior mean"
    )]
    DifferentStructures,
    /// Gibbs sampling needs whole event weights, because it draws PG(1, c) once for every unit.
    #[error("Gibbs sampling needs whole event weights up to 1e6, event {event} has weight {weight}")]
    FractionalWeight {
        /// Index of the event.
        event: usize,
        /// Its weight.
        weight: f64,
    },
}

/// Where a number stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// It stands alone.
    Alone,
    /// In a list, counted from 0.
    Element(usize),
    /// In a table, both counted from 0.
    Entry {
        /// Its row.
        row: usize,
        /// Its column.
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

/// `Ok`, or why not.
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

/// Checks that `value` is within its range, which `expected` says in words.
pub(crate) fn in_range(
    what: &'static str,
    value: f64,
    range: RangeInclusive<f64>,
    expected: &'static str,
) -> Result<f64> {
    if range.contains(&value) { Ok(value) } else { Err(Error::OutOfRange { what, expected, value }) }
}

/// Checks that `value`, which stands alone, is finite.
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
