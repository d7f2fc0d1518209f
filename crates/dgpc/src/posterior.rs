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
    /// Where it was told something, n points: events and inducing points.
    support: Inputs,
    /// The mean about μ₀ at x is (whitened k(support, x))ᵀ · weights.
    weights: Vec<f64>,
    form: Form,
    jitter: f64,
}

/// How features and variance follow from k(support, x).
#[derive(Debug, Clone)]
enum Form {
    Sites(SiteForm),
    /// Concatenation: k(x, x) − tᵀt + tᵀCt, t whitened with the whole K_MM, C the stacked covariances, whitened likewise.
    Concatenated {
        gram: Cholesky,
        covariance: Matrix,
    },
}

/// Site fusion: t = W k(support, x), variance k(x, x) − ‖L_B⁻¹Rᵀt‖², B = I + RᵀTR = L_BL_Bᵀ.
#[derive(Debug, Clone)]
struct SiteForm {
    segments: Vec<Segment>,
    /// b̂, n.
    shift: Vec<f64>,
    /// RᵀTb̂, n.
    target: Vec<f64>,
    cholesky: Cholesky,
}

/// Some rows of the support: their part of W and of R.
#[derive(Debug, Clone)]
struct Segment {
    first: usize,
    part: Part,
}

#[derive(Debug, Clone)]
enum Part {
    /// Events: W = I, R = Ω^½.
    Events(Vec<f64>),
    /// A summary's inducing points: W = L⁻¹, Ĝ = RRᵀ.
    Block { whitening: Cholesky, root: Matrix },
}

impl Posterior {
    /// The prior, of which nothing is known yet, over inputs of this dimension.
    pub fn prior_alone(prior: &Prior, dimension: usize) -> Self {
        let (cholesky, _) = Cholesky::reserve(0);
        let form = SiteForm { segments: Vec::new(), shift: Vec::new(), target: Vec::new(), cholesky };
        let (prior, support) = (prior.clone(), Inputs::empty(dimension));
        Self { prior, support, weights: Vec::new(), form: Form::Sites(form), jitter: 0.0 }
    }

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
        let mut posterior = Self::prior_alone(prior, own.inputs().dimension());
        posterior.absorb(own, summaries)?;
        Ok(posterior)
    }

    /// Takes in more events and summaries. What was there stays; the result is that of [`Posterior::fuse`] with all of them, to
    /// rounding. O(n²m + m³) for m new events and inducing points on top of n.
    ///
    /// # Errors
    /// As [`Posterior::fuse`], and then nothing changed; [`Error::Different`] for a posterior by concatenation.
    pub fn absorb(&mut self, events: &Sites, summaries: &[&Summary]) -> Result<()> {
        let Form::Sites(form) = &self.form else {
            return Err(Error::Different { what: "what is absorbed and the posterior", of: "forms" });
        };
        let new = News::lay_out(&self.prior, self.support.len(), events, summaries)?;
        if new.support.is_empty() {
            return Ok(());
        }
        let mut support = self.support.clone();
        support.append(&new.support)?;
        // T = WKWᵀ between the new rows and the old ones (n×m), and among the new ones (m×m).
        let mut between = self.features(&new.support)?.transposed();
        whiten(&new.segments, self.support.len(), &mut between);
        let mut among = self.prior.kernel().gram(&new.support)?;
        whiten(&new.segments, self.support.len(), &mut among);
        let mut among = among.transposed();
        whiten(&new.segments, self.support.len(), &mut among);

        // RᵀTb̂ gains what the new shift does to all rows, and what the old shift does to the new ones.
        let mut old_gain = between.transposed_times(&new.shift);
        apply(&form.segments, 0, &mut old_gain, Matrix::transposed_times);
        let old_target = form.target.iter().zip(&old_gain).map(|(old, gain)| old + gain);
        let from_old = between.times(&form.shift);
        let mut new_target: Vec<f64> =
            among.times(&new.shift).iter().zip(&from_old).map(|(new, old)| new + old).collect();
        apply(&new.segments, self.support.len(), &mut new_target, Matrix::transposed_times);
        let target: Vec<f64> = old_target.chain(new_target).collect();

        // B gains m rows: [B, B₁ᵀ; B₁, I + RᵀTR among the new].
        rotate(&new.segments, self.support.len(), &mut between);
        let mut between = between.transposed();
        rotate(&form.segments, 0, &mut between);
        rotate(&new.segments, self.support.len(), &mut among);
        let mut corner = among.transposed();
        rotate(&new.segments, self.support.len(), &mut corner);
        corner.add_to_diagonal(1.0);
        let cholesky = form.cholesky.extended("I + RᵀTR", between, corner)?;

        // weights = b̂ − R B⁻¹ RᵀTb̂.
        let segments = [form.segments.as_slice(), &new.segments].concat();
        let shift = [form.shift.as_slice(), &new.shift].concat();
        let mut correction = target.clone();
        cholesky.solve(&mut correction);
        apply(&segments, 0, &mut correction, Matrix::times);
        self.weights = shift.iter().zip(&correction).map(|(shift, correction)| shift - correction).collect();
        self.support = support;
        self.jitter = self.jitter.max(new.jitter);
        self.form = Form::Sites(SiteForm { segments, shift, target, cholesky });
        Ok(())
    }

    /// Number of events and inducing points n that it holds: memory and the time of a prediction grow with n².
    pub fn len(&self) -> usize {
        self.support.len()
    }

    /// Whether it is the prior alone.
    pub fn is_empty(&self) -> bool {
        self.support.is_empty()
    }

    /// Concatenation (the paper's): the means and covariances of all summaries stacked, block by block. Right only where the
    /// summaries' regions do not overlap. O(M³) for M inducing points in all.
    ///
    /// # Errors
    /// As [`Posterior::fuse`]; also when the inducing points of all summaries together coincide too closely for any small jitter.
    pub fn concatenate(prior: &Prior, summaries: &[&Summary]) -> Result<Self> {
        let dimension = summaries.first().map_or(prior.dimension_min(), |first| first.inducing_points().dimension());
        let mut support = Inputs::empty(dimension);
        for summary in summaries {
            check_prior(prior, summary)?;
            support.append(summary.inducing_points())?;
        }
        let size = support.len();
        let gram = Cholesky::with_jitter("K_MM of all summaries", &prior.kernel().gram(&support)?)?;
        let mut covariance = Matrix::zeros(size, size);
        let mut weights = Vec::with_capacity(size);
        for summary in summaries {
            let first = weights.len();
            let (mean, block) = summary.moments()?;
            let prior_mean = prior.mean().values(summary.inducing_points())?;
            weights.extend(mean.iter().zip(&prior_mean).map(|(mean, prior)| mean - prior));
            for column in 0..block.columns() {
                covariance.column_mut(first + column)[first..first + block.rows()]
                    .copy_from_slice(block.column(column));
            }
        }
        gram.solve_lower(&mut weights);
        let covariance = gram.whiten(covariance);
        let jitter = summaries.iter().map(|summary| summary.jitter()).fold(gram.jitter(), f64::max);
        let form = Form::Concatenated { gram, covariance };
        Ok(Self { prior: prior.clone(), support, weights, form, jitter })
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
            let stacked = match &self.form {
                Form::Concatenated { covariance, .. } => Some(product(covariance.view(), features.view())),
                Form::Sites(_) => None,
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

    /// Joint mean about μ₀ (M) and covariance (M×M) of the latent function at `inputs`. O(Mn² + M²n).
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn joint(&self, inputs: &Inputs) -> Result<(Vec<f64>, Matrix)> {
        let mut features = self.features(inputs)?;
        let mean = features.transposed_times(&self.weights);
        let mut covariance = self.prior.kernel().gram(inputs)?;
        if let Form::Concatenated { covariance: stacked, .. } = &self.form {
            let half = product(stacked.view(), features.view());
            covariance.add_scaled(1.0, &product(features.t(), half.view()));
        }
        self.explain(&mut features);
        covariance.add_scaled(-1.0, &product(features.t(), features.view()));
        covariance.symmetrise();
        Ok((mean, covariance))
    }

    /// What this posterior says about f at `inducing_points`: the message that takes the prior there to this posterior's joint
    /// mean and covariance. For a posterior of events alone this is [`Summary::marginal`]. O(Mn²).
    ///
    /// # Errors
    /// As [`Posterior::latent`] and [`Summary::empty`].
    pub fn summarise(&self, inducing_points: &Inputs) -> Result<Summary> {
        let (mean, covariance) = self.joint(inducing_points)?;
        Summary::from_moments(&self.prior, inducing_points, &mean, &covariance)
    }

    /// What somebody who knows `known` is missing of this posterior at `inducing_points`: see [`Summary::beyond`].
    ///
    /// # Errors
    /// As [`Posterior::summarise`] of both.
    pub fn beyond(&self, known: &Posterior, inducing_points: &Inputs) -> Result<Summary> {
        self.summarise(inducing_points)?.beyond(&known.summarise(inducing_points)?)
    }

    /// Whitened k(support, x), one column per point.
    fn features(&self, inputs: &Inputs) -> Result<Matrix> {
        let mut features = self.prior.kernel().cross(&self.support, inputs)?;
        match &self.form {
            Form::Sites(form) => whiten(&form.segments, 0, &mut features),
            Form::Concatenated { gram, .. } => gram.solve_lower_matrix(&mut features),
        }
        Ok(features)
    }

    /// Turns whitened features into those whose squared norm is the prior variance explained.
    fn explain(&self, features: &mut Matrix) {
        if let Form::Sites(form) = &self.form {
            rotate(&form.segments, 0, features);
            form.cholesky.solve_lower_matrix(features);
        }
    }
}

/// What a posterior is about to take in.
struct News {
    support: Inputs,
    segments: Vec<Segment>,
    shift: Vec<f64>,
    jitter: f64,
}

impl News {
    /// Events first, then every summary's inducing points, as rows from `first` on.
    fn lay_out(prior: &Prior, first: usize, events: &Sites, summaries: &[&Summary]) -> Result<Self> {
        let mut new = Self {
            support: events.inputs().clone(),
            segments: Vec::new(),
            shift: events.shift(prior.mean())?,
            jitter: 0.0,
        };
        if !events.is_empty() {
            let roots = events.omega().iter().map(|omega| omega.sqrt()).collect();
            new.segments.push(Segment { first, part: Part::Events(roots) });
        }
        for summary in summaries {
            check_prior(prior, summary)?;
            let part = Part::Block { whitening: summary.cholesky().clone(), root: summary.root()? };
            new.segments.push(Segment { first: first + new.support.len(), part });
            new.support.append(summary.inducing_points())?;
            new.shift.extend_from_slice(summary.whitened_shift());
            new.jitter = new.jitter.max(summary.jitter());
        }
        Ok(new)
    }
}

fn check_prior(prior: &Prior, summary: &Summary) -> Result<()> {
    if summary.prior() != prior {
        return Err(Error::Different { what: "posterior and summary", of: "priors" });
    }
    Ok(())
}

/// X ← WX, where the rows of X are those of the support from `offset` on.
fn whiten(segments: &[Segment], offset: usize, matrix: &mut Matrix) {
    for Segment { first, part } in segments {
        if let Part::Block { whitening, .. } = part {
            whitening.solve_lower_rows(matrix, first - offset);
        }
    }
}

/// X ← RᵀX, rows as in [`whiten`].
fn rotate(segments: &[Segment], offset: usize, matrix: &mut Matrix) {
    for Segment { first, part } in segments {
        let first = first - offset;
        match part {
            Part::Block { root, .. } => multiply_rows(root.t(), matrix, first),
            Part::Events(roots) => {
                for column in 0..matrix.columns() {
                    let entries = &mut matrix.column_mut(column)[first..first + roots.len()];
                    entries.iter_mut().zip(roots).for_each(|(entry, root)| *entry *= root);
                }
            }
        }
    }
}

/// x ← Rx or Rᵀx, as `product` says, rows as in [`whiten`].
fn apply(segments: &[Segment], offset: usize, x: &mut [f64], product: impl Fn(&Matrix, &[f64]) -> Vec<f64>) {
    for Segment { first, part } in segments {
        let x = &mut x[first - offset..];
        match part {
            Part::Events(roots) => x.iter_mut().zip(roots).for_each(|(entry, root)| *entry *= root),
            Part::Block { root, .. } => {
                let rotated = product(root, &x[..root.rows()]);
                x[..root.rows()].copy_from_slice(&rotated);
            }
        }
    }
}
