//! The matrix type, and matrix products.

use std::ops::{Index, IndexMut};

use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::panels::{PANELS_MAX, add_symmetric_product_by_panels, columns_mut};
use super::wide::{AddScaled, Dot, widest};
use crate::error::{Error, Place, Result};

/// A dense matrix of `f64`, stored column by column.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Matrix(pub(super) Mat<f64>);

/// A borrowed, possibly transposed matrix.
pub(crate) type View<'a> = MatRef<'a, f64>;

impl Matrix {
    /// Returns the rows × columns matrix of zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self(Mat::zeros(rows, columns))
    }

    /// Returns the rows × columns matrix with the entries `entry(row, column)`.
    pub fn from_fn(rows: usize, columns: usize, entry: impl FnMut(usize, usize) -> f64) -> Self {
        Self(Mat::from_fn(rows, columns, entry))
    }

    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.0.nrows()
    }

    /// Returns the number of columns.
    pub fn columns(&self) -> usize {
        self.0.ncols()
    }

    /// Returns one column.
    pub fn column(&self, column: usize) -> &[f64] {
        self.0.col_as_slice(column)
    }

    /// Returns one column for writing.
    pub fn column_mut(&mut self, column: usize) -> &mut [f64] {
        self.0.col_as_slice_mut(column)
    }

    /// Returns all columns as separate mutable slices.
    pub(crate) fn split_columns(&mut self) -> Vec<&mut [f64]> {
        columns_mut(self.0.as_mut())
    }

    /// Returns the diagonal.
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.rows().min(self.columns())).map(|i| self[(i, i)]).collect()
    }

    /// Returns an iterator over all rows × columns entries, column by column.
    pub fn entries(&self) -> impl Iterator<Item = f64> {
        (0..self.columns()).flat_map(|column| self.column(column)).copied()
    }

    /// Checks that every entry is finite.
    pub(crate) fn check_finite(&self, what: &'static str) -> Result<()> {
        match self.entries().position(|entry| !entry.is_finite()) {
            Some(at) => {
                let (row, column) = (at % self.rows(), at / self.rows());
                Err(Error::NotFinite { what, place: Place::Entry { row, column }, value: self[(row, column)] })
            }
            None => Ok(()),
        }
    }

    /// Adds a number to every entry of the diagonal.
    pub(crate) fn add_to_diagonal(&mut self, value: f64) {
        (0..self.rows().min(self.columns())).for_each(|i| self[(i, i)] += value);
    }

    /// Returns a transposed copy.
    pub fn transposed(&self) -> Self {
        Self(self.0.transpose().to_owned())
    }

    pub(crate) fn view(&self) -> View<'_> {
        self.0.as_ref()
    }

    pub(crate) fn t(&self) -> View<'_> {
        self.0.transpose()
    }

    pub(crate) fn copy_from(&mut self, other: &Matrix) {
        (0..self.columns()).for_each(|column| self.column_mut(column).copy_from_slice(other.column(column)));
    }

    /// Returns the product of the matrix and a vector. O(rows × columns).
    pub(crate) fn times(&self, vector: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.rows()];
        multiply_vector(self.view(), vector, &mut out);
        out
    }

    /// Returns the product of the transposed matrix and a vector. O(rows × columns).
    pub(crate) fn transposed_times(&self, vector: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; self.columns()];
        multiply_vector(self.t(), vector, &mut out);
        out
    }

    /// Sets the size to rows × columns. The entries are unspecified afterwards. Allocates only if the rows or the
    /// columns exceed the capacity.
    pub(crate) fn resize(&mut self, rows: usize, columns: usize) {
        self.0.resize_with(rows, columns, |_, _| 0.0);
    }

    /// Keeps the first columns.
    pub(crate) fn truncate_columns(&mut self, columns: usize) {
        self.0.truncate(self.rows(), columns);
    }

    /// Appends the columns of a matrix with as many rows. The storage grows in steps of an eighth to a quarter, so that
    /// existing entries are rarely moved.
    pub(crate) fn append_columns(&mut self, other: &Matrix) {
        let (old, columns) = (self.columns(), self.columns() + other.columns());
        // Reserving room that exists already has no effect.
        let step = (columns.next_power_of_two() / 8).max(16);
        self.0.reserve(other.rows(), columns.next_multiple_of(step));
        self.0.resize_with(other.rows(), columns, |row, column| other[(row, column - old)]);
    }

    /// Enlarges a square matrix. New entries are `entry(row, column)`. Existing entries are moved only if the storage
    /// must be enlarged, which then reserves a sixteenth more than needed.
    pub(crate) fn grow(&mut self, size: usize, entry: impl FnMut(usize, usize) -> f64) {
        // The column stride is the number of rows that fit. Reserving room that exists already has no effect.
        let rows = self.0.col_stride().unsigned_abs();
        let room = if rows < size { (size + size / 16).next_multiple_of(16) } else { rows };
        self.0.reserve(room, room);
        self.0.resize_with(size, size, entry);
    }

    /// Adds `factor` · `other`.
    pub(crate) fn add_scaled(&mut self, factor: f64, other: &Matrix) {
        for column in 0..self.columns() {
            add_scaled(factor, other.column(column), self.column_mut(column));
        }
    }

    /// Copies the lower triangle to the upper triangle.
    pub(crate) fn mirror_lower(&mut self) {
        // Tiles keep the entries that are read across columns in the first-level cache.
        const TILE: usize = 32;
        for first_column in (0..self.columns()).step_by(TILE) {
            for first_row in (0..=first_column).step_by(TILE) {
                for column in first_column..(first_column + TILE).min(self.columns()) {
                    for row in first_row..(first_row + TILE).min(column) {
                        self[(row, column)] = self[(column, row)];
                    }
                }
            }
        }
    }

    /// Replaces A by ½(A + Aᵀ), to remove rounding errors from a matrix that is symmetric by definition.
    pub(crate) fn symmetrise(&mut self) {
        for column in 1..self.columns() {
            for row in 0..column {
                let mean = 0.5 * (self[(row, column)] + self[(column, row)]);
                self[(row, column)] = mean;
                self[(column, row)] = mean;
            }
        }
    }
}

/// The serialised form of [`Matrix`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    rows: usize,
    columns: usize,
    /// Entries column by column.
    entries: Vec<f64>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Matrix {
    type Error = Error;

    fn try_from(Parts { rows, columns, entries }: Parts) -> Result<Self> {
        crate::error::same_size("entries of a matrix", rows.saturating_mul(columns), entries.len())?;
        Ok(Self::from_fn(rows, columns, |row, column| entries[column * rows + row]))
    }
}

#[cfg(feature = "serde")]
impl From<Matrix> for Parts {
    fn from(matrix: Matrix) -> Self {
        Self { rows: matrix.rows(), columns: matrix.columns(), entries: matrix.entries().collect() }
    }
}

/// Returns the matrix without rows and columns.
impl Default for Matrix {
    fn default() -> Self {
        Self(Mat::new())
    }
}

impl Index<(usize, usize)> for Matrix {
    type Output = f64;

    fn index(&self, (row, column): (usize, usize)) -> &f64 {
        &self.0[(row, column)]
    }
}

impl IndexMut<(usize, usize)> for Matrix {
    fn index_mut(&mut self, (row, column): (usize, usize)) -> &mut f64 {
        &mut self.0[(row, column)]
    }
}

/// Returns aᵀb.
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    widest(Dot(a, b))
}

/// Replaces y by y + factor·x.
pub(crate) fn add_scaled(factor: f64, x: &[f64], y: &mut [f64]) {
    widest(AddScaled(factor, x, y));
}

/// Returns ‖a‖².
pub(crate) fn squared_norm(a: &[f64]) -> f64 {
    dot(a, a)
}

/// Writes A·B to `out`.
pub(crate) fn multiply(a: View<'_>, b: View<'_>, out: &mut Matrix) {
    matmul(out.0.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
}

/// Returns A·B.
pub(crate) fn product(a: View<'_>, b: View<'_>) -> Matrix {
    let mut out = Matrix::zeros(a.nrows(), b.ncols());
    multiply(a, b, &mut out);
    out
}

/// Adds `factor`·A·Aᵀ to both triangles of `out`, with half the work of a general product.
pub(crate) fn add_symmetric_product(factor: f64, a: View<'_>, out: &mut Matrix) {
    add_symmetric_product_lower(factor, a, out);
    out.mirror_lower();
}

/// Adds the lower triangle of `factor`·A·Aᵀ to that of `out`. The upper triangle of `out` is unspecified afterwards.
pub(crate) fn add_symmetric_product_lower(factor: f64, a: View<'_>, out: &mut Matrix) {
    // Panels of a matrix stored by rows would have to be rearranged first.
    if a.nrows() <= PANELS_MAX && a.row_stride() == 1 {
        return add_symmetric_product_by_panels(factor, a, out.0.as_mut());
    }
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        a,
        BlockStructure::Rectangular,
        a.transpose(),
        BlockStructure::Rectangular,
        factor,
        Par::Seq,
    );
}

/// Writes L·A to `out` for a lower triangular L, with half the work of a general product.
pub(crate) fn multiply_lower(lower: &Matrix, a: View<'_>, out: &mut Matrix) {
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::Rectangular,
        Accum::Replace,
        lower.view(),
        BlockStructure::TriangularLower,
        a,
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
}

/// Writes the product of two lower triangular matrices to the lower triangle of `out`. O(n³/3).
pub(crate) fn multiply_lowers(a: &Matrix, b: &Matrix, out: &mut Matrix) {
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Replace,
        a.view(),
        BlockStructure::TriangularLower,
        b.view(),
        BlockStructure::TriangularLower,
        1.0,
        Par::Seq,
    );
}

/// Writes A·Lᵀ to `out` for a lower triangular L. The product must be symmetric; only its lower triangle is computed.
pub(crate) fn multiply_to_lower(a: &Matrix, lower: &Matrix, out: &mut Matrix) {
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Replace,
        a.view(),
        BlockStructure::Rectangular,
        lower.t(),
        BlockStructure::TriangularUpper,
        1.0,
        Par::Seq,
    );
    out.mirror_lower();
}

/// Writes LᵀL to the lower triangle of `out` for a lower triangular L. O(n³/3).
pub(crate) fn lower_gram(lower: &Matrix, out: &mut Matrix) {
    triangular::matmul(
        out.0.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Replace,
        lower.t(),
        BlockStructure::TriangularUpper,
        lower.view(),
        BlockStructure::TriangularLower,
        1.0,
        Par::Seq,
    );
}

/// Writes A·x to `out`.
pub(crate) fn multiply_vector(a: View<'_>, x: &[f64], out: &mut [f64]) {
    let x = MatRef::from_column_major_slice(x, a.ncols(), 1);
    let out = MatMut::from_column_major_slice_mut(out, a.nrows(), 1);
    matmul(out, Accum::Replace, a, x, 1.0, Par::Seq);
}

/// Multiplies the rows from `first` on by a square A from the left. A determines the number of rows.
pub(crate) fn multiply_rows(a: View<'_>, x: &mut Matrix, first: usize) {
    let old = x.0.as_ref().subrows(first, a.nrows()).to_owned();
    matmul(x.0.as_mut().subrows_mut(first, a.nrows()), Accum::Replace, a, old.as_ref(), 1.0, Par::Seq);
}

/// Multiplies the columns from `first` on by a square A from the right. A determines the number of columns.
pub(crate) fn multiply_columns(x: &mut Matrix, first: usize, a: View<'_>) {
    let old = x.0.as_ref().subcols(first, a.nrows()).to_owned();
    matmul(x.0.as_mut().subcols_mut(first, a.nrows()), Accum::Replace, old.as_ref(), a, 1.0, Par::Seq);
}
