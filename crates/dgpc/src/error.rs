//! What can go wrong, with the offending values.

/// Everything that `dgpc` can refuse to do. No function of this crate returns a NaN instead.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is NaN or infinite.
    #[error("{what} must be finite, found {value} at row {row}, column {column}")]
    NotFinite {
        /// What the number belongs to.
        what: &'static str,
        /// Row of the number (0 for scalars).
        row: usize,
        /// Column of the number (0 for scalars and vectors).
        column: usize,
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
    /// A kernel term, reflection or prior mean names a column twice.
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
    /// A reflection is not an isometry of its kernel term, so that the reciprocal kernel would not be
    /// positive definite.
    #[error(
        "a reciprocal kernel needs equal length-scales in columns that its reflection exchanges: \
         column {column} has {length_scale}, column {partner} has {partner_length_scale}"
    )]
    NotReciprocal {
        /// A column of the term.
        column: usize,
        /// The column it is exchanged with.
        partner: usize,
        /// Length-scale of `column` (NaN where the term does not look at it).
        length_scale: f64,
        /// Length-scale of `partner` (NaN where the term does not look at it).
        partner_length_scale: f64,
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
    /// Summaries of different priors or different inducing points were put together.
    #[error("{what} belong to different {of}; convert one first")]
    Different {
        /// What was put together.
        what: &'static str,
        /// In what they differ.
        of: &'static str,
    },
    /// Gibbs sampling needs whole event weights, because it draws PG(1, c) once for every unit.
    #[error("Gibbs sampling needs whole event weights up to 1e6, event {event} has weight {weight}")]
    FractionalWeight {
        /// Index of the event.
        event: usize,
        /// Its weight.
        weight: f64,
    },
}

/// `Ok`, or why not.
pub type Result<T> = std::result::Result<T, Error>;

/// Checks that `value` is finite and positive.
pub(crate) fn positive(what: &'static str, value: f64) -> Result<f64> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Error::OutOfRange { what, expected: "a finite positive number", value })
    }
}

/// Checks that `value` is finite.
pub(crate) fn finite(what: &'static str, value: f64) -> Result<f64> {
    if value.is_finite() { Ok(value) } else { Err(Error::NotFinite { what, row: 0, column: 0, value }) }
}

/// Checks that two sizes agree.
pub(crate) fn same_size(what: &'static str, expected: usize, found: usize) -> Result<()> {
    if expected == found { Ok(()) } else { Err(size_mismatch(what, expected, found)) }
}

pub(crate) fn size_mismatch(what: &'static str, expected: usize, found: usize) -> Error {
    Error::SizeMismatch { what, expected, found }
}
