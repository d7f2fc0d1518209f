//! Errors of reading and writing model files.

use crate::model::link_model::MODEL_SCHEMA;
use crate::types::bounds::Bounds;

/// An error of reading a model from a text or of writing it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// The text is not TOML, or a key is unknown, missing or of the wrong type.
    #[error("{0}")]
    Syntax(String),
    /// A newer version of this software wrote the text.
    #[error("schema {0}, but this version reads schema {MODEL_SCHEMA}; it was written by a newer version")]
    Newer(u32),
    /// An older version of this software wrote the text.
    #[error("schema {0}, but this version reads schema {MODEL_SCHEMA}; learn the model again with `pingmap learn`")]
    Older(u32),
    /// The sizes of links, shift and precision of a site prior do not match.
    #[error(
        "[site_prior]: expected {points} entries of shift and rows of precision; row n of precision must have n entries"
    )]
    UnevenSitePrior {
        /// Number of links.
        points: usize,
    },
    /// A link of a site prior has a wrong number of coordinates.
    #[error("[site_prior]: expected {expected} numbers for a link, found {found}")]
    LinkOfSitePrior {
        /// Number of coordinates of a link.
        expected: usize,
        /// Number of coordinates in the text.
        found: usize,
    },
    /// A term uses a column that the inputs do not have.
    #[error("kernel term {term}: unknown column {column:?}; expected one of {known}")]
    UnknownColumn {
        /// Number of the term, from 1.
        term: usize,
        /// Name of the column.
        column: String,
        /// Names of all valid columns.
        known: String,
    },
    /// A length-scale is missing or has another unit than its columns, or label columns have a length-scale.
    #[error("kernel term {term}: expected {expected}")]
    LengthScaleUnit {
        /// Number of the term, from 1.
        term: usize,
        /// Length-scale key that the columns need.
        expected: &'static str,
    },
    /// The number of length-scales of a term differs from its number of columns.
    #[error("kernel term {term}: {found} length-scales for {expected} columns; expected one for all or one for each")]
    LengthScales {
        /// Number of the term, from 1.
        term: usize,
        /// Number of columns.
        expected: usize,
        /// Number of length-scales.
        found: usize,
    },
    /// A reciprocal term changes when the ends are swapped.
    #[error(
        "kernel term {term}: reciprocal, but swapping the ends exchanges {column} ({length_scale} m) with {partner} ({})",
        partner_length_scale.map_or_else(|| "not among its columns".to_owned(), |length_scale| format!("{length_scale} m"))
    )]
    NotReciprocal {
        /// Number of the term, from 1.
        term: usize,
        /// Column of the term.
        column: String,
        /// Column that is exchanged with it.
        partner: String,
        /// Length-scale of `column`, in metres.
        length_scale: f64,
        /// Length-scale of `partner`, in metres. `None` if the term does not use that column.
        partner_length_scale: Option<f64>,
    },
    /// The parameters of a term are not valid.
    #[error("kernel term {term}: {source}")]
    Term {
        /// Number of the term, from 1.
        term: usize,
        /// Cause.
        source: dgpc::Error,
    },
    /// There is no kernel term, or the prior mean is not valid.
    #[error(transparent)]
    Prior(#[from] dgpc::Error),
    /// A number is out of bounds.
    #[error("{key} must be {expected}, found {value}")]
    OutOfRange {
        /// Key of the number.
        key: &'static str,
        /// Bounds of the number.
        expected: Bounds,
        /// Number in the text.
        value: f64,
    },
    /// The model cannot be represented in a file. Its chart origin may have a depth, or its kernel may use another
    /// reflection than swapping the ends. Its columns or numbers may also be out of bounds.
    #[error("this model cannot be represented in a file: {0}")]
    Unwritable(String),
    /// Only one of latitude and longitude is given.
    #[error("[chart]: expected latitude_deg and longitude_deg together, found one of them")]
    IncompleteOrigin,
    /// Both the position of (0, 0) and an EPSG code are given.
    #[error(
        "[chart]: expected the position of (0, 0) (latitude_deg and longitude_deg) or the reference system (epsg), found both"
    )]
    AmbiguousReference,
}

/// Returns `value` if it is within the bounds.
pub(crate) fn check_bounds(key: &'static str, bounds: Bounds, value: f64) -> Result<f64, ModelFileError> {
    bounds.check(value).ok_or(ModelFileError::OutOfRange { key, expected: bounds, value })
}
