//! Gibbs sampling of ω and f ([`crate::method::inference`]).

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use crate::error::{Error, Result, all_finite, same_size};
use crate::linalg::{Cholesky, CholeskyScratch, Matrix, fill_scaled, multiply_vector};
use crate::observations::Observations;
use crate::polya_gamma;
use crate::prior::Prior;
use crate::sites::Sites;

/// The largest event weight, which is the number of Pólya-Gamma draws for the event in each sweep.
const WEIGHT_MAX: f64 = 1e6;

/// A Markov chain over (ω, f) whose stationary distribution is their exact posterior.
///
/// One sweep draws ω_n ~ PG(w_n, f_n), then f | ω, y by pathwise conditioning. Pathwise conditioning corrects a prior
/// draw with one Cholesky factorisation of I + Ω^½KΩ^½. A sweep costs O(N³/3), plus one Pólya-Gamma draw for every unit
/// of weight, and allocates nothing. The chain holds 3N² numbers.
///
/// ```
/// use dgpc::{Gibbs, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term};
/// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
///
/// let observations = Observations::new(Inputs::from_rows(&[[0.0], [1.0]])?, vec![true, false])?;
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 1.0, 1.0, 1)?])?;
/// let mut chain = Gibbs::new(&Prior::new(kernel, PriorMean::Zero)?, observations)?;
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// for _ in 0..100 {
///     chain.sweep(&mut rng)?;
/// }
/// let sites = chain.sites()?; // feeds summaries and posteriors
/// assert_eq!(sites.len(), 2);
/// # Ok::<(), dgpc::Error>(())
/// ```
#[must_use]
pub struct Gibbs {
    observations: Observations,
    prior_mean: Vec<f64>,
    gram: Matrix,
    /// L with LLᵀ = K, zeros above its diagonal; draws the prior.
    prior_root: Matrix,
    jitter: f64,
    latent: Vec<f64>,
    omega: Vec<f64>,
    cholesky: Cholesky,
    scratch: CholeskyScratch,
    roots: Vec<f64>,
    normals: Vec<f64>,
    prior_draw: Vec<f64>,
    residual: Vec<f64>,
}

impl Gibbs {
    /// Creates a chain that starts at f = μ₀. O(N³/3).
    ///
    /// # Errors
    /// * [`Error::FractionalWeight`] for event weights that are not whole or above 1e6.
    /// * [`Error::BadColumn`] if the prior needs columns that the inputs do not have.
    /// * [`Error::NotPositiveDefinite`] if K cannot be factorised even with jitter.
    pub fn new(prior: &Prior, observations: Observations) -> Result<Self> {
        let weights = observations.weights().iter().enumerate();
        if let Some((event, &weight)) = weights.into_iter().find(|(_, w)| w.fract() != 0.0 || **w > WEIGHT_MAX) {
            return Err(Error::FractionalWeight { event, weight });
        }
        let size = observations.len();
        let mut gram = prior.kernel().gram(observations.inputs())?;
        let prior_cholesky = Cholesky::with_jitter("K", &gram)?;
        // With the jitter in K, the chain is exact for the prior that it draws from.
        gram.add_to_diagonal(prior_cholesky.jitter());
        let prior_mean = prior.mean().values(observations.inputs())?;
        let (cholesky, scratch) = Cholesky::reserve(size);
        Ok(Self {
            latent: prior_mean.clone(),
            prior_mean,
            gram,
            prior_root: prior_cholesky.lower(),
            jitter: prior_cholesky.jitter(),
            omega: vec![0.25; size],
            cholesky,
            scratch,
            roots: vec![0.0; size],
            normals: vec![0.0; size],
            prior_draw: vec![0.0; size],
            residual: vec![0.0; size],
            observations,
        })
    }

    /// Runs one sweep: draws ω given f, then f given ω and the outcomes.
    ///
    /// # Errors
    /// [`Error::NotPositiveDefinite`] if I + Ω^½KΩ^½ cannot be factorised, and [`Error::NotFinite`] if f overflows.
    /// Both occur only with numbers near the end of the floating-point range.
    pub fn sweep<R: Rng + ?Sized>(&mut self, rng: &mut R) -> Result<()> {
        for ((omega, &latent), &weight) in self.omega.iter_mut().zip(&self.latent).zip(self.observations.weights()) {
            *omega = (0..weight as u64).map(|_| polya_gamma::sample(rng, latent)).sum::<Result<f64>>()?;
        }
        self.draw_latent(rng)
    }

    /// Draws f = μ₀ + f₀ + KΩ^½B⁻¹(Ω^−½κ̃ − Ω^½f₀ − ε) with f₀ ~ N(0, K) and ε ~ N(0, I).
    fn draw_latent<R: Rng + ?Sized>(&mut self, rng: &mut R) -> Result<()> {
        let (gram, roots) = (&self.gram, &mut self.roots);
        roots.iter_mut().zip(&self.omega).for_each(|(root, omega)| *root = omega.sqrt());
        self.cholesky.refactorise("I + Ω^½KΩ^½", &mut self.scratch, |b| fill_scaled(b, gram, roots))?;
        self.normals.iter_mut().for_each(|normal| *normal = rng.sample(StandardNormal));
        multiply_vector(self.prior_root.view(), &self.normals, &mut self.prior_draw);
        let (outcomes, weights) = (self.observations.outcomes(), self.observations.weights());
        for n in 0..self.omega.len() {
            let kappa = if outcomes[n] { 0.5 * weights[n] } else { -0.5 * weights[n] };
            let shift = kappa - self.omega[n] * self.prior_mean[n];
            let noise: f64 = rng.sample(StandardNormal);
            self.residual[n] = shift / self.roots[n] - self.roots[n] * self.prior_draw[n] - noise;
        }
        self.cholesky.solve(&mut self.residual);
        self.residual.iter_mut().zip(&self.roots).for_each(|(residual, root)| *residual *= root);
        multiply_vector(self.gram.view(), &self.residual, &mut self.latent);
        for n in 0..self.omega.len() {
            self.latent[n] += self.prior_mean[n] + self.prior_draw[n];
        }
        all_finite("latent draw", &self.latent)
    }

    /// Returns the current f at the events, N.
    pub fn latent(&self) -> &[f64] {
        &self.latent
    }

    /// Returns the current ω, N.
    pub fn omega(&self) -> &[f64] {
        &self.omega
    }

    /// Returns the Gaussian sites at the current ω. Average results over the sites of several sweeps.
    ///
    /// # Errors
    /// None in practice, because ω is positive.
    pub fn sites(&self) -> Result<Sites> {
        Sites::new(&self.observations, self.omega.clone())
    }

    /// Returns the jitter that was added to the diagonal of K to draw from the prior (ordinarily 0).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Replaces the outcomes and continues from the current f. Simulation checks of the sampler need this.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the number of outcomes differs from the number of events.
    pub fn replace_outcomes(&mut self, outcomes: Vec<bool>) -> Result<()> {
        same_size("outcomes, one per input", self.observations.len(), outcomes.len())?;
        let (inputs, weights) = (self.observations.inputs().clone(), self.observations.weights().to_vec());
        self.observations = Observations::weighted(inputs, outcomes, weights)?;
        Ok(())
    }
}
