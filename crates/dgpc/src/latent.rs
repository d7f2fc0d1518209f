//! Moments of the latent function and the probability of success ([`crate::method::fusion`]).

use std::ops::Range;

use crate::error::{Result, all_finite};
use crate::inputs::Inputs;
use crate::parts::{on_parts, parts, stretches};
use crate::prior::Prior;
use crate::special::{logistic, normal_cdf, normal_density};

/// Points in one block. Their covariances with 1000 events, solved in place, stay in the second-level cache.
pub(crate) const POINTS: usize = 128;

/// Mean and variance of the latent function at each of several points.
#[derive(Debug, Clone, PartialEq)]
pub struct Latent {
    /// Means, one per point.
    pub mean: Vec<f64>,
    /// Variances, one per point, not negative.
    pub variance: Vec<f64>,
}

impl Latent {
    /// Starts from the prior moments at every point and lets `learned` update them in blocks.
    ///
    /// `learned` receives a block of points, their means and variances, and a work area that successive blocks share.
    /// It costs `work_each` multiply-adds a point. The results are checked as in [`Latent::checked`].
    pub(crate) fn in_blocks<R: Default>(
        prior: &Prior,
        inputs: &Inputs,
        work_each: usize,
        learned: impl Fn(&Inputs, &mut [f64], &mut [f64], &mut R) -> Result<()> + Send + Sync,
    ) -> Result<Self> {
        let mut mean = prior.mean().values(inputs)?;
        let mut variance = prior.kernel().diagonal(inputs)?;
        let (mut means, mut variances, mut shares) = (mean.as_mut_slice(), variance.as_mut_slice(), Vec::new());
        for part in parts(inputs.len(), work_each) {
            let (own_means, other_means) = means.split_at_mut(part.len());
            let (own_variances, other_variances) = variances.split_at_mut(part.len());
            shares.push((part, own_means, own_variances));
            (means, variances) = (other_means, other_variances);
        }
        let on_part = |(part, means, variances): (Range<usize>, &mut [f64], &mut [f64])| -> Result<()> {
            let mut scratch = R::default();
            let moments = means.chunks_mut(POINTS).zip(variances.chunks_mut(POINTS));
            stretches(part, POINTS)
                .zip(moments)
                .try_for_each(|(block, (mean, variance))| learned(&inputs.slice(block), mean, variance, &mut scratch))
        };
        on_parts(shares, on_part).into_iter().collect::<Result<()>>()?;
        Self::checked(mean, variance)
    }

    /// Checks that all moments are finite. Variances that rounding made negative become 0.
    pub(crate) fn checked(mean: Vec<f64>, mut variance: Vec<f64>) -> Result<Self> {
        // A NaN stays a NaN, which the check refuses.
        variance.iter_mut().filter(|variance| **variance < 0.0).for_each(|variance| *variance = 0.0);
        all_finite("latent mean", &mean)?;
        all_finite("latent variance", &variance)?;
        Ok(Self { mean, variance })
    }

    /// Returns the probability of success at every point: [`success_probability`] of each mean and variance.
    pub fn probability(&self) -> Vec<f64> {
        self.mean.iter().zip(&self.variance).map(|(&mean, &variance)| success_probability(mean, variance)).collect()
    }
}

/// Weight and scale of each normal distribution function in a mixture that approximates the logistic function σ
/// (Monahan and Stefanski 1992, eight terms). The error |σ(x) − Σ weight · Φ(scale · x)| is below 2.1e-9 for every x.
const MIXTURE: [(f64, f64); 8] = [
    (0.003246343272134, 1.365340806296348),
    (0.051517477033972, 1.059523971016916),
    (0.195077912673858, 0.830791313765644),
    (0.315569823632818, 0.650732166639391),
    (0.274149576158423, 0.508135425366489),
    (0.131076880695470, 0.396313345166341),
    (0.027912418727972, 0.308904252267995),
    (0.001449567805354, 0.238212616409306),
];

/// Returns ∫ σ(f) N(f; mean, variance) df: the probability of success for a latent function of this mean and variance.
///
/// The absolute error is below 3e-9 for every mean and variance, because the mixture's error is uniform in f. The exact
/// value lies between σ(mean) and ½, because averaging over a symmetric density pulls towards ½. The result is clamped
/// to that interval. This keeps the far tails correct, where the mixture alone would decrease too fast.
///
/// The result is NaN if an argument is NaN. [`crate::Posterior::latent`] returns no NaN.
///
/// ```
/// assert!((dgpc::success_probability(0.0, 4.0) - 0.5).abs() < 1e-8);
/// ```
pub fn success_probability(mean: f64, variance: f64) -> f64 {
    if mean.is_nan() || variance.is_nan() {
        return f64::NAN;
    }
    let variance = variance.max(0.0);
    let mixture: f64 = MIXTURE
        .iter()
        .map(|&(weight, scale)| weight * normal_cdf(mean * scale / (1.0 + scale * scale * variance).sqrt()))
        .sum();
    let tail = logistic(-mean.abs());
    if mean < 0.0 { mixture.clamp(tail, 0.5) } else { mixture.clamp(0.5, 1.0 - tail) }
}

/// Returns the derivative of [`success_probability`] by the mean: ∫ σ(f)(1 − σ(f)) N(f; mean, variance) df.
pub(crate) fn success_slope(mean: f64, variance: f64) -> f64 {
    let term = |&(weight, scale): &(f64, f64)| {
        let scale = scale / (1.0 + scale * scale * variance).sqrt();
        weight * scale * normal_density(mean * scale)
    };
    MIXTURE.iter().map(term).sum()
}
