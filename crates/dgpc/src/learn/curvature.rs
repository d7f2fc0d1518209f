//! How the objective of a search bends, as far as a search needs it (section 7 of [`crate::method`]).

use crate::error::Result;
use crate::linalg::{Matrix, dot, symmetric_eigen};

/// Directions in the coordinates of a search, and how much its cost per event bends along each.
pub(super) struct Curvature {
    /// Positive.
    bends: Vec<f64>,
    /// Along each a step of 1 raises a cost that bends so by ½.
    steps: Vec<Vec<f64>>,
    is_measured: bool,
}

impl Curvature {
    /// Along every coordinate alike.
    pub(super) fn alike(size: usize, bend: f64) -> Self {
        let step = |along| (0..size).map(|place| if place == along { bend.sqrt().recip() } else { 0.0 }).collect();
        Self { bends: vec![bend; size], steps: (0..size).map(step).collect(), is_measured: false }
    }

    /// Of a matrix of second derivatives. Where the cost bends down it counts as if it bent up as much, so that steps go down
    /// there, too; and nowhere it bends less than by `least`.
    pub(super) fn of(hessian: &Matrix, least: f64) -> Result<Self> {
        let (values, directions) = symmetric_eigen("curvature of a search", hessian)?;
        let bends: Vec<f64> = values.iter().map(|value| value.abs().max(least)).collect();
        let step = |(along, bend): (usize, &f64)| {
            directions.column(along).iter().map(|entry| entry / bend.sqrt()).collect::<Vec<f64>>()
        };
        let steps = bends.iter().enumerate().map(step).collect();
        Ok(Self { bends, steps, is_measured: true })
    }

    /// Whether somebody looked how the cost bends.
    pub(super) fn is_measured(&self) -> bool {
        self.is_measured
    }

    /// Where so many steps along each direction lead.
    pub(super) fn place(&self, from: &[f64], steps: &[f64]) -> Vec<f64> {
        let mut place = from.to_vec();
        for (direction, step) in self.steps.iter().zip(steps) {
            place.iter_mut().zip(direction).for_each(|(place, entry)| *place += step * entry);
        }
        place
    }

    /// A gradient by steps, from that by coordinates. Half its square is what a cost that bends so still has to lose.
    pub(super) fn by_steps(&self, gradient: &[f64]) -> Vec<f64> {
        self.steps.iter().map(|direction| dot(direction, gradient)).collect()
    }

    /// How much higher a cost that bends so lies at one of two places, if it is least at the other.
    pub(super) fn rise(&self, a: &[f64], b: &[f64]) -> f64 {
        let apart: Vec<f64> = a.iter().zip(b).map(|(a, b)| a - b).collect();
        let along = self.steps.iter().zip(&self.bends).map(|(direction, bend)| bend * dot(direction, &apart));
        0.5 * along.map(|steps| steps * steps).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_leads_to_where_a_quadratic_cost_is_least() -> Result<()> {
        // ½ xᵀHx − gᵀx is least where Hx = g.
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
    fn steps_go_down_where_a_cost_bends_down_and_are_short_of_infinite_where_it_is_flat() -> Result<()> {
        let saddle = Matrix::from_fn(2, 2, |row, column| if row == column { [-4.0, 0.0][row] } else { 0.0 });
        let curvature = Curvature::of(&saddle, 0.25)?;
        let gradient = [1.0, 1.0];
        let steps: Vec<f64> = curvature.by_steps(&gradient).iter().map(|slope| -slope).collect();
        let mut to = curvature.place(&[0.0, 0.0], &steps);
        to.sort_by(f64::total_cmp);
        assert!((to[0] + 4.0).abs() < 1e-12 && (to[1] + 0.25).abs() < 1e-12, "{to:?}");
        let alike = Curvature::alike(2, 0.25);
        assert_eq!(alike.place(&[1.0, 0.0], &[-0.5, 1.0]), [0.0, 2.0]);
        Ok(())
    }
}
