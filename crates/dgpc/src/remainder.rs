//! The covariance that remains after some points are known, and the reduction by a further point.
//!
//! The covariance K itself is not changed: K̃ = K − UUᵀ, with a column of U for every chosen point. A choice of m of N
//! points costs O(Nm²) in addition to the preparation of K. A choice can be undone.

use crate::linalg::{Matrix, add_scaled, dot, multiply_vector, squared_norm};

/// K̃, represented by its diagonal and the columns of U.
#[derive(Clone)]
pub(crate) struct Remainder<'a> {
    gram: &'a Matrix,
    columns: Vec<Vec<f64>>,
    variance: Vec<f64>,
}

impl<'a> Remainder<'a> {
    pub(crate) fn new(gram: &'a Matrix) -> Self {
        Self { gram, columns: Vec::new(), variance: gram.diagonal() }
    }

    /// Returns diag K̃.
    pub(crate) fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// Returns tr K̃.
    pub(crate) fn trace(&self) -> f64 {
        self.variance.iter().map(|variance| variance.max(0.0)).sum()
    }

    /// Removes `share` of the variance at a point, and the covariances that go with it. The variance there must be
    /// positive. O(Nm).
    pub(crate) fn take(&mut self, point: usize, share: f64) {
        let column = self.scaled(point, share, self.gram.column(point), &self.columns);
        self.variance.iter_mut().zip(&column).for_each(|(variance, u)| *variance -= u * u);
        self.columns.push(column);
    }

    /// Returns √(share/k̃_pp) (whole_p − Σⱼ u_jp partsⱼ). With `whole` a column of K and `parts` the columns of U, this
    /// is the new column of U.
    fn scaled(&self, point: usize, share: f64, whole: &[f64], parts: &[Vec<f64>]) -> Vec<f64> {
        let mut column = whole.to_vec();
        for (taken, part) in self.columns.iter().zip(parts) {
            add_scaled(-taken[point], part, &mut column);
        }
        let factor = (share / self.variance[point]).sqrt();
        column.iter_mut().for_each(|entry| *entry *= factor);
        column
    }
}

/// K̃, with the squared norms of its columns.
#[derive(Clone)]
pub(crate) struct Reductions<'a> {
    remainder: Remainder<'a>,
    /// K², computed if many points are to be chosen.
    squared: Option<&'a Matrix>,
    /// KU.
    images: Vec<Vec<f64>>,
    /// ‖K̃_z‖² for every z.
    explained: Vec<f64>,
}

/// A saved state of [`Reductions`].
pub(crate) struct Mark {
    taken: usize,
    variance: Vec<f64>,
    explained: Vec<f64>,
}

impl<'a> Reductions<'a> {
    /// Starts from K. Choosing a point costs O(Nm) if K² is given, and O(N²) otherwise.
    pub(crate) fn new(gram: &'a Matrix, squared: Option<&'a Matrix>) -> Self {
        let explained = match squared {
            Some(squared) => squared.diagonal(),
            None => (0..gram.columns()).map(|column| squared_norm(gram.column(column))).collect(),
        };
        Self { remainder: Remainder::new(gram), squared, images: Vec::new(), explained }
    }

    /// Returns diag K̃.
    pub(crate) fn variance(&self) -> &[f64] {
        self.remainder.variance()
    }

    /// Returns tr K̃.
    pub(crate) fn trace(&self) -> f64 {
        self.remainder.trace()
    }

    /// Returns the reduction of the trace if all variance at a point were removed: ‖K̃_z‖²/k̃_zz.
    pub(crate) fn reduction(&self, point: usize) -> f64 {
        self.explained[point].max(0.0) / self.remainder.variance[point]
    }

    /// Removes variance as [`Remainder::take`] does, and updates the column norms.
    pub(crate) fn take(&mut self, point: usize, share: f64) {
        // K times the new column of U, computed before that column is appended.
        let image =
            self.squared.map(|squared| self.remainder.scaled(point, share, squared.column(point), &self.images));
        self.remainder.take(point, share);
        let Some((column, before)) = self.remainder.columns.split_last() else { return };
        let image = image.unwrap_or_else(|| {
            let mut image = vec![0.0; column.len()];
            multiply_vector(self.remainder.gram.view(), column, &mut image);
            image
        });
        // K̃u with the K̃ before this step. Then ‖K̃_z − u_z u‖² = ‖K̃_z‖² − 2u_z(K̃u)_z + u_z²‖u‖².
        let mut remaining = image.clone();
        for earlier in before {
            add_scaled(-dot(earlier, column), earlier, &mut remaining);
        }
        let norm = squared_norm(column);
        for ((explained, u), remaining) in self.explained.iter_mut().zip(column).zip(&remaining) {
            *explained -= u * (2.0 * remaining - u * norm);
        }
        self.images.push(image);
    }

    /// Returns the current state, for [`Reductions::back_to`].
    pub(crate) fn mark(&self) -> Mark {
        Mark { taken: self.images.len(), variance: self.remainder.variance.clone(), explained: self.explained.clone() }
    }

    /// Restores a saved state: undoes all choices after it.
    pub(crate) fn back_to(&mut self, mark: &Mark) {
        self.images.truncate(mark.taken);
        self.remainder.columns.truncate(mark.taken);
        self.remainder.variance.copy_from_slice(&mark.variance);
        self.explained.copy_from_slice(&mark.explained);
    }
}
