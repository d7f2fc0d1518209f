//! Choosing inducing points among so many that their covariance does not fit into memory (section 5 of
//! [`crate::method`]).

use crate::candidates::{DISTINCT_SHARE, Selection};
use crate::error::{Result, positive};
use crate::inputs::{Inputs, spread_out};
use crate::kernel::Kernel;
use crate::linalg::{add_scaled, dot, multiply_vector, squared_norm};

/// What would be explained below this share of a prior variance is rounding.
const ROUNDING_SHARE: f64 = 1e-10;

/// The `points` of all `inputs` that greedy choice takes where tr K̃ is summed over at most `judges_max` of them, spread
/// evenly; with as many judges as inputs the choice of [`crate::Candidates::greedy`]. The trace that comes back is over all
/// inputs. Once the judges know everything, the points of largest variance follow. O(NJ·points) for N inputs and J judges, NJ memory.
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
/// [`crate::Error::BadColumn`] when the kernel looks at a column that the inputs do not have;
/// [`crate::Error::OutOfRange`] without judges.
pub fn greedy_judged(kernel: &Kernel, inputs: &Inputs, points: usize, judges_max: usize) -> Result<Selection> {
    positive("number of judges", judges_max as f64)?;
    let judges = spread_out(inputs.len(), judges_max);
    let cross = kernel.cross(&inputs.select(&judges), inputs)?;
    let mut explained: Vec<f64> = (0..inputs.len()).map(|place| squared_norm(cross.column(place))).collect();
    let mut left = Left::new(kernel, inputs)?;
    let (mut seen, mut image) = (Vec::<Vec<f64>>::new(), vec![0.0; inputs.len()]);
    choose(&mut left, points, |left| {
        if let Some(column) = left.columns.get(seen.len()) {
            // As for K̃ over all inputs (`remainder.rs`), with the sums over the judges alone.
            let own: Vec<f64> = judges.iter().map(|&judge| column[judge]).collect();
            multiply_vector(cross.t(), &own, &mut image);
            for (earlier, of_judges) in left.columns.iter().zip(&seen) {
                add_scaled(-dot(of_judges, &own), earlier, &mut image);
            }
            let norm = squared_norm(&own);
            for ((explained, u), image) in explained.iter_mut().zip(column).zip(&image) {
                *explained -= u * (2.0 * image - u * norm);
            }
            seen.push(own);
        }
        explained.iter().zip(&left.variance).map(|(explained, variance)| explained.max(0.0) / variance).collect()
    })
}

/// The `points` of all `inputs` that one after the other have the largest variance given those before: the cheap rule, which
/// looks at no other input and leaves a larger trace. O(N·points²) time, N·points memory.
///
/// # Errors
/// As [`greedy_judged`].
pub fn greedy_by_variance(kernel: &Kernel, inputs: &Inputs, points: usize) -> Result<Selection> {
    choose(&mut Left::new(kernel, inputs)?, points, |left| left.variance.clone())
}

/// Takes the most worthy point that is one of its own, again and again.
fn choose(left: &mut Left<'_>, points: usize, mut worth: impl FnMut(&Left<'_>) -> Vec<f64>) -> Result<Selection> {
    let mut indices = Vec::with_capacity(points.min(left.prior.len()));
    while indices.len() < points {
        let merits = worth(left);
        let is_distinct = |&place: &usize| left.variance[place] >= DISTINCT_SHARE * left.prior[place];
        let most = |of: &[f64], least: f64| {
            let candidates = (0..of.len()).filter(is_distinct).filter(|&place| of[place] > least * left.prior[place]);
            candidates.reduce(|best, next| if of[next] > of[best] { next } else { best })
        };
        // Where no judge is left to convince, what is unknown counts.
        let Some(best) = most(&merits, ROUNDING_SHARE).or_else(|| most(&left.variance, 0.0)) else { break };
        left.take(best)?;
        indices.push(best);
    }
    Ok(Selection { indices, trace: left.variance.iter().map(|variance| variance.max(0.0)).sum() })
}

/// What is left of the covariance of all inputs, K̃ = K − UUᵀ, by its diagonal and the columns of U; those of K are worked out
/// when they are needed.
struct Left<'a> {
    kernel: &'a Kernel,
    inputs: &'a Inputs,
    /// diag K.
    prior: Vec<f64>,
    /// diag K̃.
    variance: Vec<f64>,
    columns: Vec<Vec<f64>>,
}

impl<'a> Left<'a> {
    fn new(kernel: &'a Kernel, inputs: &'a Inputs) -> Result<Self> {
        let prior = kernel.diagonal(inputs)?;
        Ok(Self { kernel, inputs, variance: prior.clone(), prior, columns: Vec::new() })
    }

    /// Takes all variance at a point away. O(N) for every point before.
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
