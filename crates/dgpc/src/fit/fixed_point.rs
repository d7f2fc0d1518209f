//! The fixed point of a dense mean field: an iteration over its tilts (section 2 of [`crate::method`]).

use super::anderson::Anderson;
use super::dense::Dense;
use super::mean_field::{MeanField, TILT_MIN};
use super::options::FitOptions;
use crate::error::{Result, finite};
use crate::likelihood::Likelihood;
use crate::polya_gamma;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::special::ln_2_cosh;

/// The fixed point c_n² = E_q\[f_n²\]. When it returns, the engine holds the same pass.
pub(super) fn iterate(
    engine: &mut Dense,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    options.check(likelihood.events())?;
    let mut pass = Pass::new(prior, likelihood, options)?;
    // The iteration runs in ln c, where no step leaves the domain.
    let mut log_tilts: Vec<f64> = pass.tilts.iter().map(|tilt| tilt.max(TILT_MIN).ln()).collect();
    let mut plain_step = log_tilts.clone();
    let mut anderson = Anderson::new();
    let (mut evidence, mut best) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let (mut change, mut iterations) = (f64::INFINITY, 0);
    while iterations < options.iterations_max && change > options.tolerance {
        iterations += 1;
        let is_plain = log_tilts == plain_step;
        pass.set_sites(&log_tilts);
        let covariance_terms = engine.pass(&pass.omega, &pass.shift, &mut pass.mean, &mut pass.variance);
        evidence = match covariance_terms {
            Err(_) if !is_plain => f64::NAN,
            terms => terms? + pass.sum_terms(),
        };
        change = pass.set_images();
        // Plain steps never lower E. Another one that did, or that overflowed, is taken back for the plain one, and
        // acceleration starts anew.
        if !is_plain && (evidence.is_nan() || evidence < best - 1e-10 * best.abs()) {
            log_tilts.copy_from_slice(&plain_step);
            anderson.restart();
            change = f64::INFINITY;
            continue;
        }
        best = best.max(finite("evidence bound", evidence)?);
        plain_step.copy_from_slice(&pass.images);
        // The last iteration takes the plain step: nothing could take another one back any more.
        let goes_on = change > options.tolerance && iterations + 1 < options.iterations_max;
        let step = if goes_on { engine.newton(&pass, &log_tilts) } else { Some(plain_step.clone()) };
        log_tilts = step.unwrap_or_else(|| anderson.propose(&log_tilts, &pass.images));
    }
    let converged = change <= options.tolerance;
    let Pass { mut omega, mut mean, mut variance, tilts, .. } = pass;
    let events = likelihood.events();
    omega.truncate(events);
    mean.truncate(events);
    variance.truncate(events);
    Ok(MeanField {
        sites: Sites::new(likelihood.observations, omega)?,
        mean,
        variance,
        residual: vec![0.0; events],
        tilts,
        evidence,
        iterations,
        change,
        converged,
        // Nothing but I + Ω^½KΩ^½ is factorised.
        jitter: 0.0,
        weights: likelihood.observations.weights().to_vec(),
        condensed: None,
    })
}

/// What one pass of the iteration reads and writes: one entry per event in tilts and images, one for everything
/// observed in the others.
pub(super) struct Pass<'a> {
    pub(super) weights: &'a [f64],
    kappa: Vec<f64>,
    prior_mean: Vec<f64>,
    pub(super) tilts: Vec<f64>,
    omega: Vec<f64>,
    shift: Vec<f64>,
    /// About zero.
    pub(super) mean: Vec<f64>,
    variance: Vec<f64>,
    /// ln c after the pass.
    pub(super) images: Vec<f64>,
}

impl<'a> Pass<'a> {
    fn new(prior: &Prior, likelihood: &Likelihood<'a>, options: &FitOptions<'_>) -> Result<Self> {
        let (events, size) = (likelihood.events(), likelihood.len());
        let (kappa, prior_mean) = (likelihood.kappa(), likelihood.prior_mean(prior.mean())?);
        Ok(Self {
            weights: likelihood.observations.weights(),
            tilts: options.start.map_or_else(|| vec![1.0; events], <[f64]>::to_vec),
            // What messages stand for has unit noise throughout.
            omega: vec![1.0; size],
            shift: kappa.iter().zip(&prior_mean).map(|(kappa, mean)| kappa - mean).collect(),
            kappa,
            prior_mean,
            mean: vec![0.0; size],
            variance: vec![0.0; size],
            images: vec![0.0; events],
        })
    }

    /// ω̄ and κ̃ of the events at the given ln c.
    fn set_sites(&mut self, log_tilts: &[f64]) {
        for (n, log_tilt) in log_tilts.iter().enumerate() {
            self.tilts[n] = log_tilt.exp().max(TILT_MIN);
            self.omega[n] = polya_gamma::mean(self.weights[n], self.tilts[n]).max(f64::MIN_POSITIVE);
            self.shift[n] = self.kappa[n] - self.omega[n] * self.prior_mean[n];
        }
    }

    /// The terms of E that are sums over what is observed.
    fn sum_terms(&self) -> f64 {
        let tilted = |n: usize| {
            let (tilt, omega) = (self.tilts[n], self.omega[n]);
            0.5 * omega * tilt * tilt - self.weights[n] * ln_2_cosh(0.5 * tilt)
        };
        let about_mean = |n: usize| (self.kappa[n] - 0.5 * self.omega[n] * self.prior_mean[n]) * self.prior_mean[n];
        (0..self.tilts.len()).map(tilted).sum::<f64>() + (0..self.kappa.len()).map(about_mean).sum::<f64>()
    }

    /// Takes the posterior mean from about the prior mean to about zero, and sets the images. The largest change of a
    /// tilt.
    fn set_images(&mut self) -> f64 {
        self.mean.iter_mut().zip(&self.prior_mean).for_each(|(mean, prior)| *mean += prior);
        let mut change = 0.0;
        for n in 0..self.tilts.len() {
            let tilt = (self.mean[n] * self.mean[n] + self.variance[n]).sqrt().max(TILT_MIN);
            change = f64::max(change, (tilt - self.tilts[n]).abs());
            self.images[n] = tilt.ln();
        }
        change
    }
}
