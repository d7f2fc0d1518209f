//! Own events and everybody's summaries put together (docs/method.md, section 6).

use crate::error::{Error, Result, finite};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, dot, multiply_rows, product, squared_norm};
use crate::predict::Latent;
use crate::prior_mean::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// Points that one block of predictions takes, so that memory stays bounded for any number of points.
const BLOCK: usize = 512;

/// A Gaussian posterior over the latent function that predicts anywhere.
#[derive(Debug, Clone)]
pub struct Posterior {
    prior: Prior,
    /// Own events first, then the inducing points of every summary: n points in all.
    support: Inputs,
    whitening: Vec<Whitening>,
    /// The mean about μ₀ at x is (whitened k(support, x))ᵀ · weights.
    weights: Vec<f64>,
    spread: Spread,
    jitter: f64,
}

/// L⁻¹ for the rows of one summary.
#[derive(Debug, Clone)]
struct Whitening {
    first: usize,
    cholesky: Cholesky,
}

/// How the variance follows from t = whitened k(support, x).
#[derive(Debug, Clone)]
enum Spread {
    /// Site fusion: k(x, x) − ‖L_B⁻¹Rᵀt‖², R = blockdiag(Ω^½, roots).
    Sites { site_roots: Vec<f64>, block_roots: Vec<Matrix>, cholesky: Cholesky },
    /// Concatenation: k(x, x) − tᵀt + tᵀCt, t whitened with the whole K_MM, C the stacked covariances, whitened likewise.
    Concatenated { gram: Cholesky, covariance: Matrix },
}

impl Posterior {
    /// Site fusion: the prior counted once, own events as sites at their own inputs, every summary as a site at its inducing
    /// points. Exact given ω for events alone; never forms K⁻¹ or an explicit precision, and needs no jitter of its own.
    /// O(n³) for n = events + all inducing points.
    ///
    /// ```
    /// use dgpc::{mean_field, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Shape, Summary, Term};
    ///
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 2.0, 1.0, 1)?])?;
    /// let prior = Prior::new(kernel, PriorMean::Zero)?;
    /// let events = |x: &[[f64; 1]], y| Observations::new(Inputs::from_rows(x)?, y);
    /// let own = mean_field::dense(&prior, &events(&[[0.0], [0.5]], vec![true, true])?, &Default::default())?;
    /// let theirs = mean_field::dense(&prior, &events(&[[3.0], [3.5]], vec![false, false])?, &Default::default())?;
    /// let packet = Summary::marginal(&prior, &theirs.sites, &Inputs::from_rows(&[[3.2]])?)?;
    /// let fused = Posterior::fuse(&prior, &own.sites, &[&packet])?;
    /// let p = fused.latent(&Inputs::from_rows(&[[0.2], [3.3]])?)?.probability();
    /// assert!(p[0] > 0.5 && p[1] < 0.5);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Different`] when a summary was formed under another prior (see [`Summary::under`]),
    /// [`Error::BadColumn`] or [`Error::SizeMismatch`] when inputs do not fit the prior or each other,
    /// [`Error::NotPositiveDefinite`] when a summary's precision has a clearly negative eigenvalue.
    pub fn fuse(prior: &Prior, own: &Sites, summaries: &[&Summary]) -> Result<Self> {
        let (support, whitening) = lay_out(prior, own.inputs(), summaries)?;
        let block_roots = summaries.iter().map(|summary| summary.root()).collect::<Result<Vec<_>>>()?;
        let site_roots: Vec<f64> = own.omega().iter().map(|omega| omega.sqrt()).collect();

        // T = blockdiag(I, L⁻¹) K blockdiag(I, L⁻ᵀ), and the stacked shift b̂.
        let mut gram = prior.kernel().gram(&support)?;
        whiten(&whitening, &mut gram);
        let mut gram = gram.transposed();
        whiten(&whitening, &mut gram);
        let mut shift = own.shift(prior.mean())?;
        summaries.iter().for_each(|summary| shift.extend_from_slice(summary.whitened_shift()));

        // weights = b̂ − R B⁻¹ Rᵀ T b̂, B = I + RᵀTR.
        let roots = Roots { site_roots: &site_roots, block_roots: &block_roots, whitening: &whitening };
        let mut correction = gram.times(&shift);
        roots.apply_transposed(&mut correction);
        let mut system = gram;
        roots.rotate(&mut system);
        let mut system = system.transposed();
        roots.rotate(&mut system);
        system.add_to_diagonal(1.0);
        let cholesky = Cholesky::new("I + RᵀTR", system)?;
        cholesky.solve(&mut correction);
        roots.apply(&mut correction);
        let weights = shift.iter().zip(&correction).map(|(shift, correction)| shift - correction).collect();

        let jitter = summaries.iter().map(|summary| summary.jitter()).fold(0.0, f64::max);
        let spread = Spread::Sites { site_roots, block_roots, cholesky };
        Ok(Self { prior: prior.clone(), support, whitening, weights, spread, jitter })
    }

    /// Concatenation (the paper's): the means and covariances of all summaries stacked, block by block. Right only where the
    /// summaries' regions do not overlap. O(M³) for M inducing points in all.
    ///
    /// # Errors
    /// As [`Posterior::fuse`]; also when the inducing points of all summaries together coincide too closely for any small jitter.
    pub fn concatenate(prior: &Prior, summaries: &[&Summary]) -> Result<Self> {
        let dimension = summaries.first().map_or(prior.dimension_min(), |first| first.inducing_points().dimension());
        let (support, whitening) = lay_out(prior, &Inputs::empty(dimension), summaries)?;
        let size = support.len();
        let gram = Cholesky::with_jitter("K_MM of all summaries", &prior.kernel().gram(&support)?)?;
        let mut covariance = Matrix::zeros(size, size);
        let mut weights = Vec::with_capacity(size);
        for (summary, Whitening { first, .. }) in summaries.iter().zip(&whitening) {
            let (mean, block) = summary.moments()?;
            let prior_mean = prior.mean().values(summary.inducing_points())?;
            weights.extend(mean.iter().zip(&prior_mean).map(|(mean, prior)| mean - prior));
            for column in 0..block.columns() {
                covariance.column_mut(first + column)[*first..first + block.rows()]
                    .copy_from_slice(block.column(column));
            }
        }
        gram.solve_lower(&mut weights);
        let covariance = gram.whiten(covariance);
        let jitter = summaries.iter().map(|summary| summary.jitter()).fold(gram.jitter(), f64::max);
        let spread = Spread::Concatenated { gram, covariance };
        Ok(Self { prior: prior.clone(), support, whitening: Vec::new(), weights, spread, jitter })
    }

    /// The prior under which everything was put together.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// The largest jitter that any factorisation behind this posterior needed (0 in the ordinary case).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Latent mean and variance at every point. O(n²) a point, in blocks: memory does not grow with the number of points.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] or [`Error::BadColumn`] when the inputs do not fit, [`Error::NotFinite`] when numbers near the end of
    /// the range overflow.
    pub fn latent(&self, inputs: &Inputs) -> Result<Latent> {
        let mut latent =
            Latent { mean: self.prior.mean().values(inputs)?, variance: self.prior.kernel().diagonal(inputs)? };
        for first in (0..inputs.len()).step_by(BLOCK) {
            let block = inputs.slice(first..inputs.len().min(first + BLOCK));
            let mut features = self.features(&block)?;
            let stacked = match &self.spread {
                Spread::Concatenated { covariance, .. } => Some(product(covariance.view(), features.view())),
                Spread::Sites { .. } => None,
            };
            for n in 0..block.len() {
                latent.mean[first + n] += dot(features.column(n), &self.weights);
                if let Some(stacked) = &stacked {
                    latent.variance[first + n] += dot(features.column(n), stacked.column(n));
                }
            }
            self.explain(&mut features);
            for n in 0..block.len() {
                let variance = latent.variance[first + n] - squared_norm(features.column(n));
                finite("latent mean", latent.mean[first + n])?;
                latent.variance[first + n] = finite("latent variance", variance)?.max(0.0);
            }
        }
        Ok(latent)
    }

    /// Probability of success at every point. See [`Posterior::latent`].
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn probability(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        Ok(self.latent(inputs)?.probability())
    }

    /// What this posterior says about f at `inducing_points`: the message that takes the prior there to this posterior's joint
    /// mean and covariance. For a posterior of events alone this is [`Summary::marginal`]. O(Mn²).
    ///
    /// # Errors
    /// As [`Posterior::latent`] and [`Summary::empty`].
    pub fn summarise(&self, inducing_points: &Inputs) -> Result<Summary> {
        let mut features = self.features(inducing_points)?;
        let mean: Vec<f64> = (0..inducing_points.len()).map(|n| dot(features.column(n), &self.weights)).collect();
        let mut covariance = self.prior.kernel().gram(inducing_points)?;
        if let Spread::Concatenated { covariance: stacked, .. } = &self.spread {
            let half = product(stacked.view(), features.view());
            covariance.add_scaled(1.0, &product(features.t(), half.view()));
        }
        self.explain(&mut features);
        covariance.add_scaled(-1.0, &product(features.t(), features.view()));
        Summary::from_moments(&self.prior, inducing_points, &mean, &covariance)
    }

    /// Whitened k(support, x), one column per point.
    fn features(&self, inputs: &Inputs) -> Result<Matrix> {
        let mut features = self.prior.kernel().cross(&self.support, inputs)?;
        match &self.spread {
            Spread::Sites { .. } => whiten(&self.whitening, &mut features),
            Spread::Concatenated { gram, .. } => gram.solve_lower_matrix(&mut features),
        }
        Ok(features)
    }

    /// Turns whitened features into those whose squared norm is the prior variance explained.
    fn explain(&self, features: &mut Matrix) {
        if let Spread::Sites { site_roots, block_roots, cholesky } = &self.spread {
            Roots { site_roots, block_roots, whitening: &self.whitening }.rotate(features);
            cholesky.solve_lower_matrix(features);
        }
    }
}

/// Own inputs, then every summary's inducing points, and where each summary starts.
fn lay_out(prior: &Prior, own: &Inputs, summaries: &[&Summary]) -> Result<(Inputs, Vec<Whitening>)> {
    let mut support = own.clone();
    let mut whitening = Vec::with_capacity(summaries.len());
    for summary in summaries {
        if summary.prior() != prior {
            return Err(Error::Different { what: "posterior and summary", of: "priors" });
        }
        whitening.push(Whitening { first: support.len(), cholesky: summary.cholesky().clone() });
        support.append(summary.inducing_points())?;
    }
    Ok((support, whitening))
}

/// Multiplies each summary's rows by its L⁻¹.
fn whiten(whitening: &[Whitening], matrix: &mut Matrix) {
    whitening.iter().for_each(|Whitening { first, cholesky }| cholesky.solve_lower_rows(matrix, *first));
}

/// R = blockdiag(Ω^½, roots of the summaries' precisions).
struct Roots<'a> {
    site_roots: &'a [f64],
    block_roots: &'a [Matrix],
    whitening: &'a [Whitening],
}

impl Roots<'_> {
    /// X ← RᵀX.
    fn rotate(&self, matrix: &mut Matrix) {
        for column in 0..matrix.columns() {
            matrix.column_mut(column).iter_mut().zip(self.site_roots).for_each(|(entry, root)| *entry *= root);
        }
        for (root, Whitening { first, .. }) in self.block_roots.iter().zip(self.whitening) {
            multiply_rows(root.t(), matrix, *first);
        }
    }

    /// x ← Rᵀx.
    fn apply_transposed(&self, x: &mut [f64]) {
        self.each_block(x, |root, part| root.transposed_times(part));
    }

    /// x ← Rx.
    fn apply(&self, x: &mut [f64]) {
        self.each_block(x, |root, part| root.times(part));
    }

    fn each_block(&self, x: &mut [f64], product: impl Fn(&Matrix, &[f64]) -> Vec<f64>) {
        x.iter_mut().zip(self.site_roots).for_each(|(entry, root)| *entry *= root);
        for (root, Whitening { first, .. }) in self.block_roots.iter().zip(self.whitening) {
            let part = &mut x[*first..first + root.rows()];
            let rotated = product(root, part);
            part.copy_from_slice(&rotated);
        }
    }
}
