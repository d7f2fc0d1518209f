//! What makes no model file.

use crate::bounds::Bounds;
use crate::model::MODEL_SCHEMA;

/// Why a text is not a model, or a model no text.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// Not TOML, or a key that is unknown, missing or of the wrong kind.
    #[error("{0}")]
    Syntax(String),
    /// Written by a newer version of this software.
    #[error("schema {found}, but this version reads schema {MODEL_SCHEMA}; it was written by a newer version")]
    Newer {
        /// The schema of the text.
        found: u32,
    },
    /// Links, shift and precision of a place that do not go together.
    #[error(
        "place: expected {points} entries of shift and rows of precision, the first of one entry, each of one more"
    )]
    UnevenPlace {
        /// How many links there are.
        points: usize,
    },
    /// A link of a place without just its coordinates.
    #[error("place: expected {expected} numbers for a link, found {found}")]
    LinkOfPlace {
        /// How many make a link.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A term names a column that links do not have.
    #[error("kernel term {term}: unknown column {column:?}; expected one of {known}")]
    UnknownColumn {
        /// The number of the term, from 1.
        term: usize,
        /// The name.
        column: String,
        /// The names that there are.
        known: String,
    },
    /// A length-scale in another unit than its columns have, or none, or one of labels.
    #[error("kernel term {term}: expected {expected}")]
    LengthScaleUnit {
        /// Which, counted from 1.
        term: usize,
        /// What goes with its columns.
        expected: &'static str,
    },
    /// A term has another number of length-scales than columns.
    #[error("kernel term {term}: {found} length-scales for {expected} columns; expected one for all or one for each")]
    LengthScales {
        /// The number of the term, from 1.
        term: usize,
        /// How many columns there are.
        expected: usize,
        /// How many length-scales.
        found: usize,
    },
    /// A reciprocal term that would not be the same after swapping the ends.
    #[error(
        "kernel term {term}: reciprocal, but swapping the ends exchanges {column} ({length_scale} m) with {partner} ({})",
        partner_length_scale.map_or_else(|| "not among its columns".to_owned(), |length_scale| format!("{length_scale} m"))
    )]
    NotReciprocal {
        /// The number of the term, from 1.
        term: usize,
        /// A column of the term.
        column: String,
        /// The column it is exchanged with.
        partner: String,
        /// The length-scale of the one, in metres.
        length_scale: f64,
        /// That of the other; `None` where it is not among the term's columns.
        partner_length_scale: Option<f64>,
    },
    /// The numbers of a term make no kernel.
    #[error("kernel term {term}: {source}")]
    Term {
        /// The number of the term, from 1.
        term: usize,
        /// Why.
        source: dgpc::Error,
    },
    /// There is no kernel term, or the prior mean makes no sense.
    #[error(transparent)]
    Prior(#[from] dgpc::Error),
    /// A number outside its domain.
    #[error("{key} must be {expected}, found {value}")]
    OutOfRange {
        /// The key.
        key: &'static str,
        /// The domain.
        expected: Bounds,
        /// The number.
        value: f64,
    },
    /// A model that its file would not say as it is: a chart whose origin has a depth, another reflection than swapping
    /// the ends, columns or numbers beyond those that files may hold.
    #[error("the file of this model would not say the same: {0}")]
    Unwritable(String),
    /// Latitude without longitude, or the other way round.
    #[error("chart: latitude_deg and longitude_deg go together")]
    HalfAPlace,
    /// Both a place of (0, 0) and a reference system.
    #[error(
        "[chart] has latitude_deg and longitude_deg, and epsg; expected the place of (0, 0) or the system, not both"
    )]
    TwoPlaces,
}
