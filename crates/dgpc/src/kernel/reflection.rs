//! What makes a kernel term reciprocal: an exchange of input columns.

use crate::error::{Error, Result};
use crate::inputs::check_column;

/// An involution x → Rx of the inputs that exchanges columns or turns their sign, such as swapping the two ends of a
/// link.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "Vec<Image>", into = "Vec<Image>")
)]
pub struct Reflection {
    images: Vec<Image>,
}

/// Where one column of a reflected point comes from: (Rx)_column = ± x_source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Image {
    /// The column.
    pub column: usize,
    /// The column that lands in it.
    pub source: usize,
    /// Whether its sign turns on the way.
    pub negated: bool,
}

impl Reflection {
    /// The reflection that maps these columns as they say and leaves all others as they are.
    ///
    /// # Errors
    /// [`Error::RepeatedColumn`] when a column is named twice, [`Error::NotAnInvolution`] where doing it twice would
    /// not lead back, [`Error::OutOfRange`] for a column beyond [`crate::COLUMN_MAX`].
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

    /// Exchanges the columns of each pair: `swap(&[(0, 2), (1, 3)])` turns (a, b, c, d) into (c, d, a, b).
    ///
    /// # Errors
    /// As [`Reflection::new`].
    pub fn swap(pairs: &[(usize, usize)]) -> Result<Self> {
        let image = |column, source| Image { column, source, negated: false };
        Self::new(pairs.iter().flat_map(|&(a, b)| [image(a, b), image(b, a)]).collect())
    }

    /// Turns the sign of the named columns.
    ///
    /// # Errors
    /// As [`Reflection::new`].
    pub fn negate(columns: &[usize]) -> Result<Self> {
        Self { images: Vec::new() }.and_negate(columns)
    }

    /// The same reflection that also turns the sign of other columns.
    ///
    /// # Errors
    /// As [`Reflection::new`], also for a column that is exchanged already.
    pub fn and_negate(mut self, columns: &[usize]) -> Result<Self> {
        self.images.extend(columns.iter().map(|&column| Image { column, source: column, negated: true }));
        Self::new(self.images)
    }

    /// The columns that it changes, and what lands in each.
    pub fn images(&self) -> &[Image] {
        &self.images
    }

    /// The column that lands in `column`, and whether its sign turns.
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
