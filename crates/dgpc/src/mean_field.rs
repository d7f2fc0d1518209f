//! ω by mean field: a deterministic fixed point that maximises the evidence bound E (docs/method.md, sections 2 and 7).

use crate::anderson::Anderson;
use crate::data::Data;
use crate::error::{Error, Result, finite, positive, same_size};
use crate::evidence::{dense_fit, sparse_fit};
use crate::inputs::Inputs;
use crate::polya_gamma;
use crate::posterior::Posterior;
use crate::predict::success_probability;
use crate::prior_mean::Prior;
use crate::sites::{Observations, Sites};
use crate::summary::Summary;

/// When to stop, and where to start.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Stop when no tilt changes by more than this in one iteration.
    pub tolerance: f64,
    /// Stop after so many iterations all the same; [`MeanField::change`] then says how far it was.
    pub iterations_max: usize,
    /// Tilts to start from, one per event, such as [`MeanField::tilts`] of a fit under a similar prior.
    pub start: Option<Vec<f64>>,
}

impl Default for Options {
    fn default() -> Self {
        Self { tolerance: 1e-10, iterations_max: 1000, start: None }
    }
}

impl Options {
    /// Checks the numbers for a fit of `events` events.
    fn check(&self, events: usize) -> Result<()> {
        let Self { tolerance, iterations_max, start } = self;
        if !(tolerance.is_finite() && *tolerance >= 0.0) {
            return Err(Error::OutOfRange {
                what: "tolerance",
                expected: "a finite number, at least 0",
                value: *tolerance,
            });
        }
        positive("largest number of iterations", *iterations_max as f64)?;
        if let Some(start) = start {
            same_size("tilts to start from, one per event", events, start.len())?;
            for &tilt in start {
                positive("tilt to start from", tilt)?;
            }
        }
        Ok(())
    }
}

/// A fitted mean field.
#[derive(Debug, Clone)]
pub struct MeanField {
    /// The Gaussian sites at the mean ω̄ = tanh(c/2)/(2c).
    pub sites: Sites,
    /// Posterior means of f at the events, N.
    pub mean: Vec<f64>,
    /// Posterior variances of f at the events, N.
    pub variance: Vec<f64>,
    /// Tilts c_n = √E\[f_n²\] that ω̄ was computed from, N.
    pub tilts: Vec<f64>,
    /// The evidence bound E, in nats: a lower bound on the log marginal likelihood.
    pub evidence: f64,
    /// Iterations used.
    pub iterations: usize,
    /// Largest change of a tilt in the last iteration.
    pub change: f64,
    /// Whether `change` came below the tolerance.
    pub converged: bool,
    /// What was added to the diagonal of K_MM (0 for a dense fit, which factorises nothing but I + Ω^½KΩ^½).
    pub jitter: f64,
    /// The part of `variance` that inducing points leave unexplained, N; zeros for a dense fit.
    residual: Vec<f64>,
    /// Weights of the events, N.
    weights: Vec<f64>,
}

impl MeanField {
    /// ln p(y_n | all other events), nearly: what every event's posterior becomes when its own site is taken away, without a
    /// second fit. Optimistic, because ω_n has seen y_n, and the more so the larger the variance. Weights do not count. N, in
    /// nats. O(N) (docs/method.md, section 7).
    pub fn leave_one_out(&self) -> Vec<f64> {
        (0..self.mean.len()).map(|n| self.cavity(n).log_predictive()).collect()
    }

    /// E with its slack taken out event by event: the Gaussian site that bounds an event's likelihood from below is replaced by
    /// the likelihood itself, integrated against what all other events say. No bound any more, but much nearer to the log
    /// marginal likelihood: expectation propagation's estimate of it, at the sites of the mean field. O(N) (docs/method.md,
    /// section 7).
    pub fn corrected_evidence(&self) -> f64 {
        let slack = |n: usize| {
            let cavity = self.cavity(n);
            self.weights[n] * (cavity.log_predictive() - cavity.log_site(self.tilts[n]))
        };
        self.evidence + (0..self.mean.len()).map(slack).sum::<f64>()
    }

    /// What all events but one say about f at that one.
    fn cavity(&self, n: usize) -> Cavity {
        let (omega, kappa) = (self.sites.omega()[n], self.sites.kappa()[n]);
        // Only the explained variance moves with the sites; explained⁻¹ − ω is positive but for rounding.
        let explained = (self.variance[n] - self.residual[n]).max(0.0);
        let share = (1.0 - omega * explained).max(f64::EPSILON);
        let mean = (self.mean[n] - explained * kappa) / share;
        Cavity { kappa: 0.5 * kappa.signum(), mean, explained: explained / share, residual: self.residual[n] }
    }
}

/// The latent function at an event, without the event.
struct Cavity {
    kappa: f64,
    mean: f64,
    explained: f64,
    /// Variance that inducing points leave unexplained.
    residual: f64,
}

impl Cavity {
    /// ln of the probability of the event's outcome.
    fn log_predictive(&self) -> f64 {
        let probability = success_probability(self.mean * self.kappa.signum(), self.explained + self.residual);
        probability.max(f64::MIN_POSITIVE).ln()
    }

    /// ln of the integral of the site that stands for the outcome: exp(κf − ½ωf² + ½ωc² − ln 2cosh(c/2)).
    fn log_site(&self, tilt: f64) -> f64 {
        let Cavity { kappa, mean, explained, residual } = self;
        let omega = polya_gamma::mean(1.0, tilt);
        let share = 1.0 + omega * explained;
        let quadratic = kappa * mean + 0.5 * kappa * kappa * explained - 0.5 * omega * mean * mean;
        0.5 * omega * (tilt * tilt - residual) - ln_2_cosh(0.5 * tilt) + quadratic / share - 0.5 * share.ln()
    }
}

/// Sites of more events beside what is known, all of which stays as it is: each has its own fixed point of c² = E f² given what is
/// known and itself. What a fit of everything would change besides is left to the next one. O(n²) an event.
///
/// # Errors
/// As [`Posterior::latent`].
pub fn beside(known: &Posterior, observations: &Observations) -> Result<Sites> {
    let latent = known.latent(observations.inputs())?;
    let one = |(((&mean, &variance), kappa), &weight): (((&f64, &f64), f64), &f64)| {
        // A start at ω's largest value; every step contracts, so a fixed number is enough.
        (0..BESIDE_ITERATIONS).fold(0.25, |omega, _| {
            let narrowed = variance / (1.0 + variance * omega);
            let moved = mean + narrowed * (kappa - omega * mean);
            polya_gamma::mean(weight, (moved * moved + narrowed).sqrt())
        })
    };
    let moments = latent.mean.iter().zip(&latent.variance);
    let omega = moments.zip(observations.kappa()).zip(observations.weights()).map(one).collect();
    Sites::new(observations, omega)
}

/// Steps to the fixed point of a single site.
const BESIDE_ITERATIONS: usize = 50;

/// Mean field with the full Gaussian posterior. O(N³) an iteration, 3N² memory.
///
/// ```
/// use dgpc::{mean_field, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term};
///
/// let inputs = Inputs::from_rows(&[[0.0], [1.0], [2.0], [3.0]])?;
/// let observations = Observations::new(inputs, vec![true, true, false, false])?;
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
/// let fit = mean_field::dense(&Prior::new(kernel, PriorMean::Zero)?, &observations, &Default::default())?;
/// assert!(fit.converged && fit.mean[0] > 0.0 && fit.mean[3] < 0.0);
/// # Ok::<(), dgpc::Error>(())
/// ```
///
/// # Errors
/// [`crate::Error::BadColumn`] when the prior needs columns that the inputs do not have; [`crate::Error::OutOfRange`] or
/// [`crate::Error::SizeMismatch`] for options that make no sense; [`crate::Error::NotPositiveDefinite`] or
/// [`crate::Error::NotFinite`] when numbers near the end of the range overflow.
pub fn dense(prior: &Prior, observations: &Observations, options: &Options) -> Result<MeanField> {
    dense_with_messages(prior, observations, &[], options)
}

/// The same given what others said: messages count with their kernel-free factors, whatever prior they were formed under. O(n³) an
/// iteration for n = events + all inducing points of the messages.
///
/// # Errors
/// As [`dense`]; [`crate::Error::NotPositiveDefinite`] also for a message with a clearly negative eigenvalue.
pub fn dense_with_messages(
    prior: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    options: &Options,
) -> Result<MeanField> {
    dense_fit(prior, &Data::new(observations, messages)?, options)
}

/// Mean field with a Gaussian posterior supported on M inducing points. O(NM²) an iteration, NM memory.
///
/// # Errors
/// As [`dense`]; [`crate::Error::NotPositiveDefinite`] also when the inducing points coincide too closely for any small jitter.
pub fn sparse(
    prior: &Prior,
    observations: &Observations,
    inducing_points: &Inputs,
    options: &Options,
) -> Result<MeanField> {
    sparse_with_messages(prior, observations, &[], inducing_points, options)
}

/// The same given what others said, as in [`dense_with_messages`]; the inducing points of the messages should be among those of the
/// fit. O(nM²) an iteration.
///
/// # Errors
/// As [`sparse`] and [`dense_with_messages`].
pub fn sparse_with_messages(
    prior: &Prior,
    observations: &Observations,
    messages: &[&Summary],
    inducing_points: &Inputs,
    options: &Options,
) -> Result<MeanField> {
    sparse_fit(prior, &Data::new(observations, messages)?, inducing_points, options)
}

/// A Gaussian posterior that can be updated for other ω.
pub(crate) trait Engine {
    /// Writes the posterior mean about the prior mean and the variance of everything observed, and returns the terms of E that
    /// depend on the covariance.
    fn pass(&mut self, omega: &[f64], shift: &[f64], mean: &mut [f64], variance: &mut [f64]) -> Result<f64>;

    /// ∂E/∂(log parameters of the kernel) at the ω and shift of the last pass.
    fn kernel_gradient(&self, prior: &Prior, data: &Data<'_>, omega: &[f64]) -> Vec<f64>;

    /// α = κ̃ − Ωδ of the last pass, which is ∂E/∂μ₀ of everything observed.
    fn alpha(&self) -> &[f64];

    /// Prior variance of the first `events` that no pass can explain.
    fn residual(&self, events: usize) -> Vec<f64>;

    /// What was added to the diagonal of K_MM.
    fn jitter(&self) -> f64;
}

/// Tilts below this are this: ω̄ differs from its limit ¼ by less than rounding.
const TILT_MIN: f64 = 1e-9;

/// The fixed point c_n² = E_q\[f_n²\], and ω of everything observed.
pub(crate) fn iterate(
    engine: &mut impl Engine,
    prior: &Prior,
    data: &Data<'_>,
    options: &Options,
) -> Result<(MeanField, Vec<f64>)> {
    options.check(data.events())?;
    let mut pass = Pass::new(prior, data, options)?;
    // The iteration runs in ln c, where acceleration cannot leave the domain.
    let mut log_tilts: Vec<f64> = pass.tilts.iter().map(|tilt| tilt.max(TILT_MIN).ln()).collect();
    let mut plain_step = log_tilts.clone();
    let mut anderson = Anderson::new();
    let (mut evidence, mut best) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let (mut change, mut iterations) = (f64::INFINITY, 0);
    while iterations < options.iterations_max && change > options.tolerance {
        iterations += 1;
        pass.set_sites(&log_tilts);
        evidence = engine.pass(&pass.omega, &pass.shift, &mut pass.mean, &mut pass.variance)?;
        evidence += pass.sum_terms();
        change = pass.set_images();
        // Plain steps never lower E. An accelerated one that did, or that overflowed, is taken back for the plain one, and
        // acceleration starts anew.
        let lowered = evidence.is_nan() || evidence < best - 1e-10 * best.abs();
        if lowered && log_tilts != plain_step {
            log_tilts.copy_from_slice(&plain_step);
            anderson.restart();
            change = f64::INFINITY;
            continue;
        }
        best = best.max(finite("evidence bound", evidence)?);
        plain_step.copy_from_slice(&pass.images);
        log_tilts = anderson.propose(&log_tilts, &pass.images);
    }
    let converged = change <= options.tolerance;
    let Pass { omega, mut mean, mut variance, tilts, .. } = pass;
    let events = data.events();
    let sites = Sites::new(data.observations, omega[..events].to_vec())?;
    mean.truncate(events);
    variance.truncate(events);
    let (residual, jitter) = (engine.residual(events), engine.jitter());
    let weights = data.observations.weights().to_vec();
    let fit =
        MeanField { sites, mean, variance, tilts, evidence, iterations, change, converged, jitter, residual, weights };
    Ok((fit, omega))
}

/// What one pass of the iteration reads and writes: one entry per event in tilts and images, one for everything observed in the
/// others.
struct Pass<'a> {
    weights: &'a [f64],
    kappa: Vec<f64>,
    prior_mean: Vec<f64>,
    tilts: Vec<f64>,
    omega: Vec<f64>,
    shift: Vec<f64>,
    mean: Vec<f64>,
    variance: Vec<f64>,
    /// ln c after the pass.
    images: Vec<f64>,
}

impl<'a> Pass<'a> {
    fn new(prior: &Prior, data: &Data<'a>, options: &Options) -> Result<Self> {
        let (events, size) = (data.events(), data.len());
        let (kappa, prior_mean) = (data.kappa(), data.prior_mean(prior.mean())?);
        Ok(Self {
            weights: data.observations.weights(),
            tilts: options.start.clone().unwrap_or_else(|| vec![1.0; events]),
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
            self.tilts[n] = log_tilt.exp();
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

    /// Takes the posterior mean from about the prior mean to about zero, and sets the images. The largest change of a tilt.
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

/// ln(2 cosh x), without overflow.
fn ln_2_cosh(x: f64) -> f64 {
    x.abs() + (-2.0 * x.abs()).exp().ln_1p()
}
