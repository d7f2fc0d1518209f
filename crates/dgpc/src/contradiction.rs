//! How far outcomes that somebody tells contradict what is known without them (section 6 of [`crate::method`]).

use std::ops::Range;

use crate::error::Result;
use crate::latent::{success_probability, success_slope};
use crate::linalg::{Cholesky, Matrix, dot};
use crate::observations::Observations;
use crate::parts::stretches;
use crate::posterior::Posterior;
use crate::shift::known;

/// No outcome is taken for more certain than this variance says, so that one alone contradicts by 3.2 at most.
const OUTCOME_VARIANCE_MIN: f64 = 0.1;

/// So often outcomes are halved, in their order, to look at each part by itself, as long as so many are in it.
const HALVINGS: u32 = 3;
const PART_MIN: usize = 16;

impl Posterior {
    /// How far outcomes that this posterior does not hold contradict it, in standard deviations, as those of somebody would who
    /// tells failures alone, successes alone, or the opposite of what happened; the largest of the three, of all outcomes
    /// and of each half, quarter and eighth of them in their order that has 16, and 0 where they lie the other way. Looks only where
    /// this posterior explains at least half of the prior variance, of f or of how it lies about its mean over all of them: that
    /// a prior was wrong is no contradiction. An offset of f, common to all of them and normal with mean 0 and standard deviation
    /// `offset_sd`, is none either.
    ///
    /// With p the expected outcomes and Σ the covariance that outcomes y have about them, this is aᵀΣ⁻¹(y − p)/√(aᵀΣ⁻¹a) for a = −p,
    /// 1 − p, and 1 − 2p, of mean 0 and variance 1 each where the outcomes follow this posterior. It grows with √N where they do not.
    /// O(N n² + N² n + N³).
    ///
    /// # Errors
    /// As [`Posterior::joint`].
    pub fn contradiction(&self, told: &Observations, offset_sd: f64) -> Result<f64> {
        let (mean, covariance) = self.joint(told.inputs())?;
        let known = known(&covariance, &self.prior().kernel().gram(told.inputs())?);
        if known.is_empty() {
            return Ok(0.0);
        }
        let mean: Vec<f64> = known.iter().map(|&n| mean[n]).collect();
        let covariance =
            Matrix::from_fn(known.len(), known.len(), |row, column| covariance.column(known[column])[known[row]]);
        let told = Told::new(&told.select(&known), &mean, covariance, offset_sd);
        let mut largest: f64 = 0.0;
        let lengths = (1..=HALVINGS).map(|halvings| known.len().div_ceil(1 << halvings));
        for length in std::iter::once(known.len()).chain(lengths.take_while(|&length| length >= PART_MIN)) {
            for part in stretches(0..known.len(), length) {
                largest = largest.max(told.contradiction(part)?);
            }
        }
        Ok(largest)
    }
}

/// Outcomes, and what is expected of them.
struct Told {
    expected: Vec<f64>,
    /// Outcomes less what is expected.
    residual: Vec<f64>,
    /// Standard deviation of an outcome given f.
    scatter_sd: Vec<f64>,
    /// How an outcome grows with f, in these.
    slope: Vec<f64>,
    /// Of f, without the offset.
    covariance: Matrix,
    offset_sd: f64,
}

impl Told {
    fn new(told: &Observations, mean: &[f64], covariance: Matrix, offset_sd: f64) -> Self {
        let moments = || mean.iter().zip(covariance.diagonal());
        let expected: Vec<f64> = moments().map(|(&mean, variance)| success_probability(mean, variance)).collect();
        let residual = told.outcomes().iter().zip(&expected).map(|(&told, p)| f64::from(u8::from(told)) - p).collect();
        // Given f an outcome varies by σ(f)(1 − σ(f)), whose mean is the slope of p in the mean of f.
        let slope: Vec<f64> = moments().map(|(&mean, variance)| success_slope(mean, variance)).collect();
        let scatter = slope.iter().zip(told.weights()).map(|(slope, weight)| slope.max(OUTCOME_VARIANCE_MIN) / weight);
        let scatter_sd: Vec<f64> = scatter.map(f64::sqrt).collect();
        let slope = slope.iter().zip(&scatter_sd).map(|(slope, sd)| slope / sd).collect();
        Self { expected, residual, scatter_sd, slope, covariance, offset_sd }
    }

    /// That of a part of them: with Σ = D½(I + WCW)D½, D the scatter and W = D^−½ times the slopes.
    fn contradiction(&self, part: Range<usize>) -> Result<f64> {
        let mut middle = Matrix::from_fn(part.len(), part.len(), |row, column| {
            let (row, column) = (part.start + row, part.start + column);
            let covariance = self.covariance.column(column)[row] + self.offset_sd * self.offset_sd;
            self.slope[row] * covariance * self.slope[column]
        });
        middle.add_to_diagonal(1.0);
        let middle = Cholesky::with_jitter("I + WCW", &middle)?;
        let whitened = |of: &dyn Fn(usize) -> f64| {
            let mut values: Vec<f64> = part.clone().map(|n| of(n) / self.scatter_sd[n]).collect();
            middle.solve_lower(&mut values);
            values
        };
        let residual = whitened(&|n| self.residual[n]);
        let along = |as_told: &dyn Fn(f64) -> f64| {
            let direction = whitened(&|n| as_told(self.expected[n]));
            dot(&direction, &residual) / dot(&direction, &direction).sqrt().max(f64::MIN_POSITIVE)
        };
        Ok(along(&|p| -p).max(along(&|p| 1.0 - p)).max(along(&|p| 1.0 - 2.0 * p)))
    }
}
