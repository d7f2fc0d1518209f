//! The fixed point of the mean field: an iteration over ω that knows two kinds of Gaussian posterior by their trait
//! alone (sections 2 and 7 of [`crate::method`]).

use super::anderson::Anderson;
use super::options::FitOptions;
use crate::error::{Result, finite};
use crate::likelihood::Likelihood;
use crate::linalg::Matrix;
use crate::polya_gamma;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::special::ln_2_cosh;

/// A Gaussian posterior that can be updated for other ω.
pub(crate) trait Engine {
    /// Writes the posterior mean about the prior mean and the variance of everything observed, and returns the terms of
    /// E that depend on the covariance.
    fn pass(&mut self, omega: &[f64], shift: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Result<f64>;

    /// Where Newton's method goes from the last pass, in ln c of the events; none where it is not worth its
    /// price, or where rounding spoils it.
    fn newton(&mut self, _pass: &Pass<'_>, _log_tilts: &[f64]) -> Option<Vec<f64>> {
        None
    }

    /// ∂E/∂(log parameters of the kernel) at the ω and shift of the last pass.
    fn kernel_gradient(&mut self, prior: &Prior, likelihood: &Likelihood<'_>, omega: &[f64]) -> Vec<f64>;

    /// α = κ̃ − Ωδ of the last pass, which is ∂E/∂μ₀ of everything observed.
    fn alpha(&self) -> &[f64];

    /// Prior variance of the first `events` that no pass can explain.
    fn residual(&self, events: usize) -> Vec<f64>;

    /// What was added to the diagonal of K_MM.
    fn jitter(&self) -> f64;

    /// Ĝ and b̂ of everything observed in the last pass, at inducing points.
    fn condensed(&self) -> Option<(Matrix, Vec<f64>)> {
        None
    }
}

/// Where the iteration ended. One entry per event in every list.
#[derive(Debug, Clone)]
pub(crate) struct MeanField {
    /// At the mean ω̄ = tanh(c/2)/(2c).
    pub(crate) sites: Sites,
    /// Posterior means of f at the events.
    pub(crate) mean: Vec<f64>,
    /// Posterior variances of f at the events.
    pub(crate) variance: Vec<f64>,
    /// The part of `variance` that inducing points leave unexplained; zeros without any.
    pub(crate) residual: Vec<f64>,
    /// c_n = √E\[f_n²\] that ω̄ was computed from.
    pub(crate) tilts: Vec<f64>,
    /// E, in nats.
    pub(crate) evidence: f64,
    pub(crate) iterations: usize,
    /// Largest change of a tilt in the last iteration.
    pub(crate) change: f64,
    /// Whether `change` came below the tolerance.
    pub(crate) converged: bool,
    /// What was added to the diagonal of K_MM.
    pub(crate) jitter: f64,
    /// Weights of the events.
    pub(crate) weights: Vec<f64>,
    /// What a sparse fit without messages says of its events at its inducing points: Ĝ and b̂.
    pub(crate) condensed: Option<(Matrix, Vec<f64>)>,
}

/// Tilts below this are this: ω̄ differs from its limit ¼ by less than rounding.
const TILT_MIN: f64 = 1e-9;

/// The fixed point c_n² = E_q\[f_n²\], and ω of everything observed. When it returns, the engine holds the same pass.
pub(crate) fn iterate(
    engine: &mut impl Engine,
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    options: &FitOptions<'_>,
) -> Result<(MeanField, Vec<f64>)> {
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
    let (residual, jitter) = (engine.residual(likelihood.events()), engine.jitter());
    let converged = change <= options.tolerance;
    let Pass { omega, mut mean, mut variance, tilts, .. } = pass;
    let events = likelihood.events();
    let sites = Sites::new(likelihood.observations, omega[..events].to_vec())?;
    mean.truncate(events);
    variance.truncate(events);
    let weights = likelihood.observations.weights().to_vec();
    let condensed = if likelihood.has_messages() { None } else { engine.condensed() };
    let found = MeanField {
        sites,
        mean,
        variance,
        residual,
        tilts,
        evidence,
        iterations,
        change,
        converged,
        jitter,
        weights,
        condensed,
    };
    Ok((found, omega))
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
