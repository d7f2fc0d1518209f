//! Reflections: exchanges of input columns that make a kernel term reciprocal.

use crate::error::{Error, Result};
use crate::inputs::check_column;

/// An involution x → Rx of the inputs that exchanges columns or changes their sign. An example is the exchange of the
/// two ends of a link.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "Vec<Image>", into = "Vec<Image>")
)]
pub struct Reflection {
    images: Vec<Image>,
}

/// The source of one column of a reflected point: (Rx)_column = ± x_source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Image {
    /// The column of the reflected point.
    pub column: usize,
    /// The column of the original point from which the value comes.
    pub source: usize,
    /// Whether the value changes its sign.
    pub negated: bool,
}

impl Reflection {
    /// Creates the reflection that maps the given columns. All other columns stay as they are.
    ///
    /// # Errors
    /// * [`Error::RepeatedColumn`] if a column is named twice.
    /// * [`Error::NotAnInvolution`] if applying the reflection twice does not give the identity.
    /// * [`Error::OutOfRange`] for a column beyond [`crate::COLUMN_MAX`].
    pub fn new(images: Vec<Image>) -> Result<Self> {
        for (n, &Image { column, source, .. }) in images.iter().enumerate() {
            check_column(column)?;
            check_column(source)?;
            if images[..n].iter().any(|other| other.column == column) {
                return Err(Error::RepeatedColumn { what: "reflection", column });
            }
        }
        let reflection = Self { images };
        for &Image { column, source, negated } in &reflection.images {
            if reflection.image(source) != (column, negated) {
                return Err(Error::NotAnInvolution { column });
            }
        }
        Ok(reflection)
    }

    /// Creates the reflection that exchanges the columns of each pair: `swap(&[(0, 2), (1, 3)])` turns (a, b, c, d)
    /// into (c, d, a, b).
    ///
    /// # Errors
    /// As [`Reflection::new`].
    pub fn swap(pairs: &[(usize, usize)]) -> Result<Self> {
        let image = |column, source| Image { column, source, negated: false };
        Self::new(pairs.iter().flat_map(|&(a, b)| [image(a, b), image(b, a)]).collect())
    }

    /// Creates the reflection that changes the sign of the named columns.
    ///
    /// # Errors
    /// As [`Reflection::new`].
    pub fn negate(columns: &[usize]) -> Result<Self> {
        Self { images: Vec::new() }.and_negate(columns)
    }

    /// Returns the reflection that also changes the sign of other columns.
    ///
    /// # Errors
    /// As [`Reflection::new`], also for a column that the reflection exchanges already.
    pub fn and_negate(mut self, columns: &[usize]) -> Result<Self> {
        self.images.extend(columns.iter().map(|&column| Image { column, source: column, negated: true }));
        Self::new(self.images)
    }

    /// Returns the columns that the reflection changes, each with its source.
    pub fn images(&self) -> &[Image] {
        &self.images
    }

    /// Returns the source of `column`, and whether the value changes its sign.
    pub(super) fn image(&self, column: usize) -> (usize, bool) {
        let image = self.images.iter().find(|image| image.column == column);
        image.map_or((column, false), |image| (image.source, image.negated))
    }
}

impl TryFrom<Vec<Image>> for Reflection {
    type Error = Error;

    fn try_from(images: Vec<Image>) -> Result<Self> {
        Self::new(images)
    }
}

impl From<Reflection> for Vec<Image> {
    fn from(reflection: Reflection) -> Self {
        reflection.images
    }
}
