//! One pass of the dense mean-field iteration, from tilts to their images ([`crate::method::inference`]).

use super::mean_field::{TILT_MIN, TILT_START, omega};
use super::options::FitOptions;
use crate::error::Result;
use crate::likelihood::Likelihood;
use crate::prior::Prior;
use crate::special::ln_2_cosh;

/// The vectors of one pass. Tilts and images have one entry per event; the others have one entry per observation, and
/// messages count as further observations.
pub(super) struct Pass<'a> {
    pub(super) weights: &'a [f64],
    kappa: Vec<f64>,
    prior_mean: Vec<f64>,
    pub(super) tilts: Vec<f64>,
    pub(super) omega: Vec<f64>,
    pub(super) shift: Vec<f64>,
    /// Posterior mean about zero.
    pub(super) mean: Vec<f64>,
    pub(super) variance: Vec<f64>,
    /// ln c after the pass.
    pub(super) images: Vec<f64>,
}

impl<'a> Pass<'a> {
    pub(super) fn new(prior: &Prior, likelihood: &Likelihood<'a>, options: &FitOptions<'_>) -> Result<Self> {
        let (events, size) = (likelihood.events(), likelihood.len());
        let (kappa, prior_mean) = (likelihood.kappa(), likelihood.prior_mean(prior.mean())?);
        Ok(Self {
            weights: likelihood.observations.weights(),
            tilts: options.start.map_or_else(|| vec![TILT_START; events], <[f64]>::to_vec),
            // Observations that messages represent always have unit noise.
            omega: vec![1.0; size],
            shift: kappa.iter().zip(&prior_mean).map(|(kappa, mean)| kappa - mean).collect(),
            kappa,
            prior_mean,
            mean: vec![0.0; size],
            variance: vec![0.0; size],
            images: vec![0.0; events],
        })
    }

    /// Sets ω̄ and κ̃ of the events at the given ln c.
    pub(super) fn set_sites(&mut self, log_tilts: &[f64]) {
        for (n, log_tilt) in log_tilts.iter().enumerate() {
            self.tilts[n] = log_tilt.exp().max(TILT_MIN);
            self.omega[n] = omega(self.weights[n], self.tilts[n]);
            self.shift[n] = self.kappa[n] - self.omega[n] * self.prior_mean[n];
        }
    }

    /// Returns the terms of E that are sums over the observations.
    pub(super) fn sum_terms(&self) -> f64 {
        let tilted = |n: usize| {
            let (tilt, omega) = (self.tilts[n], self.omega[n]);
            0.5 * omega * tilt * tilt - self.weights[n] * ln_2_cosh(0.5 * tilt)
        };
        let about_mean = |n: usize| (self.kappa[n] - 0.5 * self.omega[n] * self.prior_mean[n]) * self.prior_mean[n];
        (0..self.tilts.len()).map(tilted).sum::<f64>() + (0..self.kappa.len()).map(about_mean).sum::<f64>()
    }

    /// Adds the prior mean to the posterior mean, sets the images, and returns the largest change of a tilt.
    pub(super) fn set_images(&mut self) -> f64 {
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
