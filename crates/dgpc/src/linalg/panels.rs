//! Solves and symmetric products by panels of a few columns.
//!
//! Products do the work. They are fastest where their right side has so few columns that nothing is rearranged first,
//! which halving a triangle again and again never gives them.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::wide::{MultiplyAdd, Wide, widest};

/// Columns of such a right side.
const PANEL: usize = 8;

/// Rows of a panel that are worked on at a time.
const LANES: usize = 4;

/// Columns that panels are taken from one after the other; with a few hundred rows they stay in the second-level cache.
const STRETCH: usize = 256;

/// Rows up to which a symmetric product goes panel by panel. Beyond, halves are large enough.
pub(super) const PANELS_MAX: usize = 256;

/// Writes KL⁻ᵀ: solves for every row of K. Where L has hundreds of rows it should be a transposed view, so that each of them
/// lies together in memory. O(n² rows).
pub(super) fn solve_rows(lower: MatRef<'_, f64>, k: MatRef<'_, f64>, mut out: MatMut<'_, f64>) {
    let size = lower.nrows();
    for first in (0..size).step_by(STRETCH) {
        let end = size.min(first + STRETCH);
        let (solved, mut stretch) = out.as_mut().subcols_mut(0, end).split_at_col_mut(first);
        // `out` holds what solved columns take off, until panel by panel it becomes what is left of K.
        let mut accum = Accum::Replace;
        if first > 0 {
            matmul(stretch.as_mut(), accum, solved.as_ref(), rows(lower, first..end, 0..first), 1.0, Par::Seq);
            accum = Accum::Add;
        }
        for own in (first..end).step_by(PANEL) {
            let panel = own..end.min(own + PANEL);
            let (solved, mut taken) = stretch.as_mut().subcols_mut(0, panel.end - first).split_at_col_mut(own - first);
            if own == 0 {
                taken.fill(0.0);
            } else if own > first {
                matmul(taken.as_mut(), accum, solved.as_ref(), rows(lower, panel.clone(), first..own), 1.0, Par::Seq);
            }
            let lower = lower.submatrix(own, own, panel.len(), panel.len());
            let columns = panel.zip(taken.col_iter_mut());
            let columns = columns.map(|(column, x)| {
                let x = x.try_as_col_major_mut().expect(GAPLESS).as_slice_mut();
                (k.col(column).try_as_col_major().expect(GAPLESS).as_slice(), x)
            });
            widest(SolvePanel { lower, columns: columns.collect() });
        }
    }
}

const GAPLESS: &str = "columns without gaps";

/// Some rows of L, as the right side of a product.
fn rows(lower: MatRef<'_, f64>, rows: Range<usize>, columns: Range<usize>) -> MatRef<'_, f64> {
    lower.submatrix(rows.start, columns.start, rows.len(), columns.len()).transpose()
}

/// X ← (K − X)L⁻ᵀ of a few columns.
struct SolvePanel<'a> {
    lower: MatRef<'a, f64>,
    columns: Vec<(&'a [f64], &'a mut [f64])>,
}

impl Wide for SolvePanel<'_> {
    type Output = ();

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) {
        let mut factors = [[0.0; PANEL]; PANEL];
        for (own, factors) in factors[..self.columns.len()].iter_mut().enumerate() {
            (0..own).for_each(|other| factors[other] = -self.lower[(own, other)]);
            factors[own] = self.lower[(own, own)].recip();
        }
        let mut wholes: [(&[[f64; LANES]], &mut [[f64; LANES]]); PANEL] = std::array::from_fn(|_| Default::default());
        let mut rests = Vec::new();
        for (whole, (k, x)) in wholes.iter_mut().zip(self.columns) {
            let ((k, k_rest), (x, x_rest)) = (k.as_chunks::<LANES>(), x.as_chunks_mut::<LANES>());
            *whole = (k, x);
            rests.push((k_rest, x_rest));
        }
        for at in 0..wholes[0].0.len() {
            let mut x = [[0.0; LANES]; PANEL];
            for (x, (k, taken)) in x.iter_mut().zip(&wholes) {
                if let (Some(k), Some(taken)) = (k.get(at), taken.get(at)) {
                    *x = std::array::from_fn(|lane| k[lane] - taken[lane]);
                }
            }
            solve_few::<M, LANES>(&factors, &mut x);
            for (x, (_, out)) in x.iter().zip(&mut wholes) {
                if let Some(out) = out.get_mut(at) {
                    *out = *x;
                }
            }
        }
        for at in 0..rests[0].0.len() {
            let mut x = [[0.0]; PANEL];
            x.iter_mut().zip(&rests).for_each(|(x, (k, taken))| x[0] = k[at] - taken[at]);
            solve_few::<M, 1>(&factors, &mut x);
            x.iter().zip(&mut rests).for_each(|(x, (_, out))| out[at] = x[0]);
        }
    }
}

/// x ← xL⁻ᵀ for a few rows, where `factors` are −L but for its diagonal, which is inverted.
#[inline(always)]
fn solve_few<M: MultiplyAdd, const ROWS: usize>(factors: &[[f64; PANEL]; PANEL], x: &mut [[f64; ROWS]; PANEL]) {
    for own in 0..PANEL {
        for other in 0..own {
            for row in 0..ROWS {
                x[own][row] = M::multiply_add(factors[own][other], x[other][row], x[own][row]);
            }
        }
        for row in 0..ROWS {
            x[own][row] *= factors[own][own];
        }
    }
}

/// Adds `factor`·XXᵀ to the lower triangle of `out`, panel by panel, for an X of [`PANELS_MAX`] rows at most.
pub(super) fn add_symmetric_product_by_panels(factor: f64, x: MatRef<'_, f64>, mut out: MatMut<'_, f64>) {
    let rows = x.nrows();
    for first in (0..rows).step_by(PANEL) {
        let width = PANEL.min(rows - first);
        let panel = out.as_mut().submatrix_mut(first, first, rows - first, width);
        let (below, own) = (x.subrows(first, rows - first), x.subrows(first, width));
        matmul(panel, Accum::Add, below, own.transpose(), factor, Par::Seq);
    }
}
