//! Where events happened: N points of d coordinates.

use crate::error::{Error, Result, same_size};

/// N finite points of dimension d, stored row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct Inputs {
    values: Vec<f64>,
    dimension: usize,
}

impl Inputs {
    /// Takes `values` of length N·d as N rows of `dimension` coordinates.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for dimension 0, [`Error::SizeMismatch`] when the last row is incomplete,
    /// [`Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn new(values: Vec<f64>, dimension: usize) -> Result<Self> {
        if dimension == 0 {
            return Err(Error::OutOfRange { what: "input dimension", expected: "at least 1", value: 0.0 });
        }
        same_size("numbers in whole rows of inputs", values.len() / dimension * dimension, values.len())?;
        if let Some(bad) = values.iter().position(|v| !v.is_finite()) {
            let (row, column) = (bad / dimension, bad % dimension);
            return Err(Error::NotFinite { what: "input", row, column, value: values[bad] });
        }
        Ok(Self { values, dimension })
    }

    /// Takes one array a row. See [`Inputs::new`].
    ///
    /// # Errors
    /// [`Error::NotFinite`] with row and column of the first NaN or infinity.
    pub fn from_rows<const D: usize>(rows: &[[f64; D]]) -> Result<Self> {
        Self::new(rows.iter().flatten().copied().collect(), D)
    }

    /// No points of dimension `dimension` (at least 1).
    pub fn empty(dimension: usize) -> Self {
        Self { values: Vec::new(), dimension: dimension.max(1) }
    }

    /// Number of points N.
    pub fn len(&self) -> usize {
        self.values.len() / self.dimension
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Number of coordinates d.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// Point `n`, d coordinates.
    pub fn row(&self, n: usize) -> &[f64] {
        &self.values[n * self.dimension..(n + 1) * self.dimension]
    }

    /// All points in order.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[f64]> {
        self.values.chunks_exact(self.dimension)
    }

    /// The points at `indices`, in that order.
    pub fn select(&self, indices: &[usize]) -> Self {
        let values = indices.iter().flat_map(|&n| self.row(n)).copied().collect();
        Self { values, dimension: self.dimension }
    }

    /// Points `range`, in order.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Self {
        let values = self.values[range.start * self.dimension..range.end * self.dimension].to_vec();
        Self { values, dimension: self.dimension }
    }

    /// Some columns of every point.
    ///
    /// # Panics
    /// When the range is empty or leaves the columns.
    pub fn columns(&self, columns: std::ops::Range<usize>) -> Self {
        assert!(!columns.is_empty(), "points need at least one column");
        let dimension = columns.len();
        let values = self.rows().flat_map(|row| &row[columns.clone()]).copied().collect();
        Self { values, dimension }
    }

    /// Appends the points of `other`.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] when the dimensions differ.
    pub fn append(&mut self, other: &Inputs) -> Result<()> {
        same_size("input dimension", self.dimension, other.dimension)?;
        self.values.extend_from_slice(&other.values);
        Ok(())
    }
}
