//! Choice of inducing points among so large a number of inputs that their covariance does not fit into memory
//! ([`crate::method::inducing_points`]).

use crate::candidates::{DISTINCT_SHARE, Selection};
use crate::error::{Result, positive};
use crate::inputs::{Inputs, spread_out};
use crate::kernel::Kernel;
use crate::linalg::{add_scaled, dot, multiply_vector, squared_norm};

/// Below this share of a prior variance, an explained variance is a rounding error.
const ROUNDING_SHARE: f64 = 1e-10;

/// Chooses `points` of `inputs` greedily, with tr K̃ summed over at most `judges_max` inputs, the judges.
///
/// The judges are spread evenly. If all inputs are judges, the choice is that of [`crate::Candidates::greedy`]. The
/// trace in the result is over all inputs. After the judges are fully explained, the points of largest variance follow.
/// O(NJ·points) time and NJ memory for N inputs and J judges.
///
/// ```
/// use dgpc::{Inputs, Kernel, Shape, Term, greedy_judged};
///
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 0.5, 1)?])?;
/// let inputs = Inputs::new((0..5000).map(|n| f64::from(n) * 1e-3).collect(), 1)?;
/// let selection = greedy_judged(&kernel, &inputs, 12, 200)?;
/// assert_eq!(selection.indices.len(), 12);
/// assert!(selection.trace < 0.05 * 4.0 * 5000.0);
/// # Ok::<(), dgpc::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::BadColumn`] if the kernel uses a column that the inputs do not have;
/// [`crate::Error::OutOfRange`] if `judges_max` is 0.
pub fn greedy_judged(kernel: &Kernel, inputs: &Inputs, points: usize, judges_max: usize) -> Result<Selection> {
    positive("number of judges", judges_max as f64)?;
    let judges = spread_out(inputs.len(), judges_max);
    let cross = kernel.cross(&inputs.select(&judges), inputs)?;
    let mut explained: Vec<f64> = (0..inputs.len()).map(|place| squared_norm(cross.column(place))).collect();
    let mut remaining = RemainingCovariance::new(kernel, inputs)?;
    let (mut seen, mut image) = (Vec::<Vec<f64>>::new(), vec![0.0; inputs.len()]);
    choose(&mut remaining, points, |remaining| {
        if let Some(column) = remaining.columns.get(seen.len()) {
            // The update is that of `remainder.rs` with K̃ over all inputs, but the sums are over the judges only.
            let own: Vec<f64> = judges.iter().map(|&judge| column[judge]).collect();
            multiply_vector(cross.t(), &own, &mut image);
            for (earlier, of_judges) in remaining.columns.iter().zip(&seen) {
                add_scaled(-dot(of_judges, &own), earlier, &mut image);
            }
            let norm = squared_norm(&own);
            for ((explained, u), image) in explained.iter_mut().zip(column).zip(&image) {
                *explained -= u * (2.0 * image - u * norm);
            }
            seen.push(own);
        }
        explained.iter().zip(&remaining.variance).map(|(explained, variance)| explained.max(0.0) / variance).collect()
    })
}

/// Chooses `points` of `inputs`, each with the largest variance given the points before it. This cheap rule ignores the
/// other inputs and leaves a larger trace than [`greedy_judged`]. O(N·points²) time, N·points memory.
///
/// # Errors
/// As [`greedy_judged`].
pub fn greedy_by_variance(kernel: &Kernel, inputs: &Inputs, points: usize) -> Result<Selection> {
    choose(&mut RemainingCovariance::new(kernel, inputs)?, points, |remaining| remaining.variance.clone())
}

/// Repeatedly conditions on the distinct point of the largest worth.
fn choose(
    remaining: &mut RemainingCovariance<'_>,
    points: usize,
    mut worth: impl FnMut(&RemainingCovariance<'_>) -> Vec<f64>,
) -> Result<Selection> {
    let mut indices = Vec::with_capacity(points.min(remaining.prior.len()));
    while indices.len() < points {
        let merits = worth(remaining);
        let is_distinct = |&place: &usize| remaining.variance[place] >= DISTINCT_SHARE * remaining.prior[place];
        let most = |of: &[f64], least: f64| {
            let candidates =
                (0..of.len()).filter(is_distinct).filter(|&place| of[place] > least * remaining.prior[place]);
            candidates.reduce(|best, next| if of[next] > of[best] { next } else { best })
        };
        // If no judge has variance left to explain, the point of largest variance is chosen.
        let Some(best) = most(&merits, ROUNDING_SHARE).or_else(|| most(&remaining.variance, 0.0)) else { break };
        remaining.take(best)?;
        indices.push(best);
    }
    Ok(Selection { indices, trace: remaining.variance.iter().map(|variance| variance.max(0.0)).sum() })
}

/// The remaining covariance of all inputs, K̃ = K − UUᵀ, represented by its diagonal and the columns of U. Columns of K
/// are computed when they are needed.
struct RemainingCovariance<'a> {
    kernel: &'a Kernel,
    inputs: &'a Inputs,
    /// diag K.
    prior: Vec<f64>,
    /// diag K̃.
    variance: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl<'a> RemainingCovariance<'a> {
    fn new(kernel: &'a Kernel, inputs: &'a Inputs) -> Result<Self> {
        let prior = kernel.diagonal(inputs)?;
        Ok(Self { kernel, inputs, variance: prior.clone(), prior, columns: Vec::new() })
    }

    /// Removes all variance at a point. O(N) for every earlier point.
    fn take(&mut self, point: usize) -> Result<()> {
        let whole = self.kernel.cross(self.inputs, &self.inputs.select(&[point]))?;
        let mut column = whole.column(0).to_vec();
        for earlier in &self.columns {
            add_scaled(-earlier[point], earlier, &mut column);
        }
        let root = self.variance[point].sqrt();
        for (entry, variance) in column.iter_mut().zip(&mut self.variance) {
            *entry /= root;
            *variance -= *entry * *entry;
        }
        self.columns.push(column);
        Ok(())
    }
}
