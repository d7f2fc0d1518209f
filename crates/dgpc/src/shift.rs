//! How far summaries move a posterior: what they say beside what is known without them (section 6 of
//! [`crate::method`]).

use crate::error::{Error, Result};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, product};
use crate::posterior::Posterior;
use crate::summary::Summary;

/// By how much some summaries move the latent function at their own inducing points, one after the other, and how
/// uncertain it is there without them.
#[derive(Debug, Clone, PartialEq)]
pub struct Shift {
    /// Mean with them, less the mean without.
    pub mean: Vec<f64>,
    /// Variance without them.
    pub variance: Vec<f64>,
    /// Variance of the prior.
    pub prior_variance: Vec<f64>,
}

/// What is known of a point is worth comparing with where it explains at least this share of the prior variance: that the
/// prior was wrong is no surprise.
const EXPLAINED_SHARE: f64 = 0.5;

impl Shift {
    /// The largest shift in standard deviations of what is known without the summaries, at points where that explains at
    /// least half of the prior variance, but for an offset that is common to all of them: normal with mean 0 and standard
    /// deviation `offset_sd`, as far as the points say. 0 without such points.
    ///
    /// Where the summaries come from the same latent function, the shift at a point is normal with a variance below that
    /// known without them, and so this is rarely above 3.
    pub fn largest(&self, offset_sd: f64) -> f64 {
        let all = || self.mean.iter().zip(&self.variance).zip(&self.prior_variance);
        let is_known = |variance: f64, prior: f64| variance > 0.0 && variance <= (1.0 - EXPLAINED_SHARE) * prior;
        let points = || all().filter(|((_, variance), prior)| is_known(**variance, **prior)).map(|(point, _)| point);
        let count = points().count().max(1) as f64;
        // Points of one member say much the same: their weight is that of one.
        let weight = points().map(|(_, variance)| 1.0 / variance).sum::<f64>() / count;
        let weighted = points().map(|(mean, variance)| mean / variance).sum::<f64>() / count;
        let offset = if offset_sd > 0.0 { weighted / (weight + (offset_sd * offset_sd).recip()) } else { 0.0 };
        points().map(|(mean, variance)| (mean - offset).abs() / variance.sqrt()).fold(0.0, f64::max)
    }
}

impl Posterior {
    /// How far `summaries`, which this posterior does not hold, would move it. O(M n² + M² n + M³) for M inducing points.
    ///
    /// # Errors
    /// [`crate::Error::DifferentPriors`] for summaries of another prior, and as [`Posterior::joint`].
    pub fn shift_by(&self, summaries: &[&Summary]) -> Result<Shift> {
        let Some(said) = Said::new(self, summaries)? else { return Ok(Shift::none()) };
        // With A = CR the covariance with them is C − A(I + RᵀCR)⁻¹Aᵀ.
        let with = said.updated(1.0)?;
        let (mean, variance) = (with.times(&said.pull), said.covariance.diagonal());
        Ok(Shift { mean, variance, prior_variance: said.prior_variance })
    }

    /// How far `summaries`, which this posterior holds, have moved it: what it would say without them is worked out from
    /// what it says with them. As dear as [`Posterior::shift_by`].
    ///
    /// # Errors
    /// As [`Posterior::shift_by`], and [`crate::Error::NotPositiveDefinite`] for summaries that it does not hold.
    pub fn shift_of(&self, summaries: &[&Summary]) -> Result<Shift> {
        let Some(said) = Said::new(self, summaries)? else { return Ok(Shift::none()) };
        // The covariance without them is C + A(I − RᵀCR)⁻¹Aᵀ.
        let without = said.updated(-1.0)?;
        let (mean, variance) = (without.times(&said.pull), without.diagonal());
        Ok(Shift { mean, variance, prior_variance: said.prior_variance })
    }
}

impl Shift {
    fn none() -> Self {
        Self { mean: Vec::new(), variance: Vec::new(), prior_variance: Vec::new() }
    }
}

/// What summaries say, as the factor exp(−½hᵀRRᵀh + βᵀh) of h = f − μ₀ at their inducing points, beside what a posterior
/// says there.
struct Said {
    /// R.
    root: Matrix,
    /// C.
    covariance: Matrix,
    /// β − RRᵀh at the posterior's mean of h.
    pull: Vec<f64>,
    prior_variance: Vec<f64>,
}

impl Said {
    /// `None` where nothing is said.
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
            let mut block = summary.root(0.0)?;
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
        let prior_variance = posterior.prior().kernel().diagonal(&points)?;
        Ok(Some(Self { root, covariance, pull, prior_variance }))
    }

    /// C − s A (I + s RᵀA)⁻¹ Aᵀ with A = CR.
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
