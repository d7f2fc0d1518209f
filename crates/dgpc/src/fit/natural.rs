//! Fixed point of a sparse mean field, iterated in the sums Ĝ and b̂ of its events ([`crate::method::inference`]).

use std::ops::Range;

use super::anderson::Anderson;
use super::mean_field::{MeanField, TILT_MIN, TILT_START, omega, omega_and_ln_2_cosh};
use super::options::FitOptions;
use super::sparse::{EventMoments, Site, Sparse};
use super::stagnation::{FitStop, Stagnation};
use crate::cross::Sums;
use crate::error::{Result, finite};
use crate::likelihood::Likelihood;
use crate::linalg::Matrix;
use crate::monitor::Progress;
use crate::prior::Prior;
use crate::sites::Sites;

/// Walks from one posterior to the next until no tilt changes by more than the tolerance. On return, the engine holds
/// the posterior of the returned sites.
pub(super) fn iterate(
    engine: &mut Sparse<'_>,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<FixedPoint> {
    let initial = begin(engine, prior, likelihood, options)?;
    let mut moments = Moments::of_tilts(likelihood.events(), options.start);
    let scale = Scale::of(&initial);
    let (mut at, mut plain, mut is_plain) = (initial, None, true);
    let mut anderson = Anderson::new();
    let (mut best, mut iterations) = (f64::NEG_INFINITY, 0);
    let (mut was_rejected, mut stagnation) = (false, Stagnation::new());
    loop {
        iterations += 1;
        let walk = engine.walk(moments.columns(), |n, event, moments| move_site(likelihood, n, event, moments))?;
        options.monitor.report(Progress::Iteration { iterations, change: walk.change })?;
        let evidence = match engine.take(&walk.sums) {
            Err(_) if !is_plain => f64::NAN,
            taken => taken.map(|()| engine.evidence(walk.bound))?,
        };
        // Plain steps never lower E. If an accelerated step lowered it, the plain step replaces it and the acceleration
        // restarts.
        let is_worse = !evidence.is_finite() || evidence < best - 1e-10 * best.abs();
        if let Some(plain) = plain.take_if(|_| !is_plain && is_worse) {
            engine.take(&plain)?;
            (at, is_plain, was_rejected) = (plain, true, true);
            anderson.restart();
            continue;
        }
        best = best.max(finite("evidence bound", evidence)?);
        // After a rejected step, the tilts changed from the point where that step led, not from the plain point.
        let converged = walk.change <= options.tolerance && !was_rejected;
        was_rejected = false;
        let stagnates = stagnation.record(walk.change, evidence);
        if converged || stagnates || iterations >= options.iterations_max {
            let tilts = moments.tilts();
            if !converged {
                // The stored moments belong to the tilts, not yet to the final posterior.
                engine.walk(moments.columns(), |_, event, moments| {
                    event.store_in(moments);
                    Site { omega: 0.0, kappa: 0.0, bound: 0.0, change: 0.0 }
                })?;
            }
            return Ok(FixedPoint {
                tilts,
                moments,
                evidence,
                iterations,
                change: walk.change,
                stop: match (converged, stagnates) {
                    (true, _) => FitStop::Converged,
                    (false, true) => FitStop::Stagnated,
                    (false, false) => FitStop::IterationsMax,
                },
                sums: walk.sums,
            });
        }
        // The last step is plain, because no later walk could reject an accelerated step.
        let mut step = None;
        if iterations + 1 < options.iterations_max {
            let image = scale.coordinates(&walk.sums);
            let next = anderson.propose(&scale.coordinates(&at), &image);
            step = Some(next).filter(|next| *next != image).map(|next| scale.sums(&next));
        }
        if let Some(next) = &step
            && engine.take(next).is_err()
        {
            engine.take(&walk.sums)?;
            anderson.restart();
            step = None;
        }
        is_plain = step.is_none();
        at = step.unwrap_or_else(|| walk.sums.clone());
        plain = Some(walk.sums);
    }
}

/// Sets the posterior of the sites at the initial tilts, and returns their sums.
fn begin(
    engine: &mut Sparse<'_>,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<Sums> {
    options.check(likelihood.events())?;
    let (weights, tilt) = (likelihood.observations.weights(), |n| options.start.map_or(TILT_START, |start| start[n]));
    let initial =
        engine.begin(prior, |n| (omega(weights[n], tilt(n).max(TILT_MIN)), likelihood.observations.kappa_of(n)))?;
    engine.take(&initial.sums)?;
    Ok(initial.sums)
}

/// Posterior moments of f at the events.
struct Moments {
    mean: Vec<f64>,
    variance: Vec<f64>,
}

impl Moments {
    /// Returns moments that have the given tilts.
    fn of_tilts(events: usize, tilts: Option<&[f64]>) -> Self {
        let mean = tilts.map_or_else(|| vec![TILT_START; events], <[f64]>::to_vec);
        Self { mean, variance: vec![0.0; events] }
    }

    fn columns(&mut self) -> [&mut [f64]; 2] {
        [&mut self.mean, &mut self.variance]
    }

    fn tilts(&self) -> Vec<f64> {
        self.mean.iter().zip(&self.variance).map(|(&mean, &variance)| tilt(mean, variance)).collect()
    }
}

/// Returns the tilt c = √E\[f²\].
fn tilt(mean: f64, variance: f64) -> f64 {
    (mean * mean + variance).sqrt().max(TILT_MIN)
}

/// Returns the site of an event at its posterior moments, with its terms of E and the change of its tilt.
fn move_site(likelihood: &Likelihood<'_>, n: usize, event: &EventMoments, [mean, variance]: [&mut f64; 2]) -> Site {
    let before = tilt(*mean, *variance);
    event.store_in([&mut *mean, &mut *variance]);
    let after = tilt(*mean, *variance);
    let (weight, kappa) = (likelihood.observations.weights()[n], likelihood.observations.kappa_of(n));
    let (omega, ln_2_cosh) = omega_and_ln_2_cosh(weight, after);
    let tilted = 0.5 * omega * (after * after - event.residual) - weight * ln_2_cosh;
    let about_mean = (kappa - 0.5 * omega * event.prior_mean) * event.prior_mean;
    Site { omega, kappa, bound: tilted + about_mean, change: (after - before).abs() }
}

/// The end of the iteration.
pub(super) struct FixedPoint {
    tilts: Vec<f64>,
    moments: Moments,
    evidence: f64,
    iterations: usize,
    change: f64,
    stop: FitStop,
    sums: Sums,
}

impl FixedPoint {
    /// Returns ω̄ of some of the events.
    pub(super) fn omega(&self, likelihood: &Likelihood<'_>, events: Range<usize>) -> Vec<f64> {
        let weights = &likelihood.observations.weights()[events.clone()];
        weights.iter().zip(&self.tilts[events]).map(|(&weight, &tilt)| omega(weight, tilt)).collect()
    }

    /// Converts the result to a [`MeanField`]. Most of the engine is dropped first, because its covariances need more
    /// memory than the result.
    pub(super) fn mean_field(self, engine: Sparse<'_>, likelihood: &Likelihood<'_>) -> Result<MeanField> {
        let (residual, jitter) = (engine.residual, engine.cholesky.jitter());
        drop((engine.cross, engine.prior_mean));
        let omega = self.omega(likelihood, 0..likelihood.events());
        Ok(MeanField {
            sites: Sites::new(likelihood.observations, omega)?,
            mean: self.moments.mean,
            variance: self.moments.variance,
            residual,
            tilts: self.tilts,
            evidence: self.evidence,
            iterations: self.iterations,
            change: self.change,
            stop: self.stop,
            jitter,
            weights: likelihood.observations.weights().to_vec(),
            condensed: Some((self.sums.precision, self.sums.shift)),
        })
    }
}

/// Scales Ĝ and b̂ to coordinates in which steps of different directions are comparable: units of the initial
/// precision.
struct Scale(Vec<f64>);

impl Scale {
    fn of(sums: &Sums) -> Self {
        Self(sums.precision.diagonal().into_iter().map(|precision| (1.0 + precision).sqrt().recip()).collect())
    }

    /// Returns the entries of the lower triangle, column by column, then b̂. Entries off the diagonal are scaled by √2,
    /// because they occur twice in Ĝ.
    fn coordinates(&self, sums: &Sums) -> Vec<f64> {
        let points = self.0.len();
        let entry = |row: usize, column: usize| sums.precision[(row, column)] * self.of_entry(row, column);
        let triangle = (0..points).flat_map(|column| (column..points).map(move |row| (row, column)));
        let shift = sums.shift.iter().zip(&self.0).map(|(shift, scale)| shift * scale);
        triangle.map(|(row, column)| entry(row, column)).chain(shift).collect()
    }

    fn sums(&self, coordinates: &[f64]) -> Sums {
        let points = self.0.len();
        let (triangle, shift) = coordinates.split_at(coordinates.len() - points);
        let (mut precision, mut entries) = (Matrix::zeros(points, points), triangle.iter());
        for column in 0..points {
            for (row, entry) in (column..points).zip(&mut entries) {
                precision[(row, column)] = entry / self.of_entry(row, column);
            }
        }
        precision.mirror_lower();
        Sums { precision, shift: shift.iter().zip(&self.0).map(|(shift, scale)| shift / scale).collect() }
    }

    fn of_entry(&self, row: usize, column: usize) -> f64 {
        let twice = if row == column { 1.0 } else { std::f64::consts::SQRT_2 };
        twice * self.0[row] * self.0[column]
    }
}
