//! What is left of a covariance as points of it become known, one after the other, and what one more would take away.
//!
//! The covariance K itself stays as it is: K̃ = K − UUᵀ, a column of U for every point taken. So a choice of m of N points
//! costs O(Nm²) beside what is done with K once, and what was taken can be given back.

use crate::linalg::{Matrix, add_scaled, dot, multiply_vector, squared_norm};

/// K̃, by its diagonal and the columns of U.
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

    /// diag K̃.
    pub(crate) fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// tr K̃.
    pub(crate) fn trace(&self) -> f64 {
        self.variance.iter().map(|variance| variance.max(0.0)).sum()
    }

    /// Takes `share` of the variance at a point away, which is positive there, and all that goes with it. O(Nm).
    pub(crate) fn take(&mut self, point: usize, share: f64) {
        let column = self.scaled(point, share, self.gram.column(point), &self.columns);
        self.variance.iter_mut().zip(&column).for_each(|(variance, u)| *variance -= u * u);
        self.columns.push(column);
    }

    /// √(share/k̃_pp) (whole_p − Σⱼ u_jp partsⱼ): the new column of U when `whole` is that of K and the parts those of U.
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

/// K̃, and the squared norms of its columns.
#[derive(Clone)]
pub(crate) struct Reductions<'a> {
    left: Remainder<'a>,
    /// K², where many points are taken.
    squared: Option<&'a Matrix>,
    /// KU.
    images: Vec<Vec<f64>>,
    /// ‖K̃_z‖² for every z.
    explained: Vec<f64>,
}

/// A state to go back to.
pub(crate) struct Mark {
    taken: usize,
    variance: Vec<f64>,
    explained: Vec<f64>,
}

impl<'a> Reductions<'a> {
    /// With K² a point costs O(Nm), without it O(N²).
    pub(crate) fn new(gram: &'a Matrix, squared: Option<&'a Matrix>) -> Self {
        let explained = match squared {
            Some(squared) => squared.diagonal(),
            None => (0..gram.columns()).map(|column| squared_norm(gram.column(column))).collect(),
        };
        Self { left: Remainder::new(gram), squared, images: Vec::new(), explained }
    }

    /// diag K̃.
    pub(crate) fn variance(&self) -> &[f64] {
        self.left.variance()
    }

    /// tr K̃.
    pub(crate) fn trace(&self) -> f64 {
        self.left.trace()
    }

    /// By how much the trace would fall if all variance at a point were taken away: ‖K̃_z‖²/k̃_zz.
    pub(crate) fn reduction(&self, point: usize) -> f64 {
        self.explained[point].max(0.0) / self.left.variance[point]
    }

    /// As [`Remainder::take`].
    pub(crate) fn take(&mut self, point: usize, share: f64) {
        // K times the new column of U, before that column is there.
        let image = self.squared.map(|squared| self.left.scaled(point, share, squared.column(point), &self.images));
        self.left.take(point, share);
        let Some((column, before)) = self.left.columns.split_last() else { return };
        let image = image.unwrap_or_else(|| {
            let mut image = vec![0.0; column.len()];
            multiply_vector(self.left.gram.view(), column, &mut image);
            image
        });
        // K̃u with K̃ as it was, after which ‖K̃_z − u_z u‖² = ‖K̃_z‖² − 2u_z(K̃u)_z + u_z²‖u‖².
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

    /// Where things stand.
    pub(crate) fn mark(&self) -> Mark {
        Mark { taken: self.images.len(), variance: self.left.variance.clone(), explained: self.explained.clone() }
    }

    /// Gives back what was taken since.
    pub(crate) fn back_to(&mut self, mark: &Mark) {
        self.images.truncate(mark.taken);
        self.left.columns.truncate(mark.taken);
        self.left.variance.copy_from_slice(&mark.variance);
        self.explained.copy_from_slice(&mark.explained);
    }
}
