//! Test of reported outcomes against a posterior without them ([`crate::method::consistency`]).

use std::ops::Range;

use crate::error::Result;
use crate::latent::{success_probability, success_slope};
use crate::linalg::{Cholesky, Matrix, dot};
use crate::observations::Observations;
use crate::parts::stretches;
use crate::posterior::Posterior;
use crate::shift::determined;

/// Lower bound on the variance of an outcome. With it, one outcome alone contradicts by at most 3.2 standard
/// deviations.
const OUTCOME_VARIANCE_MIN: f64 = 0.1;

/// Number of times that the outcomes are halved, in their order, to test each part separately.
const HALVINGS: u32 = 3;
/// Smallest number of outcomes in a part.
const PART_MIN: usize = 16;

impl Posterior {
    /// Returns how strongly reported outcomes contradict this posterior, in standard deviations. The posterior must not
    /// hold these outcomes.
    ///
    /// Three alternatives are tested: a reporter of failures alone, of successes alone, and of the opposite of each
    /// outcome. Each is tested on all outcomes, and on halves, quarters and eighths, in order, of at least 16 outcomes.
    /// The result is the largest statistic, or 0 if all are negative.
    ///
    /// Only determined inputs count. There, this posterior explains at least half of the prior variance of f, or of the
    /// deviation of f from its mean. Elsewhere the result would only show that the prior was wrong. An offset of f that
    /// all outcomes share, normal with mean 0 and standard deviation `offset_sd`, is not a contradiction either.
    ///
    /// Let p be the expected outcomes and Σ the covariance of the outcomes y about p. The statistic is
    /// aᵀΣ⁻¹(y − p)/√(aᵀΣ⁻¹a) for a = −p, 1 − p and 1 − 2p. It has mean 0 and variance 1 if the outcomes follow this
    /// posterior. Otherwise it grows with √N. O(N n² + N² n + N³).
    ///
    /// # Errors
    /// As [`Posterior::joint`].
    pub fn contradiction(&self, reported: &Observations, offset_sd: f64) -> Result<f64> {
        let (mean, covariance) = self.joint(reported.inputs())?;
        let determined = determined(&covariance, &self.prior().kernel().gram(reported.inputs())?);
        if determined.is_empty() {
            return Ok(0.0);
        }
        let mean: Vec<f64> = determined.iter().map(|&n| mean[n]).collect();
        let covariance = Matrix::from_fn(determined.len(), determined.len(), |row, column| {
            covariance.column(determined[column])[determined[row]]
        });
        let reported = ReportedOutcomes::new(&reported.select(&determined), &mean, covariance, offset_sd);
        let mut largest: f64 = 0.0;
        let lengths = (1..=HALVINGS).map(|halvings| determined.len().div_ceil(1 << halvings));
        for length in std::iter::once(determined.len()).chain(lengths.take_while(|&length| length >= PART_MIN)) {
            for part in stretches(0..determined.len(), length) {
                largest = largest.max(reported.contradiction(part)?);
            }
        }
        Ok(largest)
    }
}

/// Reported outcomes and their expectations.
struct ReportedOutcomes {
    expected: Vec<f64>,
    /// Outcomes minus their expectations.
    residual: Vec<f64>,
    /// Standard deviation of each outcome given f.
    scatter_sd: Vec<f64>,
    /// Derivative of each expected outcome by the mean of f, in units of `scatter_sd`.
    slope: Vec<f64>,
    /// Covariance of f without the offset.
    covariance: Matrix,
    offset_sd: f64,
}

impl ReportedOutcomes {
    fn new(reported: &Observations, mean: &[f64], covariance: Matrix, offset_sd: f64) -> Self {
        let moments = || mean.iter().zip(covariance.diagonal());
        let expected: Vec<f64> = moments().map(|(&mean, variance)| success_probability(mean, variance)).collect();
        let residual =
            reported.outcomes().iter().zip(&expected).map(|(&reported, p)| f64::from(u8::from(reported)) - p).collect();
        // Given f an outcome has the variance σ(f)(1 − σ(f)). Its mean is the derivative of p by the mean of f.
        let slope: Vec<f64> = moments().map(|(&mean, variance)| success_slope(mean, variance)).collect();
        let scatter =
            slope.iter().zip(reported.weights()).map(|(slope, weight)| slope.max(OUTCOME_VARIANCE_MIN) / weight);
        let scatter_sd: Vec<f64> = scatter.map(f64::sqrt).collect();
        let slope = slope.iter().zip(&scatter_sd).map(|(slope, sd)| slope / sd).collect();
        Self { expected, residual, scatter_sd, slope, covariance, offset_sd }
    }

    /// Returns the largest of the three statistics of a part. Σ = D½(I + WCW)D½, with D the variances given f and W =
    /// D^−½ times the slopes.
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
        let along = |alternative: &dyn Fn(f64) -> f64| {
            let direction = whitened(&|n| alternative(self.expected[n]));
            dot(&direction, &residual) / dot(&direction, &direction).sqrt().max(f64::MIN_POSITIVE)
        };
        Ok(along(&|p| -p).max(along(&|p| 1.0 - p)).max(along(&|p| 1.0 - 2.0 * p)))
    }
}
