//! Own events and everybody's summaries put together (section 6 of [`crate::method`]).

mod rows;

use rows::{NewRows, Part, Segment, apply, rotate, rotate_columns, whiten, whiten_columns};

use crate::error::{Result, same_size};
use crate::inputs::Inputs;
use crate::latent::Latent;
use crate::linalg::{
    Cholesky, GrowingCholesky, Matrix, Single, add_symmetric_product, dot, squared_norm, squared_norms_of_rows,
};
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// From so many points on they are laid out in rows.
const ROWS_MIN: usize = 16;

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
    cholesky: GrowingCholesky,
    /// The mean about μ₀ at x is (whitened k(support, x))ᵀ · weights.
    weights: Vec<f64>,
    jitter: f64,
}

impl Posterior {
    /// The prior, of which nothing is known yet, over inputs of this dimension.
    pub fn prior_alone(prior: &Prior, dimension: usize) -> Self {
        Self {
            prior: prior.clone(),
            support: Inputs::empty(dimension),
            segments: Vec::new(),
            shift: Vec::new(),
            target: Vec::new(),
            cholesky: GrowingCholesky::empty(),
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
    /// [`crate::Error::DifferentPriors`] when a summary was formed under another prior (see [`Summary::under`]),
    /// [`crate::Error::BadColumn`] or [`crate::Error::SizeMismatch`] when inputs do not fit the prior or each other,
    /// [`crate::Error::NegativeEigenvalue`] for a summary that is no message, [`crate::Error::NotPositiveDefinite`] when numbers near
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

    /// Latent mean and variance at every point. O(n²) a point, in blocks, on several threads where there are: memory does not
    /// grow with the number of points. The last bits of a point may depend on which others are asked for with it.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] when the inputs do not fit the prior, [`crate::Error::NotFinite`] when numbers
    /// near the end of the range overflow.
    pub fn latent(&self, inputs: &Inputs) -> Result<Latent> {
        self.latent_by(None, inputs)
    }

    /// [`Posterior::latent`] of many points at once, such as the cells of a map, 1.5 times faster: what is explained of the prior
    /// variance is solved for in single precision. Means are the same, variances within 1e-5 of the prior's variance, and where that is
    /// below a hundred, as it is in any water, probabilities, too, are within 1e-5. The factor is rounded first, which takes as long as a point or two.
    ///
    /// ```
    /// use dgpc::{FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Shape, Term, fit};
    ///
    /// let events = Observations::new(Inputs::from_rows(&[[0.0], [1.0], [2.0]])?, vec![true, true, false])?;
    /// let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern52, 4.0, 1.0, 1)?])?;
    /// let posterior = fit(&Prior::new(kernel, PriorMean::Zero)?, &events, &FitOptions::default())?.posterior()?;
    /// let cells = Inputs::new((0..500).map(|n| f64::from(n) * 0.01).collect(), 1)?;
    /// let (quick, exact) = (posterior.latent_in_bulk(&cells)?, posterior.latent(&cells)?);
    /// assert_eq!(quick.mean, exact.mean);
    /// assert!(quick.probability().iter().zip(exact.probability()).all(|(quick, exact)| (quick - exact).abs() < 1e-5));
    /// # Ok::<(), dgpc::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn latent_in_bulk(&self, inputs: &Inputs) -> Result<Latent> {
        if inputs.len() < ROWS_MIN {
            self.latent(inputs)
        } else {
            self.latent_by(self.cholesky.single().as_ref(), inputs)
        }
    }

    /// Probability of success at every point. See [`Posterior::latent`].
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn probability(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        Ok(self.latent(inputs)?.probability())
    }

    fn latent_by(&self, single: Option<&Single>, inputs: &Inputs) -> Result<Latent> {
        Latent::in_blocks(&self.prior, inputs, self.len() * self.len(), |block, mean, variance, features| {
            let (learned, explained) = if block.len() < ROWS_MIN {
                self.moments_of_few(block)?
            } else {
                self.moments_of_many(single, block, features)?
            };
            mean.iter_mut().zip(learned).for_each(|(mean, learned)| *mean += learned);
            variance.iter_mut().zip(explained).for_each(|(variance, explained)| *variance -= explained);
            Ok(())
        })
    }

    /// The mean about the prior mean at every point, and how much of the prior variance is explained there.
    fn moments_of_few(&self, inputs: &Inputs) -> Result<(Vec<f64>, Vec<f64>)> {
        let mut features = self.features(inputs)?;
        let mean = (0..features.columns()).map(|n| dot(features.column(n), &self.weights)).collect();
        self.explain(&mut features);
        Ok((mean, (0..features.columns()).map(|n| squared_norm(features.column(n))).collect()))
    }

    /// The same for points that lie in rows, which is faster where there are many.
    fn moments_of_many(
        &self,
        single: Option<&Single>,
        inputs: &Inputs,
        features: &mut Matrix,
    ) -> Result<(Vec<f64>, Vec<f64>)> {
        features.resize(inputs.len(), self.len());
        self.prior.kernel().write_cross(inputs, &self.support, features)?;
        whiten_columns(&self.segments, features);
        let mean = features.times(&self.weights);
        rotate_columns(&self.segments, features);
        if let Some(explained) = single.and_then(|single| single.squared_norms_of_solved(features)) {
            return Ok((mean, explained));
        }
        self.cholesky.solve_rows(features);
        Ok((mean, squared_norms_of_rows(features)))
    }

    /// Joint mean (M) and covariance (M×M) of the latent function at `inputs`. O(Mn² + M²n).
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn joint(&self, inputs: &Inputs) -> Result<(Vec<f64>, Matrix)> {
        let (about_prior_mean, covariance) = self.joint_about_prior_mean(inputs)?;
        let prior_mean = self.prior.mean().values(inputs)?;
        Ok((about_prior_mean.iter().zip(&prior_mean).map(|(mean, prior)| mean + prior).collect(), covariance))
    }

    /// Functions drawn from this posterior, at `inputs`: of M×S standard normal numbers M×S values, a column for each function; and
    /// the jitter that it took. O(Mn² + M²n + M³ + M²S).
    ///
    /// # Errors
    /// As [`Posterior::latent`], and [`crate::Error::SizeMismatch`] for normals of another number of rows.
    pub fn draws(&self, inputs: &Inputs, normals: &Matrix) -> Result<(Matrix, f64)> {
        same_size("rows of normals", inputs.len(), normals.rows())?;
        let (mean, covariance) = self.joint(inputs)?;
        let root = Cholesky::with_jitter("covariance of functions", &covariance)?;
        let mut draws = Matrix::zeros(inputs.len(), normals.columns());
        for draw in 0..normals.columns() {
            let about_mean = root.lower_times(normals.column(draw));
            let values = draws.column_mut(draw).iter_mut().zip(mean.iter().zip(about_mean));
            values.for_each(|(value, (mean, about_mean))| *value = mean + about_mean);
        }
        Ok((draws, root.jitter()))
    }

    fn joint_about_prior_mean(&self, inputs: &Inputs) -> Result<(Vec<f64>, Matrix)> {
        let mut features = self.features(inputs)?;
        let mean = features.transposed_times(&self.weights);
        let mut covariance = self.prior.kernel().gram(inputs)?;
        self.explain(&mut features);
        add_symmetric_product(-1.0, features.t(), &mut covariance);
        Ok((mean, covariance))
    }

    /// Takes from the covariance of f at `inputs` what the rows of the support from `first` on explain, given those before.
    pub(crate) fn take_explained(&self, inputs: &Inputs, first: usize, covariance: &mut Matrix) -> Result<()> {
        if first == self.len() {
            return Ok(());
        }
        let mut features = self.features(inputs)?;
        self.explain(&mut features);
        let new = features.t().subcols(first, self.len() - first);
        add_symmetric_product(-1.0, new, covariance);
        Ok(())
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
    /// [`crate::Error::DifferentPriors`], and as [`Posterior::summarise`] of both.
    pub fn residual(&self, known: &Posterior, inducing_points: &Inputs) -> Result<Summary> {
        self.summarise(inducing_points)?.residual(&known.summarise(inducing_points)?)
    }

    /// Whitened k(support, x), one column per point.
    fn features(&self, inputs: &Inputs) -> Result<Matrix> {
        let mut features = self.prior.kernel().cross(&self.support, inputs)?;
        whiten(&self.segments, 0, &mut features);
        Ok(features)
    }

    /// Turns whitened features into those whose squared norm is the prior variance explained.
    fn explain(&self, features: &mut Matrix) {
        rotate(&self.segments, 0, features);
        self.cholesky.solve_lower_matrix(features);
    }
}
