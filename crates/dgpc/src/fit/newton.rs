//! Newton's step towards the fixed point of the mean field ([`crate::method::inference`]).

use super::pass::Pass;
use crate::linalg::{Matrix, MultiplyAdd, Wide, add_scaled, dot, squared_norm, widest};
use crate::polya_gamma;

/// Smallest ω with which an event influences others. Below it, the column of Σ is lost in the rounding of B⁻¹.
const OMEGA_MIN: f64 = 1e-8;

/// Largest number of directions of the conjugate gradients.
const DIRECTIONS_MAX: usize = 30;

/// Bounds on the relative residual at which the system counts as solved. Within them the limit is the largest entry of
/// the right-hand side. For ordinary weights and tilts that entry is about the residual in ln c, so that errors
/// decrease quadratically.
const SHARES: (f64, f64) = (1e-5, 1e-2);

/// A pass, with the derivative of its images by its tilts.
///
/// With u = c² and h = −dω/du, the image of u changes by A·diag(h) times the change of u, A = 2 diag(m)·Σ·diag(m) +
/// Σ∘Σ. In ln c the derivative is diag(1/u′)·A·diag(hu), with u′ the image. With S = diag(h·u/u′)^½ on both sides of A
/// it is symmetric.
pub(super) struct Newton<'a> {
    /// B⁻¹ = I − Ω^½ΣΩ^½.
    pub(super) inverse: &'a Matrix,
    /// Ω^½.
    pub(super) roots: &'a [f64],
    pub(super) pass: &'a Pass<'a>,
    /// ln c of the events at which the pass was made.
    pub(super) log_tilts: &'a [f64],
}

impl Newton<'_> {
    /// Returns the ln c that would equal its image if the image were linear. Returns `None` if rounding spoils the
    /// solution. O(N²) a direction; a handful of directions is usually enough.
    pub(super) fn step(&self) -> Option<Vec<f64>> {
        let (log_tilts, Pass { weights, tilts, images, .. }) = (self.log_tilts, self.pass);
        let of_events = |entry: &dyn Fn(usize) -> f64| (0..log_tilts.len()).map(entry).collect::<Vec<f64>>();
        let roots_of_h = of_events(&|n| match self.roots[n] * self.roots[n] {
            omega if omega < OMEGA_MIN => 0.0,
            _ => (0.5 * polya_gamma::variance(weights[n], tilts[n])).sqrt(),
        });
        let residual = of_events(&|n| images[n] - log_tilts[n]);
        // S, and the unit of ln c in which the system is symmetric.
        let scales = of_events(&|n| roots_of_h[n] * (-residual[n]).exp());
        let units = of_events(&|n| roots_of_h[n] * (log_tilts[n] + images[n]).exp());
        let matrix = SecondOrder::new(self, &scales);
        let solved = conjugate_gradients(|x| matrix.times(x), &of_events(&|n| units[n] * residual[n]))?;
        // Events that influence no other event take the plain step.
        let to = of_events(&|n| if units[n] > 0.0 { log_tilts[n] + solved[n] / units[n] } else { images[n] });
        to.iter().all(|log_tilt| log_tilt.is_finite()).then_some(to)
    }
}

/// Solves x − SASx = target by conjugate gradients. Returns `None` if rounding spoils the solution. Because Σ ⪯ Ω⁻¹, no
/// eigenvalue of I − SAS is below the smallest c/sinh c.
fn conjugate_gradients(times: impl Fn(&[f64]) -> Vec<f64>, target: &[f64]) -> Option<Vec<f64>> {
    let largest = target.iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()));
    let enough = largest.clamp(SHARES.0, SHARES.1).powi(2) * squared_norm(target);
    let (mut x, mut left, mut direction) = (vec![0.0; target.len()], target.to_vec(), target.to_vec());
    let mut size = squared_norm(&left);
    for _ in 0..DIRECTIONS_MAX {
        if size <= enough {
            break;
        }
        let mut taken = times(&direction);
        taken.iter_mut().zip(&direction).for_each(|(taken, direction)| *taken = direction - *taken);
        let curvature = dot(&direction, &taken);
        if curvature.is_nan() || curvature <= 0.0 {
            return None;
        }
        add_scaled(size / curvature, &direction, &mut x);
        add_scaled(-size / curvature, &taken, &mut left);
        let smaller = squared_norm(&left);
        direction.iter_mut().zip(&left).for_each(|(entry, left)| *entry = left + smaller / size * *entry);
        size = smaller;
    }
    size.is_finite().then_some(x)
}

/// SAS, as the sum of a product with B⁻¹ and a product with its squared entries.
struct SecondOrder<'a> {
    inverse: &'a Matrix,
    /// S·diag(m)·Ω^−½, which stands on both sides of I − B⁻¹.
    by_mean: Vec<f64>,
    /// S·Ω⁻¹, which stands on both sides of the squared entries of I − B⁻¹.
    by_square: Vec<f64>,
}

impl<'a> SecondOrder<'a> {
    fn new(newton: &Newton<'a>, scales: &[f64]) -> Self {
        let Newton { inverse, roots, pass: Pass { mean, .. }, .. } = *newton;
        // An event that influences no other may have ω = 0, by which nothing can be divided.
        let over = |n: usize| if scales[n] > 0.0 { scales[n] / roots[n] } else { 0.0 };
        let by_mean = (0..scales.len()).map(|n| over(n) * mean[n]).collect();
        let by_square = (0..scales.len()).map(|n| if scales[n] > 0.0 { over(n) / roots[n] } else { 0.0 }).collect();
        Self { inverse, by_mean, by_square }
    }

    /// Returns SASx. O(N²).
    fn times(&self, x: &[f64]) -> Vec<f64> {
        let scaled = |by: &[f64]| by.iter().zip(x).map(|(by, x)| by * x).collect::<Vec<f64>>();
        let (first, second) = (scaled(&self.by_mean), scaled(&self.by_square));
        let entry = |n: usize| {
            let column = &self.inverse.column(n)[..x.len()];
            let [plain, square] = widest(Both { entries: column, first: &first, second: &second });
            // Compared with B⁻¹, I − B⁻¹ has another diagonal and opposite signs off the diagonal.
            let diagonal = self.inverse[(n, n)];
            let plain = first[n] - plain;
            let square = square + (1.0 - 2.0 * diagonal) * second[n];
            2.0 * self.by_mean[n] * plain + self.by_square[n] * square
        };
        (0..x.len()).map(entry).collect()
    }
}

/// Computes aᵀx and (a∘a)ᵀy in one pass over a.
struct Both<'a> {
    entries: &'a [f64],
    first: &'a [f64],
    second: &'a [f64],
}

const SUMS: usize = 16;

impl Wide for Both<'_> {
    type Output = [f64; 2];

    #[inline(always)]
    fn run<M: MultiplyAdd>(self) -> [f64; 2] {
        let (a, a_rest) = self.entries.as_chunks::<SUMS>();
        let ((x, x_rest), (y, y_rest)) = (self.first.as_chunks::<SUMS>(), self.second.as_chunks::<SUMS>());
        let (mut plain, mut square) = ([0.0; SUMS], [0.0; SUMS]);
        for ((a, x), y) in a.iter().zip(x).zip(y) {
            for place in 0..SUMS {
                plain[place] = M::multiply_add(a[place], x[place], plain[place]);
                square[place] = M::multiply_add(a[place] * a[place], y[place], square[place]);
            }
        }
        for (place, ((a, x), y)) in a_rest.iter().zip(x_rest).zip(y_rest).enumerate() {
            plain[place] = M::multiply_add(*a, *x, plain[place]);
            square[place] = M::multiply_add(a * a, *y, square[place]);
        }
        [plain.iter().sum(), square.iter().sum()]
    }
}
