//! Curvature of the objective of a search ([`crate::method::learning`]).

use crate::error::Result;
use crate::linalg::{Matrix, dot, symmetric_eigen};

/// The principal directions of the cost per event, in the coordinates of a search, with the curvature along each.
pub(super) struct Curvature {
    /// Curvatures, all positive.
    curvatures: Vec<f64>,
    /// Directions, scaled so that a step of 1 from the minimum increases the cost by ½.
    steps: Vec<Vec<f64>>,
    is_measured: bool,
}

impl Curvature {
    /// Creates a curvature that is the same along every coordinate.
    pub(super) fn isotropic(size: usize, curvature: f64) -> Self {
        let step = |along| (0..size).map(|place| if place == along { curvature.sqrt().recip() } else { 0.0 }).collect();
        Self { curvatures: vec![curvature; size], steps: (0..size).map(step).collect(), is_measured: false }
    }

    /// Computes the curvature from a matrix of second derivatives. Negative eigenvalues are replaced by their absolute
    /// values, so that steps decrease the cost there, too. Curvatures below `least` are raised to `least`.
    pub(super) fn of(hessian: &Matrix, least: f64) -> Result<Self> {
        let (values, directions) = symmetric_eigen("curvature of a search", hessian)?;
        let curvatures: Vec<f64> = values.iter().map(|value| value.abs().max(least)).collect();
        let step = |(along, curvature): (usize, &f64)| {
            directions.column(along).iter().map(|entry| entry / curvature.sqrt()).collect::<Vec<f64>>()
        };
        let steps = curvatures.iter().enumerate().map(step).collect();
        Ok(Self { curvatures, steps, is_measured: true })
    }

    /// Returns whether the curvature was computed from second derivatives.
    pub(super) fn is_measured(&self) -> bool {
        self.is_measured
    }

    /// Returns the place that the given steps along the directions lead to.
    pub(super) fn place(&self, from: &[f64], steps: &[f64]) -> Vec<f64> {
        let mut place = from.to_vec();
        for (direction, step) in self.steps.iter().zip(steps) {
            place.iter_mut().zip(direction).for_each(|(place, entry)| *place += step * entry);
        }
        place
    }

    /// Transforms a gradient by coordinates to a gradient by steps. Half of its squared norm is the decrease that a
    /// quadratic cost of this curvature still offers.
    pub(super) fn by_steps(&self, gradient: &[f64]) -> Vec<f64> {
        self.steps.iter().map(|direction| dot(direction, gradient)).collect()
    }

    /// Returns the increase of a quadratic cost of this curvature from its minimum at one of two places to the other
    /// place.
    pub(super) fn rise(&self, a: &[f64], b: &[f64]) -> f64 {
        let apart: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let along =
            self.steps.iter().zip(&self.curvatures).map(|(direction, curvature)| curvature * dot(direction, &apart));
        0.5 * along.map(|steps| steps * steps).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_leads_to_the_minimum_of_a_quadratic_cost() -> Result<()> {
        // ½ xᵀHx − gᵀx has its minimum where Hx = g.
        let (hessian, least) =
            (Matrix::from_fn(2, 2, |row, column| [[3.0, 1.0], [1.0, 2.0]][row][column]), [0.4, -0.7]);
        let gradient = |x: &[f64]| -> Vec<f64> {
            (0..2).map(|row| (0..2).map(|column| hessian[(row, column)] * (x[column] - least[column])).sum()).collect()
        };
        let cost = |x: &[f64]| 0.5 * dot(&gradient(x), &[x[0] - least[0], x[1] - least[1]]);
        let (curvature, start) = (Curvature::of(&hessian, 1e-3)?, [2.0, 1.0]);
        let slope = curvature.by_steps(&gradient(&start));
        let steps: Vec<f64> = slope.iter().map(|slope| -slope).collect();
        let end = curvature.place(&start, &steps);
        assert!(end.iter().zip(&least).all(|(end, least)| (end - least).abs() < 1e-12), "{end:?}");
        assert!((0.5 * dot(&slope, &slope) - cost(&start)).abs() < 1e-12);
        assert!((curvature.rise(&start, &end) - cost(&start)).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn steps_decrease_a_concave_cost_and_are_finite_for_a_flat_cost() -> Result<()> {
        let saddle = Matrix::from_fn(2, 2, |row, column| if row == column { [-4.0, 0.0][row] } else { 0.0 });
        let curvature = Curvature::of(&saddle, 0.25)?;
        let gradient = [1.0, 1.0];
        let steps: Vec<f64> = curvature.by_steps(&gradient).iter().map(|slope| -slope).collect();
        let mut to = curvature.place(&[0.0, 0.0], &steps);
        to.sort_by(f64::total_cmp);
        assert!((to[0] + 4.0).abs() < 1e-12 && (to[1] + 0.25).abs() < 1e-12, "{to:?}");
        let isotropic = Curvature::isotropic(2, 0.25);
        assert_eq!(isotropic.place(&[1.0, 0.0], &[-0.5, 1.0]), [0.0, 2.0]);
        Ok(())
    }
}
