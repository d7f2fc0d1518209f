//! Plain, slow linear algebra and statistics that share no code with the crate under test.

// Without the feature `learn`, some of these functions are not used.
#![cfg_attr(not(feature = "learn"), allow(dead_code))]

use dgpc::Matrix;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// A matrix as a list of rows.
pub(crate) type Dense = Vec<Vec<f64>>;

pub(crate) fn seeded(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub(crate) fn rows(matrix: &Matrix) -> Dense {
    (0..matrix.rows()).map(|i| (0..matrix.columns()).map(|j| matrix[(i, j)]).collect()).collect()
}

pub(crate) fn transposed(a: &Dense) -> Dense {
    let columns = a.first().map_or(0, Vec::len);
    (0..columns).map(|j| a.iter().map(|row| row[j]).collect()).collect()
}

pub(crate) fn times(a: &Dense, b: &Dense) -> Dense {
    let columns = transposed(b);
    a.iter().map(|row| columns.iter().map(|column| dot(row, column)).collect()).collect()
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(crate) fn trace(a: &Dense) -> f64 {
    (0..a.len()).map(|i| a[i][i]).sum()
}

/// Returns A⁻¹B by Gaussian elimination with row pivoting.
pub(crate) fn solve(a: &Dense, b: &Dense) -> Dense {
    let size = a.len();
    let mut rows: Dense = a.iter().zip(b).map(|(a, b)| [a.as_slice(), b.as_slice()].concat()).collect();
    for pivot in 0..size {
        let largest = (pivot..size).max_by(|&i, &j| rows[i][pivot].abs().total_cmp(&rows[j][pivot].abs())).unwrap();
        rows.swap(pivot, largest);
        let pivot_row = rows[pivot].clone();
        for row in &mut rows[pivot + 1..] {
            let factor = row[pivot] / pivot_row[pivot];
            row.iter_mut().zip(&pivot_row).skip(pivot).for_each(|(entry, pivot)| *entry -= factor * pivot);
        }
    }
    for pivot in (0..size).rev() {
        let (above, below) = rows.split_at_mut(pivot);
        let pivot_row = &mut below[0];
        let scale = pivot_row[pivot];
        pivot_row[size..].iter_mut().for_each(|entry| *entry /= scale);
        for row in above {
            let factor = row[pivot];
            row[size..].iter_mut().zip(&pivot_row[size..]).for_each(|(entry, solved)| *entry -= factor * solved);
        }
    }
    rows.into_iter().map(|row| row[size..].to_vec()).collect()
}

/// Returns A⁻¹b.
pub(crate) fn solve_vector(a: &Dense, b: &[f64]) -> Vec<f64> {
    solve(a, &b.iter().map(|&b| vec![b]).collect()).concat()
}

/// Returns the lower L with A = LLᵀ, or `None` if A is not positive definite.
pub(crate) fn cholesky(a: &Dense) -> Option<Dense> {
    let size = a.len();
    let mut l = vec![vec![0.0; size]; size];
    for i in 0..size {
        for j in 0..=i {
            let rest = a[i][j] - dot(&l[i][..j], &l[j][..j]);
            l[i][j] = if i > j {
                rest / l[j][j]
            } else if rest > 0.0 {
                rest.sqrt()
            } else {
                return None;
            };
        }
    }
    Some(l)
}

/// Returns ln|A| of a positive definite A.
pub(crate) fn log_determinant(a: &Dense) -> f64 {
    let l = cholesky(a).expect("a positive definite matrix");
    (0..l.len()).map(|i| 2.0 * l[i][i].ln()).sum()
}

/// Returns σ(f).
pub(crate) fn logistic(f: f64) -> f64 {
    1.0 / (1.0 + (-f).exp())
}

/// Returns ∫ g(f) N(f; mean, variance) df by the trapezoid rule, which converges geometrically for an analytic g.
pub(crate) fn gaussian_expectation(mean: f64, variance: f64, g: impl Fn(f64) -> f64) -> f64 {
    const STEPS: i32 = 4000;
    let (step, sd) = (24.0 / f64::from(STEPS), variance.sqrt());
    let at = |i: i32| {
        let u = -12.0 + step * f64::from(i);
        (-0.5 * u * u).exp() * g(mean + sd * u)
    };
    (0..=STEPS).map(at).sum::<f64>() * step / std::f64::consts::TAU.sqrt()
}

/// Asserts |found − expected| ≤ tolerance · scale, entry by entry. The scale is 1 plus the largest expected magnitude.
#[track_caller]
pub(crate) fn assert_near(what: &str, found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len(), "{what}: sizes");
    let scale = 1.0 + expected.iter().fold(0.0f64, |largest, value| largest.max(value.abs()));
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        // A NaN must fail, too.
        let near = (found - expected).abs() <= tolerance * scale;
        assert!(near, "{what}[{i}]: {found}, expected {expected}, error {:e}", (found - expected).abs() / scale);
    }
}

/// Asserts as [`assert_near`] does, for matrices.
#[track_caller]
pub(crate) fn assert_near_matrix(what: &str, found: &Dense, expected: &Dense, tolerance: f64) {
    assert_near(what, &found.concat(), &expected.concat(), tolerance);
}

/// The one-sided standard normal quantile of level 1e-6.
const NORMAL_QUANTILE: f64 = 4.753_424;

/// Returns the critical value of χ² at level 1e-6 by Wilson and Hilferty's approximation. It is too large by less than
/// 1 % here.
pub(crate) fn chi_square_critical(degrees: usize) -> f64 {
    let k = degrees as f64;
    let spread = 2.0 / (9.0 * k);
    k * (1.0 - spread + NORMAL_QUANTILE * spread.sqrt()).powi(3)
}

/// Averages of several functions along a chain, with the standard error from the averages of long batches.
pub(crate) struct BatchMeans {
    batch_length: usize,
    current: Vec<f64>,
    in_current: usize,
    batches: Vec<Vec<f64>>,
}

impl BatchMeans {
    pub(crate) fn new(functions: usize, batch_length: usize) -> Self {
        Self { batch_length, current: vec![0.0; functions], in_current: 0, batches: Vec::new() }
    }

    pub(crate) fn add(&mut self, values: &[f64]) {
        self.current.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        self.in_current += 1;
        if self.in_current == self.batch_length {
            let length = self.batch_length as f64;
            self.batches.push(self.current.iter().map(|sum| sum / length).collect());
            self.current.fill(0.0);
            self.in_current = 0;
        }
    }

    /// Returns mean and standard error of every function.
    pub(crate) fn finish(&self) -> Vec<(f64, f64)> {
        let count = self.batches.len() as f64;
        (0..self.current.len())
            .map(|function| {
                let mean = self.batches.iter().map(|batch| batch[function]).sum::<f64>() / count;
                let squares: f64 = self.batches.iter().map(|batch| (batch[function] - mean).powi(2)).sum();
                (mean, (squares / (count - 1.0) / count).sqrt())
            })
            .collect()
    }
}
