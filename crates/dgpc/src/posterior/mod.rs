//! Own events and everybody's summaries put together (section 6 of [`crate::method`]).

mod prediction;

use crate::error::{Error, Result, same_size};
use crate::inputs::Inputs;
use crate::linalg::{Cholesky, Matrix, multiply_rows};
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// A Gaussian posterior over the latent function that predicts anywhere.
///
/// Site fusion: the prior counted once, events as sites at their own inputs, every summary as a site at its inducing
/// points. Exact given ω for events alone. It grows by what is absorbed.
#[derive(Debug, Clone)]
pub struct Posterior {
    prior: Prior,
    /// Where it was told something, n points: events and inducing points.
    support: Inputs,
    /// Which rows of the support are what.
    segments: Vec<Segment>,
    /// b̂, n.
    shift: Vec<f64>,
    /// RᵀTb̂, n.
    target: Vec<f64>,
    /// Of B = I + RᵀTR.
    cholesky: Cholesky,
    /// The mean about μ₀ at x is (whitened k(support, x))ᵀ · weights.
    weights: Vec<f64>,
    jitter: f64,
}

/// Some rows of the support: their part of W and of R. With t = W k(support, x) the variance at x is k(x, x) −
/// ‖L_B⁻¹Rᵀt‖².
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
        Self {
            prior: prior.clone(),
            support: Inputs::empty(dimension),
            segments: Vec::new(),
            shift: Vec::new(),
            target: Vec::new(),
            cholesky,
            weights: Vec::new(),
            jitter: 0.0,
        }
    }

    /// The posterior of events at known ω. Never forms K⁻¹, and needs no jitter. O(N³).
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn of_sites(prior: &Prior, sites: &Sites) -> Result<Self> {
        Self::fuse(prior, sites, &[])
    }

    /// The posterior of summaries alone, such as what a listener knows by them. O(n³) for n inducing points in all.
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn of_summaries(prior: &Prior, summaries: &[&Summary]) -> Result<Self> {
        let dimension = summaries.first().map_or(prior.dimension_min(), |first| first.inducing_points().dimension());
        let mut posterior = Self::prior_alone(prior, dimension);
        posterior.absorb_summaries(summaries)?;
        Ok(posterior)
    }

    /// The posterior of own events and of others' summaries. Never forms K⁻¹ or an explicit precision, and needs no
    /// jitter of its own. O(n³) for n = events + all inducing points.
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Posterior, Prior, PriorMean, Shape, Summary, Term, fit};
    ///
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 2.0, 1.0, 1)?])?;
    /// let prior = Prior::new(kernel, PriorMean::Zero)?;
    /// let events = |x: &[[f64; 1]], y| Observations::new(Inputs::from_rows(x)?, y);
    /// let own = fit(&prior, &events(&[[0.0], [0.5]], vec![true, true])?, &FitOptions::default())?;
    /// let theirs = fit(&prior, &events(&[[3.0], [3.5]], vec![false, false])?, &FitOptions::default())?;
    /// let message = Summary::marginal(&prior, theirs.sites(), &Inputs::from_rows(&[[3.2]])?)?;
    /// let fused = Posterior::fuse(&prior, own.sites(), &[&message])?;
    /// let p = fused.probability(&Inputs::from_rows(&[[0.2], [3.3]])?)?;
    /// assert!(p[0] > 0.5 && p[1] < 0.5);
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::DifferentPriors`] when a summary was formed under another prior (see [`Summary::under`]),
    /// [`Error::BadColumn`] or [`Error::SizeMismatch`] when inputs do not fit the prior or each other,
    /// [`Error::NegativeEigenvalue`] for a summary that is no message, [`Error::NotPositiveDefinite`] when numbers near
    /// the end of the range overflow.
    pub fn fuse(prior: &Prior, own: &Sites, summaries: &[&Summary]) -> Result<Self> {
        let mut posterior = Self::prior_alone(prior, own.inputs().dimension());
        posterior.absorb(NewRows::lay_out(prior, 0, Some(own), summaries)?)?;
        Ok(posterior)
    }

    /// Takes in more events. What was there stays; the result is that of [`Posterior::fuse`] with all of them, to
    /// rounding. O(n²m + m³) for m new events on top of n.
    ///
    /// # Errors
    /// As [`Posterior::fuse`], and then nothing changed.
    pub fn absorb_events(&mut self, events: &Sites) -> Result<()> {
        self.absorb(NewRows::lay_out(&self.prior, self.support.len(), Some(events), &[])?)
    }

    /// Takes in more summaries. O(n²m + m³) for m new inducing points on top of n.
    ///
    /// # Errors
    /// As [`Posterior::fuse`], and then nothing changed.
    pub fn absorb_summaries(&mut self, summaries: &[&Summary]) -> Result<()> {
        self.absorb(NewRows::lay_out(&self.prior, self.support.len(), None, summaries)?)
    }

    fn absorb(&mut self, new: Option<NewRows>) -> Result<()> {
        let Some(new) = new else { return Ok(()) };
        same_size("input dimension", self.support.dimension(), new.support.dimension())?;
        let (between, among) = self.whitened_covariances(&new)?;
        let target = self.extended_target(&new, &between, &among);
        let (between, corner) = self.rotated(&new, between, among);
        let extension = self.cholesky.extension("I + RᵀTR", between, corner)?;
        // Nothing fails any more.
        self.support.append(&new.support)?;
        self.segments.extend(new.segments);
        self.shift.extend(new.shift);
        self.cholesky.extend(extension);
        // weights = b̂ − R B⁻¹ RᵀTb̂.
        let mut correction = target.clone();
        self.cholesky.solve(&mut correction);
        apply(&self.segments, 0, &mut correction, Matrix::times);
        self.weights = self.shift.iter().zip(&correction).map(|(shift, correction)| shift - correction).collect();
        self.jitter = self.jitter.max(new.jitter);
        self.target = target;
        Ok(())
    }

    /// T = WKWᵀ between the new rows and the old ones (m×n), and among the new ones (m×m).
    fn whitened_covariances(&self, new: &NewRows) -> Result<(Matrix, Matrix)> {
        let old = self.support.len();
        let mut between = self.features(&new.support)?.transposed();
        whiten(&new.segments, old, &mut between);
        let mut among = self.prior.kernel().gram(&new.support)?;
        // Events have nothing to whiten, and there may be many of them.
        if new.segments.iter().any(|segment| matches!(segment.part, Part::Block { .. })) {
            whiten(&new.segments, old, &mut among);
            among = among.transposed();
            whiten(&new.segments, old, &mut among);
        }
        Ok((between, among))
    }

    /// RᵀTb̂ gains what the new shift does to all rows, and what the old shift does to the new ones.
    fn extended_target(&self, new: &NewRows, between: &Matrix, among: &Matrix) -> Vec<f64> {
        let mut old_gain = between.transposed_times(&new.shift);
        apply(&self.segments, 0, &mut old_gain, Matrix::transposed_times);
        let old_target = self.target.iter().zip(&old_gain).map(|(old, gain)| old + gain);
        let from_old = between.times(&self.shift);
        let mut new_target: Vec<f64> =
            among.times(&new.shift).iter().zip(&from_old).map(|(new, old)| new + old).collect();
        apply(&new.segments, self.support.len(), &mut new_target, Matrix::transposed_times);
        old_target.chain(new_target).collect()
    }

    /// The rows that B = I + RᵀTR gains: beside the old ones (n×m), and among the new.
    fn rotated(&self, new: &NewRows, mut between: Matrix, mut among: Matrix) -> (Matrix, Matrix) {
        let old = self.support.len();
        rotate(&new.segments, old, &mut between);
        let mut between = between.transposed();
        rotate(&self.segments, 0, &mut between);
        rotate(&new.segments, old, &mut among);
        let mut corner = among.transposed();
        rotate(&new.segments, old, &mut corner);
        corner.add_to_diagonal(1.0);
        (between, corner)
    }

    /// Number of events and inducing points n that it holds: memory and the time of a prediction grow with n².
    pub fn len(&self) -> usize {
        self.support.len()
    }

    /// Whether it is the prior alone.
    pub fn is_empty(&self) -> bool {
        self.support.is_empty()
    }

    /// The prior under which everything was put together.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// The largest jitter that any factorisation behind this posterior needed (0 in the ordinary case).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// What this posterior says about f at `inducing_points`: the message that takes the prior there to this
    /// posterior's joint mean and covariance. For a posterior of events alone this is [`Summary::marginal`]. O(Mn² +
    /// M²n + M³).
    ///
    /// # Errors
    /// As [`Posterior::latent`] and [`Summary::empty`].
    pub fn summarise(&self, inducing_points: &Inputs) -> Result<Summary> {
        let (mean, covariance) = self.joint_about_prior_mean(inducing_points)?;
        Summary::from_moments(&self.prior, inducing_points, &mean, &covariance)
    }

    /// What somebody who knows `known` is missing of this posterior at `inducing_points`: see [`Summary::residual`].
    ///
    /// # Errors
    /// [`Error::DifferentPriors`], and as [`Posterior::summarise`] of both.
    pub fn residual(&self, known: &Posterior, inducing_points: &Inputs) -> Result<Summary> {
        self.summarise(inducing_points)?.residual(&known.summarise(inducing_points)?)
    }
}

/// What a posterior is about to take in.
struct NewRows {
    support: Inputs,
    segments: Vec<Segment>,
    shift: Vec<f64>,
    jitter: f64,
}

impl NewRows {
    /// Events first, then every summary's inducing points, as rows from `first` on; `None` without any.
    fn lay_out(prior: &Prior, first: usize, events: Option<&Sites>, summaries: &[&Summary]) -> Result<Option<Self>> {
        let of_events = events.map(|events| events.inputs().dimension());
        let Some(dimension) = of_events.or(summaries.first().map(|summary| summary.inducing_points().dimension()))
        else {
            return Ok(None);
        };
        let mut new = Self { support: Inputs::empty(dimension), segments: Vec::new(), shift: Vec::new(), jitter: 0.0 };
        if let Some(events) = events.filter(|events| !events.is_empty()) {
            let roots = events.omega().iter().map(|omega| omega.sqrt()).collect();
            new.segments.push(Segment { first, part: Part::Events(roots) });
            new.support.append(events.inputs())?;
            new.shift = events.shift(prior.mean())?;
        }
        for summary in summaries {
            if summary.prior() != prior {
                return Err(Error::DifferentPriors { what: "a posterior and a summary" });
            }
            let part = Part::Block { whitening: summary.cholesky().clone(), root: summary.root(0.0)? };
            new.segments.push(Segment { first: first + new.support.len(), part });
            new.support.append(summary.inducing_points())?;
            new.shift.extend_from_slice(summary.whitened_shift());
            new.jitter = new.jitter.max(summary.jitter());
        }
        Ok(Some(new).filter(|new| !new.support.is_empty()))
    }
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
