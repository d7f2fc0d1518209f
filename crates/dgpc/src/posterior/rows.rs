//! Rows of a posterior's support: events, and the inducing points of summaries.

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, multiply_columns, multiply_rows};
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// Consecutive rows of the support, with their parts of W and of R. With t = W k(support, x), the variance at x is
/// k(x, x) − ‖L_B⁻¹Rᵀt‖².
#[derive(Debug, Clone)]
pub(super) struct Segment {
    pub(super) first: usize,
    pub(super) part: Part,
}

#[derive(Debug, Clone)]
pub(super) enum Part {
    /// Events: W = I, R = Ω^½.
    Events(Vec<f64>),
    /// A summary's inducing points: W = L⁻¹, Ĝ = RRᵀ.
    Block { whitening: Cholesky, root: Matrix },
}

/// New rows for a posterior's support.
pub(super) struct NewRows {
    /// Number of rows before the new ones.
    pub(super) first: usize,
    pub(super) support: Inputs,
    pub(super) segments: Vec<Segment>,
    pub(super) shift: Vec<f64>,
    pub(super) jitter: f64,
}

impl NewRows {
    /// Lays out the events first and then every summary's inducing points, as rows from `first` on. Returns `None` if
    /// there are neither events nor summaries.
    pub(super) fn lay_out(
        prior: &Prior,
        first: usize,
        events: Option<&Sites>,
        summaries: &[&Summary],
    ) -> Result<Option<Self>> {
        let of_events = events.map(|events| events.inputs().dimension());
        let Some(dimension) = of_events.or(summaries.first().map(|summary| summary.inducing_points().dimension()))
        else {
            return Ok(None);
        };
        let mut new =
            Self { first, support: Inputs::empty(dimension), segments: Vec::new(), shift: Vec::new(), jitter: 0.0 };
        if let Some(events) = events.filter(|events| !events.is_empty()) {
            let roots = events.omega().iter().map(|omega| omega.sqrt()).collect();
            new.segments.push(Segment { first, part: Part::Events(roots) });
            new.support.append(events.inputs())?;
            new.shift = events.shift(prior.mean())?;
        }
        for summary in summaries {
            if summary.prior() != prior {
                return Err(Error::DifferentPriors { what: "a posterior and a summary" });
            }
            let part = Part::Block { whitening: summary.cholesky().clone(), root: summary.root()? };
            new.segments.push(Segment { first: first + new.support.len(), part });
            new.support.append(summary.inducing_points())?;
            new.shift.extend_from_slice(summary.whitened_shift());
            new.jitter = new.jitter.max(summary.jitter());
        }
        Ok(Some(new).filter(|new| !new.support.is_empty()))
    }

    /// Returns I + RᵀTR among the new rows, from T among them (m×m).
    pub(super) fn corner(&self, mut among: Matrix) -> Matrix {
        rotate(&self.segments, self.first, &mut among);
        rotate_columns(&self.segments, self.first, &mut among);
        among.add_to_diagonal(1.0);
        among
    }
}

/// Replaces X by WX. The rows of X are the rows of the support from `offset` on.
pub(super) fn whiten(segments: &[Segment], offset: usize, matrix: &mut Matrix) {
    for Segment { first, part } in segments {
        if let Part::Block { whitening, .. } = part {
            whitening.solve_lower_rows(matrix, first - offset);
        }
    }
}

/// Replaces X by RᵀX, with rows as in [`whiten`].
pub(super) fn rotate(segments: &[Segment], offset: usize, matrix: &mut Matrix) {
    for Segment { first, part } in segments {
        let first = first - offset;
        match part {
            Part::Block { root, .. } => multiply_rows(root.t(), matrix, first),
            Part::Events(roots) => {
                for column in 0..matrix.columns() {
                    let entries = &mut matrix.column_mut(column)[first..first + roots.len()];
                    entries.iter_mut().zip(roots).for_each(|(entry, root)| *entry *= root);
                }
            }
        }
    }
}

/// Replaces X by XWᵀ. The columns of X are the rows of the support from `offset` on.
pub(super) fn whiten_columns(segments: &[Segment], offset: usize, matrix: &mut Matrix) {
    for Segment { first, part } in segments {
        if let Part::Block { whitening, .. } = part {
            whitening.solve_rows_in_columns(matrix, first - offset);
        }
    }
}

/// Replaces X by XR, with columns as in [`whiten_columns`].
pub(super) fn rotate_columns(segments: &[Segment], offset: usize, matrix: &mut Matrix) {
    for Segment { first, part } in segments {
        let first = first - offset;
        match part {
            Part::Block { root, .. } => multiply_columns(matrix, first, root.view()),
            Part::Events(roots) => {
                for (event, root) in roots.iter().enumerate() {
                    matrix.column_mut(first + event).iter_mut().for_each(|entry| *entry *= root);
                }
            }
        }
    }
}

/// Replaces x by Rᵀx, with rows as in [`whiten`].
pub(super) fn rotate_vector(segments: &[Segment], offset: usize, x: &mut [f64]) {
    for Segment { first, part } in segments {
        let x = &mut x[first - offset..];
        match part {
            Part::Events(roots) => x.iter_mut().zip(roots).for_each(|(entry, root)| *entry *= root),
            Part::Block { root, .. } => {
                let rotated = root.transposed_times(&x[..root.rows()]);
                x[..root.rows()].copy_from_slice(&rotated);
            }
        }
    }
}
