//! ω by mean field: a deterministic fixed point that maximises the evidence bound E (docs/method.md, sections 2 and 7).

use crate::anderson::Anderson;
use crate::error::{Error, Result, finite, positive, same_size};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, add_symmetric_product, dot, multiply_vector, squared_norm};
use crate::polya_gamma;
use crate::prior_mean::Prior;
use crate::sites::{Observations, Sites};

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
}

/// Mean field with the full Gaussian posterior. O(N³) an iteration, 2N² memory.
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
    let gram = prior.kernel().gram(observations.inputs())?;
    let size = observations.len();
    let (mut cholesky, mut scratch) = Cholesky::reserve(size);
    let mut whitened = Matrix::zeros(size, size);
    let (mut roots, mut projected, mut correction) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
    iterate(prior, observations, options, |sites, shift, mean, variance| {
        roots.iter_mut().zip(sites).for_each(|(root, omega)| *root = omega.sqrt());
        cholesky.refactorise("I + Ω^½KΩ^½", &mut scratch, |b| fill_scaled(b, &gram, &roots))?;
        for column in 0..size {
            let scaled = whitened.column_mut(column).iter_mut().zip(gram.column(column)).zip(&roots);
            scaled.for_each(|((out, k), root)| *out = k * root);
        }
        cholesky.solve_lower_matrix(&mut whitened);
        multiply_vector(whitened.view(), shift, &mut projected);
        multiply_vector(whitened.t(), &projected, &mut correction);
        multiply_vector(gram.view(), shift, mean);
        for n in 0..size {
            mean[n] -= correction[n];
            variance[n] = (gram[(n, n)] - squared_norm(whitened.column(n))).max(0.0);
        }
        Ok(0.5 * dot(mean, shift) - 0.5 * cholesky.log_determinant())
    })
}

/// Writes I + diag(roots)·K·diag(roots) to the lower triangle of `b`.
pub(crate) fn fill_scaled(b: &mut Matrix, gram: &Matrix, roots: &[f64]) {
    for column in 0..roots.len() {
        let root = roots[column];
        let entries = b.column_mut(column)[column..].iter_mut().zip(&gram.column(column)[column..]);
        entries.zip(&roots[column..]).for_each(|((out, k), other)| *out = root * k * other);
        b[(column, column)] += 1.0;
    }
}

/// Events that one block of the sparse fit takes: M × 256 doubles stay in the second-level cache.
const BLOCK: usize = 256;

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
    let features = Features::new(prior, observations.inputs(), inducing_points)?;
    let points = inducing_points.len();
    let (mut cholesky, mut scratch) = Cholesky::reserve(points);
    let mut precision = Matrix::zeros(points, points);
    let mut weights = vec![0.0; points];
    let mut fit = iterate(prior, observations, options, |omega, shift, mean, variance| {
        features.precision(omega, &mut precision);
        cholesky.refactorise("I + ΦᵀΩΦ", &mut scratch, |b| {
            b.copy_from(&precision);
            b.add_to_diagonal(1.0);
        })?;
        multiply_vector(features.by_event.view(), shift, &mut weights);
        cholesky.solve_lower(&mut weights);
        let explained = squared_norm(&weights);
        cholesky.solve_upper(&mut weights);
        multiply_vector(features.by_event.t(), &weights, mean);
        features.add_variance(&cholesky, variance);
        let slack: f64 = omega.iter().zip(&features.residual).map(|(omega, residual)| omega * residual).sum();
        Ok(0.5 * explained - 0.5 * cholesky.log_determinant() - 0.5 * slack)
    })?;
    fit.jitter = features.cholesky.jitter();
    Ok(fit)
}

/// Φᵀ = L⁻¹K_MN of events against inducing points, K_MM = LLᵀ, and what it leaves of each event's prior variance.
pub(crate) struct Features {
    pub(crate) cholesky: Cholesky,
    /// Φᵀ, M×N.
    pub(crate) by_event: Matrix,
    /// diag(K_NN − ΦΦᵀ), N, not negative.
    pub(crate) residual: Vec<f64>,
}

impl Features {
    /// O(NM²).
    pub(crate) fn new(prior: &Prior, inputs: &Inputs, inducing_points: &Inputs) -> Result<Self> {
        let cholesky = Cholesky::with_jitter("K_MM", &prior.kernel().gram(inducing_points)?)?;
        Self::with_cholesky(prior, inputs, inducing_points, cholesky)
    }

    /// The same with K_MM factorised beforehand.
    pub(crate) fn with_cholesky(
        prior: &Prior,
        inputs: &Inputs,
        inducing_points: &Inputs,
        cholesky: Cholesky,
    ) -> Result<Self> {
        let mut by_event = prior.kernel().cross(inducing_points, inputs)?;
        cholesky.solve_lower_matrix(&mut by_event);
        let diagonal = prior.kernel().diagonal(inputs)?;
        let residual =
            diagonal.iter().enumerate().map(|(n, k)| (k - squared_norm(by_event.column(n))).max(0.0)).collect();
        Ok(Self { cholesky, by_event, residual })
    }

    /// ΦᵀΩΦ, M×M, by blocks of events. O(NM²).
    pub(crate) fn precision(&self, omega: &[f64], out: &mut Matrix) {
        (0..out.columns()).for_each(|column| out.column_mut(column).fill(0.0));
        let mut block = Matrix::zeros(out.rows(), BLOCK.min(omega.len()));
        for first in (0..omega.len()).step_by(BLOCK) {
            let width = BLOCK.min(omega.len() - first);
            for column in 0..width {
                let root = omega[first + column].sqrt();
                let features = self.by_event.column(first + column);
                block.column_mut(column).iter_mut().zip(features).for_each(|(out, phi)| *out = root * phi);
            }
            add_symmetric_product(1.0, block.view().subcols(0, width), out);
        }
    }

    /// residual_n + φ_nᵀS⁻¹φ_n for S = `cholesky`, by blocks of events. O(NM²).
    fn add_variance(&self, cholesky: &Cholesky, variance: &mut [f64]) {
        let points = self.by_event.rows();
        let mut block = Matrix::zeros(points, BLOCK.min(variance.len()));
        for first in (0..variance.len()).step_by(BLOCK) {
            let width = BLOCK.min(variance.len() - first);
            for column in 0..width {
                block.column_mut(column).copy_from_slice(self.by_event.column(first + column));
            }
            cholesky.solve_lower_matrix(&mut block);
            for column in 0..width {
                let n = first + column;
                variance[n] = self.residual[n] + squared_norm(block.column(column));
            }
        }
    }
}

/// Tilts below this are this: ω̄ differs from its limit ¼ by less than rounding.
const TILT_MIN: f64 = 1e-9;

/// The fixed point c_n² = E_q\[f_n²\]. `posterior(omega, shift, mean, variance)` writes the posterior mean about the prior mean and
/// the variance at every event, and returns the terms of E that depend on the covariance.
fn iterate(
    prior: &Prior,
    observations: &Observations,
    options: &Options,
    mut posterior: impl FnMut(&[f64], &[f64], &mut [f64], &mut [f64]) -> Result<f64>,
) -> Result<MeanField> {
    options.check(observations.len())?;
    let mut pass = Pass::new(prior, observations, options)?;
    // The iteration runs in ln c, where acceleration cannot leave the domain.
    let mut log_tilts: Vec<f64> = pass.tilts.iter().map(|tilt| tilt.max(TILT_MIN).ln()).collect();
    let mut plain_step = log_tilts.clone();
    let mut anderson = Anderson::new();
    let (mut evidence, mut best) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
    let (mut change, mut iterations) = (f64::INFINITY, 0);
    while iterations < options.iterations_max && change > options.tolerance {
        iterations += 1;
        pass.set_sites(&log_tilts);
        evidence = posterior(&pass.omega, &pass.shift, &mut pass.mean, &mut pass.variance)?;
        evidence += pass.event_terms();
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
    let Pass { omega, mean, variance, tilts, .. } = pass;
    let sites = Sites::new(observations, omega)?;
    Ok(MeanField { sites, mean, variance, tilts, evidence, iterations, change, converged, jitter: 0.0 })
}

/// What one pass of the iteration reads and writes: one entry per event in every field.
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
    fn new(prior: &Prior, observations: &'a Observations, options: &Options) -> Result<Self> {
        let zeros = vec![0.0; observations.len()];
        Ok(Self {
            weights: observations.weights(),
            kappa: observations.kappa(),
            prior_mean: prior.mean().values(observations.inputs())?,
            tilts: options.start.clone().unwrap_or_else(|| vec![1.0; observations.len()]),
            omega: zeros.clone(),
            shift: zeros.clone(),
            mean: zeros.clone(),
            variance: zeros.clone(),
            images: zeros,
        })
    }

    /// ω̄ and κ̃ at the given ln c.
    fn set_sites(&mut self, log_tilts: &[f64]) {
        for (n, log_tilt) in log_tilts.iter().enumerate() {
            self.tilts[n] = log_tilt.exp();
            self.omega[n] = polya_gamma::mean(self.weights[n], self.tilts[n]).max(f64::MIN_POSITIVE);
            self.shift[n] = self.kappa[n] - self.omega[n] * self.prior_mean[n];
        }
    }

    /// The terms of E that are sums over events.
    fn event_terms(&self) -> f64 {
        let term = |n: usize| {
            let (tilt, omega, mean) = (self.tilts[n], self.omega[n], self.prior_mean[n]);
            let tilted = 0.5 * omega * tilt * tilt - self.weights[n] * ln_2_cosh(0.5 * tilt);
            tilted + (self.kappa[n] - 0.5 * omega * mean) * mean
        };
        (0..self.tilts.len()).map(term).sum()
    }

    /// Takes the posterior mean from about the prior mean to about zero, and sets the images. The largest change of a tilt.
    fn set_images(&mut self) -> f64 {
        let mut change = 0.0;
        for n in 0..self.tilts.len() {
            self.mean[n] += self.prior_mean[n];
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
