//! Anderson acceleration of a fixed point x = F(x).

use crate::linalg::{Cholesky, Matrix, dot};

/// Number of earlier steps that are combined.
const DEPTH: usize = 8;

/// Stores the last points and their images, and proposes the next point.
pub(crate) struct Anderson {
    /// Differences of successive residuals F(x) − x.
    residual_steps: Vec<Vec<f64>>,
    /// Differences of successive images F(x).
    image_steps: Vec<Vec<f64>>,
    last: Option<(Vec<f64>, Vec<f64>)>,
}

impl Anderson {
    pub(crate) fn new() -> Self {
        Self { residual_steps: Vec::new(), image_steps: Vec::new(), last: None }
    }

    /// Discards all stored steps, so that the next proposal is a plain step.
    pub(crate) fn restart(&mut self) {
        *self = Self::new();
    }

    /// Returns the combination of stored images whose residual is smallest in the linear model, given F(`point`) =
    /// `image`. Returns `image` itself if no step is stored. O(N · depth²).
    pub(crate) fn propose(&mut self, point: &[f64], image: &[f64]) -> Vec<f64> {
        let difference = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let residual = difference(image, point);
        if let Some((last_residual, last_image)) = self.last.take() {
            if self.residual_steps.len() == DEPTH {
                self.residual_steps.remove(0);
                self.image_steps.remove(0);
            }
            self.residual_steps.push(difference(&residual, &last_residual));
            self.image_steps.push(difference(image, &last_image));
        }
        let mut next = image.to_vec();
        if let Some(coefficients) = self.coefficients(&residual) {
            for (coefficient, step) in coefficients.iter().zip(&self.image_steps) {
                next.iter_mut().zip(step).for_each(|(next, step)| *next -= coefficient * step);
            }
        }
        self.last = Some((residual, image.to_vec()));
        next
    }

    /// Solves the least-squares problem of the residual on its past steps, with a ridge of 1e-12 to make it solvable.
    fn coefficients(&self, residual: &[f64]) -> Option<Vec<f64>> {
        let steps = &self.residual_steps;
        let mut gram = Matrix::from_fn(steps.len(), steps.len(), |i, j| dot(&steps[i], &steps[j]));
        (0..steps.len()).for_each(|i| gram[(i, i)] *= 1.0 + 1e-12);
        let mut coefficients: Vec<f64> = steps.iter().map(|step| dot(step, residual)).collect();
        let cholesky = Cholesky::new("Anderson steps", gram).ok()?;
        cholesky.solve(&mut coefficients);
        coefficients.iter().all(|c| c.is_finite()).then_some(coefficients)
    }
}
