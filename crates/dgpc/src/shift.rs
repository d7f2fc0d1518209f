//! Shift of a posterior by summaries: the change of the mean relative to the remaining uncertainty
//! ([`crate::method::consistency`]).

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, product};
use crate::posterior::Posterior;
use crate::summary::Summary;

/// The shift of the latent function by some summaries, at their inducing points one after the other, and the
/// uncertainty there without them.
#[derive(Debug, Clone, PartialEq)]
pub struct Shift {
    /// Mean with the summaries minus mean without them.
    pub mean: Vec<f64>,
    /// Covariance without the summaries.
    pub covariance: Matrix,
    /// Covariance of the prior.
    pub prior_covariance: Matrix,
}

/// Smallest explained share of the prior variance of a value for the comparison. Where less is explained, a large shift
/// only shows that the prior was wrong, which is no surprise.
const EXPLAINED_SHARE: f64 = 0.5;

/// Smallest share of a value's prior variance that its deviation from the mean must have. Below it, deviations are
/// rounding errors.
const DIFFERENCE_SHARE: f64 = 0.01;

/// Returns whether enough of the prior variance is explained for a comparison.
fn is_determined(variance: f64, prior_variance: f64) -> bool {
    variance > 0.0 && variance <= (1.0 - EXPLAINED_SHARE) * prior_variance
}

/// Returns the variances of the deviations of the values from their mean over all values.
fn about_mean(covariance: &Matrix) -> Vec<f64> {
    let count = covariance.columns().max(1) as f64;
    let shared: Vec<f64> =
        (0..covariance.columns()).map(|n| covariance.column(n).iter().sum::<f64>() / count).collect();
    let mean = shared.iter().sum::<f64>() / count;
    covariance.diagonal().iter().zip(&shared).map(|(variance, shared)| variance - 2.0 * shared + mean).collect()
}

/// Marks the determined values (first mask), and those with a determined deviation from the mean (second mask).
fn determined_masks(covariance: &Matrix, prior_covariance: &Matrix) -> [Vec<bool>; 2] {
    let [value, prior] = [covariance, prior_covariance].map(Matrix::diagonal);
    let [differs, prior_differs] = [covariance, prior_covariance].map(about_mean);
    let is_apart = |n: usize| prior_differs[n] >= DIFFERENCE_SHARE * prior[n];
    let all = || 0..value.len();
    [
        all().map(|n| is_determined(value[n], prior[n])).collect(),
        all().map(|n| is_apart(n) && is_determined(differs[n], prior_differs[n])).collect(),
    ]
}

/// Returns the indices of values that are determined, or whose deviation from the mean is.
pub(crate) fn determined(covariance: &Matrix, prior_covariance: &Matrix) -> Vec<usize> {
    let [value, about_mean] = determined_masks(covariance, prior_covariance);
    (0..value.len()).filter(|&n| value[n] || about_mean[n]).collect()
}

impl Shift {
    /// Returns the largest shift, in standard deviations without the summaries. Points count if at least half of the
    /// prior variance is explained without the summaries. Without such points the result is 0.
    ///
    /// Two kinds of shift are examined. The first is that of the function itself, minus a common offset. The offset is
    /// normal with mean 0 and standard deviation `offset_sd`, and is estimated from the points. The second is that of
    /// the deviation from the mean over the points.
    ///
    /// If the summaries come from the same latent function, the shift at a point is normal. Its variance is then
    /// smaller than the variance without the summaries. The result therefore rarely exceeds 3.
    pub fn largest(&self, offset_sd: f64) -> f64 {
        let [value, about_mean] = determined_masks(&self.covariance, &self.prior_covariance);
        self.largest_of_values(&value, offset_sd).max(self.largest_about_mean(&about_mean))
    }

    fn largest_of_values(&self, is_determined: &[bool], offset_sd: f64) -> f64 {
        let variance = self.covariance.diagonal();
        let determined = || (0..variance.len()).filter(|&n| is_determined[n]);
        let count = determined().count().max(1) as f64;
        // Points of one member are strongly correlated, so together they have the weight of one point.
        let weight = determined().map(|n| 1.0 / variance[n]).sum::<f64>() / count;
        let weighted = determined().map(|n| self.mean[n] / variance[n]).sum::<f64>() / count;
        let offset = if offset_sd > 0.0 { weighted / (weight + (offset_sd * offset_sd).recip()) } else { 0.0 };
        determined().map(|n| (self.mean[n] - offset).abs() / variance[n].sqrt()).fold(0.0, f64::max)
    }

    fn largest_about_mean(&self, is_determined: &[bool]) -> f64 {
        let mean = self.mean.iter().sum::<f64>() / self.mean.len().max(1) as f64;
        let variance = about_mean(&self.covariance);
        let determined = (0..variance.len()).filter(|&n| is_determined[n]);
        determined.map(|n| (self.mean[n] - mean).abs() / variance[n].sqrt()).fold(0.0, f64::max)
    }
}

impl Posterior {
    /// Returns the shift that `summaries` would cause. This posterior must not hold them yet. O(M n² + M² n + M³) for M
    /// inducing points.
    ///
    /// # Errors
    /// [`crate::Error::DifferentPriors`] for summaries of another prior, and as [`Posterior::joint`].
    pub fn shift_by(&self, summaries: &[&Summary]) -> Result<Shift> {
        let Some(factor) = MessageFactor::new(self, summaries)? else { return Ok(Shift::none()) };
        // With A = CR the covariance with them is C − A(I + RᵀCR)⁻¹Aᵀ.
        let with = factor.updated(1.0)?;
        let mean = with.times(&factor.pull);
        Ok(Shift { mean, covariance: factor.covariance, prior_covariance: factor.prior_covariance })
    }

    /// Returns the shift that `summaries` have caused. This posterior must hold them. The moments without them are
    /// computed by downdating the moments with them, at the cost of [`Posterior::shift_by`].
    ///
    /// # Errors
    /// As [`Posterior::shift_by`], and [`crate::Error::NotPositiveDefinite`] for summaries that the posterior does not
    /// hold.
    pub fn shift_of(&self, summaries: &[&Summary]) -> Result<Shift> {
        let Some(factor) = MessageFactor::new(self, summaries)? else { return Ok(Shift::none()) };
        // The covariance without them is C + A(I − RᵀCR)⁻¹Aᵀ.
        let without = factor.updated(-1.0)?;
        let mean = without.times(&factor.pull);
        Ok(Shift { mean, covariance: without, prior_covariance: factor.prior_covariance })
    }
}

impl Shift {
    fn none() -> Self {
        let nothing = || Matrix::zeros(0, 0);
        Self { mean: Vec::new(), covariance: nothing(), prior_covariance: nothing() }
    }
}

/// The joint factor exp(−½hᵀRRᵀh + βᵀh) of summaries, with h = f − μ₀ at their inducing points, and the moments of a
/// posterior at the same points.
struct MessageFactor {
    /// R.
    root: Matrix,
    /// C.
    covariance: Matrix,
    /// β − RRᵀh, with h at the posterior's mean.
    pull: Vec<f64>,
    prior_covariance: Matrix,
}

impl MessageFactor {
    /// Returns `None` if there are no summaries.
    fn new(posterior: &Posterior, summaries: &[&Summary]) -> Result<Option<Self>> {
        let Some(first) = summaries.first() else { return Ok(None) };
        let mut points = Inputs::empty(first.inducing_points().dimension());
        summaries.iter().try_for_each(|summary| points.append(summary.inducing_points()))?;
        let mut root = Matrix::zeros(points.len(), points.len());
        let mut pull = Vec::with_capacity(points.len());
        for summary in summaries {
            let begin = pull.len();
            // R = L⁻ᵀR̂ and β = L⁻ᵀb̂.
            if summary.prior() != posterior.prior() {
                return Err(Error::DifferentPriors { what: "a posterior and a summary" });
            }
            let mut block = summary.root()?;
            summary.cholesky().solve_upper_matrix(&mut block);
            for column in 0..block.columns() {
                root.column_mut(begin + column)[begin..begin + block.rows()].copy_from_slice(block.column(column));
            }
            let mut shift = summary.whitened_shift().to_vec();
            summary.cholesky().solve_upper(&mut shift);
            pull.extend(shift);
        }
        let (mean, covariance) = posterior.joint(&points)?;
        let prior_mean = posterior.prior().mean().values(&points)?;
        let about: Vec<f64> = mean.iter().zip(&prior_mean).map(|(mean, prior)| mean - prior).collect();
        let drawn = root.times(&root.transposed_times(&about));
        pull.iter_mut().zip(&drawn).for_each(|(pull, drawn)| *pull -= drawn);
        let prior_covariance = posterior.prior().kernel().gram(&points)?;
        Ok(Some(Self { root, covariance, pull, prior_covariance }))
    }

    /// Returns C − s A (I + s RᵀA)⁻¹ Aᵀ with A = CR and s = `sign`.
    fn updated(&self, sign: f64) -> Result<Matrix> {
        let along = product(self.covariance.view(), self.root.view());
        let mut middle = Matrix::zeros(self.pull.len(), self.pull.len());
        middle.add_scaled(sign, &product(self.root.t(), along.view()));
        middle.add_to_diagonal(1.0);
        middle.symmetrise();
        let mut explained = along.transposed();
        Cholesky::with_jitter("I ± RᵀCR", &middle)?.solve_lower_matrix(&mut explained);
        let mut updated = self.covariance.clone();
        updated.add_scaled(-sign, &product(explained.t(), explained.view()));
        Ok(updated)
    }
}
