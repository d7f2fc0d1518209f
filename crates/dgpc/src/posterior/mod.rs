//! Fusion of own events and the summaries of peers ([`crate::method::fusion`]).

mod rows;

use rows::{NewRows, Segment, rotate, rotate_columns, rotate_vector, whiten, whiten_columns};

use crate::error::{Result, same_size};
use crate::inputs::Inputs;
use crate::latent::Latent;
use crate::linalg::{
    Cholesky, Extension, GrowingCholesky, Matrix, add_symmetric_product, products_and_squared_norms, squared_norm,
};
use crate::observations::Observations;
use crate::prior::Prior;
use crate::sites::Sites;
use crate::summary::Summary;

/// From this number of points on, predictions store the points in rows.
const ROWS_MIN: usize = 16;

/// A Gaussian posterior over the latent function that predicts anywhere.
///
/// The posterior is a site fusion: the prior is counted once, events are sites at their own inputs, and every summary
/// is a site at its inducing points. For events alone it is exact given ω. [`Posterior::absorb_events`] and
/// [`Posterior::absorb_summaries`] extend it.
#[derive(Debug, Clone)]
pub struct Posterior {
    prior: Prior,
    /// The n points with evidence: events and inducing points.
    support: Inputs,
    /// The meaning of the rows of the support.
    segments: Vec<Segment>,
    /// b̂, n.
    shift: Vec<f64>,
    /// Cholesky factor L_B of B = I + RᵀTR.
    cholesky: GrowingCholesky,
    /// g = L_B⁻¹RᵀTb̂, n.
    solved_target: Vec<f64>,
    jitter: f64,
}

/// Features of points. Predictions and absorption share them.
///
/// With t the whitened covariance of a point with the support and φ = L_B⁻¹Rᵀt, the mean about μ₀ is tᵀb̂ − φᵀg. The
/// explained variance is ‖φ‖².
struct PointFeatures {
    /// tᵀb̂, one per point.
    shifted: Vec<f64>,
    /// φ, a column for each point.
    solved: Matrix,
}

impl Posterior {
    /// Returns the prior, without any evidence, over inputs of dimension `dimension`.
    pub fn prior_alone(prior: &Prior, dimension: usize) -> Self {
        Self {
            prior: prior.clone(),
            support: Inputs::empty(dimension),
            segments: Vec::new(),
            shift: Vec::new(),
            cholesky: GrowingCholesky::empty(),
            solved_target: Vec::new(),
            jitter: 0.0,
        }
    }

    /// Returns the posterior of events at known ω. It never forms K⁻¹ and needs no jitter. O(N³).
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn of_sites(prior: &Prior, sites: &Sites) -> Result<Self> {
        Self::fuse(prior, sites, &[])
    }

    /// Returns the posterior of summaries alone, as a receiver without own events holds it. O(n³) for n inducing points
    /// in total.
    ///
    /// # Errors
    /// As [`Posterior::fuse`].
    pub fn of_summaries(prior: &Prior, summaries: &[&Summary]) -> Result<Self> {
        let dimension = summaries.first().map_or(prior.dimension_min(), |first| first.inducing_points().dimension());
        let mut posterior = Self::prior_alone(prior, dimension);
        posterior.absorb_summaries(summaries)?;
        Ok(posterior)
    }

    /// Returns the posterior of own events and of the peers' summaries. It never forms K⁻¹ or an explicit precision,
    /// and needs no jitter of its own. O(n³) for n = events + all inducing points.
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
    /// * [`crate::Error::DifferentPriors`] if a summary was formed under another prior (see [`Summary::under`]).
    /// * [`crate::Error::BadColumn`] or [`crate::Error::SizeMismatch`] if inputs do not fit the prior or each other.
    /// * [`crate::Error::NegativeEigenvalue`] for a summary whose precision is not positive semi-definite.
    /// * [`crate::Error::NotPositiveDefinite`] if numbers near the end of the floating-point range overflow.
    pub fn fuse(prior: &Prior, own: &Sites, summaries: &[&Summary]) -> Result<Self> {
        let mut posterior = Self::prior_alone(prior, own.inputs().dimension());
        posterior.absorb(NewRows::lay_out(prior, 0, Some(own), summaries)?)?;
        Ok(posterior)
    }

    /// Absorbs more events. The existing sites stay as they are. The result equals [`Posterior::fuse`] with all events,
    /// up to rounding. O(n²m + m³) for m new events in addition to n rows.
    ///
    /// # Errors
    /// As [`Posterior::fuse`]. After an error the posterior is unchanged.
    pub fn absorb_events(&mut self, events: &Sites) -> Result<()> {
        self.absorb(NewRows::lay_out(&self.prior, self.support.len(), Some(events), &[])?)
    }

    /// Absorbs more summaries. O(n²m + m³) for m new inducing points in addition to n rows.
    ///
    /// # Errors
    /// As [`Posterior::fuse`]. After an error the posterior is unchanged.
    pub fn absorb_summaries(&mut self, summaries: &[&Summary]) -> Result<()> {
        self.absorb(NewRows::lay_out(&self.prior, self.support.len(), None, summaries)?)
    }

    /// Absorbs events and returns their sites. `omega` computes ω from the moments before the absorption, which use the
    /// same features of the events. O(n²m + m³).
    ///
    /// # Errors
    /// As [`Posterior::latent`], [`Sites::new`] and [`Posterior::absorb_events`]. After an error the posterior is
    /// unchanged.
    pub(crate) fn absorb_observations_by(
        &mut self,
        observations: &Observations,
        omega: impl FnOnce(&Latent) -> Vec<f64>,
    ) -> Result<Sites> {
        let inputs = observations.inputs();
        let features = self.features_at(inputs)?;
        let mut mean = self.prior.mean().values(inputs)?;
        let mut variance = self.prior.kernel().diagonal(inputs)?;
        mean.iter_mut().zip(self.mean_about_prior_mean(&features)).for_each(|(mean, learned)| *mean += learned);
        variance.iter_mut().zip(features.explained()).for_each(|(variance, explained)| *variance -= explained);
        let sites = Sites::new(observations, omega(&Latent::checked(mean, variance)?))?;
        if let Some(new) = NewRows::lay_out(&self.prior, self.support.len(), Some(&sites), &[])? {
            self.absorb_rows(new, features, self.prior.kernel().gram(inputs)?)?;
        }
        Ok(sites)
    }

    fn absorb(&mut self, new: Option<NewRows>) -> Result<()> {
        let Some(new) = new else { return Ok(()) };
        let mut between = self.whitened_covariances(&new.support)?;
        whiten_columns(&new.segments, new.first, &mut between);
        let mut among = self.prior.kernel().gram(&new.support)?;
        whiten(&new.segments, new.first, &mut among);
        whiten_columns(&new.segments, new.first, &mut among);
        let features = self.features(between);
        self.absorb_rows(new, features, among)
    }

    /// Absorbs new rows, from the features of their whitened inputs and from T among them (m×m).
    fn absorb_rows(&mut self, new: NewRows, features: PointFeatures, among: Matrix) -> Result<()> {
        same_size("input dimension", self.support.dimension(), new.support.dimension())?;
        let PointFeatures { shifted, solved: mut between } = features;
        // g in the old rows.
        let change = between.times(&new.shift);
        let mut solved_target: Vec<f64> = self.solved_target.iter().zip(change).map(|(old, by)| old + by).collect();
        // RᵀTb̂ in the new rows.
        let by_new = among.times(&new.shift);
        let mut target: Vec<f64> = shifted.iter().zip(by_new).map(|(by_old, by_new)| by_old + by_new).collect();
        rotate_vector(&new.segments, new.first, &mut target);
        rotate_columns(&new.segments, new.first, &mut between);
        let extension = Extension::new("I + RᵀTR", between, new.corner(among))?;
        extension.solve_lower(&solved_target, &mut target);
        solved_target.extend(target);
        // No step below can fail.
        self.support.append(&new.support)?;
        self.segments.extend(new.segments);
        self.shift.extend(new.shift);
        self.cholesky.extend(extension);
        self.solved_target = solved_target;
        self.jitter = self.jitter.max(new.jitter);
        Ok(())
    }

    /// Returns n, the number of events and inducing points. Memory and the time of a prediction grow with n².
    pub fn len(&self) -> usize {
        self.support.len()
    }

    /// Returns whether the posterior is the prior alone.
    pub fn is_empty(&self) -> bool {
        self.support.is_empty()
    }

    /// Returns the prior of the posterior.
    pub fn prior(&self) -> &Prior {
        &self.prior
    }

    /// Returns the largest jitter of all factorisations behind this posterior (ordinarily 0).
    pub fn jitter(&self) -> f64 {
        self.jitter
    }

    /// Returns the latent mean and variance at every point. O(n²) a point.
    ///
    /// The points are processed in blocks, on several threads if available, so that memory does not grow with their
    /// number. The last bits of a result may depend on the other points of the call.
    ///
    /// # Errors
    /// [`crate::Error::SizeMismatch`] if the inputs have another dimension than the support,
    /// [`crate::Error::BadColumn`] if they do not fit the prior, and [`crate::Error::NotFinite`] if numbers near the
    /// end of the floating-point range overflow.
    pub fn latent(&self, inputs: &Inputs) -> Result<Latent> {
        self.support.check_dimension(inputs)?;
        Latent::in_blocks(&self.prior, inputs, self.len() * self.len(), |block, mean, variance, features| {
            let (learned, explained) = if block.len() < ROWS_MIN {
                self.moments_of_few(block)?
            } else {
                self.moments_of_many(block, features)?
            };
            mean.iter_mut().zip(learned).for_each(|(mean, learned)| *mean += learned);
            variance.iter_mut().zip(explained).for_each(|(variance, explained)| *variance -= explained);
            Ok(())
        })
    }

    /// Returns the probability of success at every point. See [`Posterior::latent`].
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn probability(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        Ok(self.latent(inputs)?.probability())
    }

    /// Returns, at every point, the mean minus the prior mean, and the explained part of the prior variance.
    fn moments_of_few(&self, inputs: &Inputs) -> Result<(Vec<f64>, Vec<f64>)> {
        let features = self.features_at(inputs)?;
        Ok((self.mean_about_prior_mean(&features), features.explained()))
    }

    /// Computes the moments as [`Posterior::moments_of_few`], but with points in rows, which is faster for many points.
    fn moments_of_many(&self, inputs: &Inputs, features: &mut Matrix) -> Result<(Vec<f64>, Vec<f64>)> {
        features.resize(inputs.len(), self.len());
        self.prior.kernel().write_cross(inputs, &self.support, features)?;
        whiten_columns(&self.segments, 0, features);
        let mut mean = features.times(&self.shift);
        rotate_columns(&self.segments, 0, features);
        self.cholesky.solve_rows(features, 0);
        let (corrections, explained) = products_and_squared_norms(features, &self.solved_target);
        mean.iter_mut().zip(corrections).for_each(|(mean, correction)| *mean -= correction);
        Ok((mean, explained))
    }

    /// Returns the joint mean (M) and covariance (M×M) of the latent function at `inputs`. O(Mn² + M²n).
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn joint(&self, inputs: &Inputs) -> Result<(Vec<f64>, Matrix)> {
        let (about_prior_mean, covariance) = self.joint_about_prior_mean(inputs)?;
        let prior_mean = self.prior.mean().values(inputs)?;
        Ok((about_prior_mean.iter().zip(&prior_mean).map(|(mean, prior)| mean + prior).collect(), covariance))
    }

    /// Draws S functions from this posterior at `inputs`, from M×S standard normal numbers.
    ///
    /// Returns the values, M×S with a column for each function, and the jitter of the factorisation.
    /// O(Mn² + M²n + M³ + M²S).
    ///
    /// # Errors
    /// As [`Posterior::latent`], and [`crate::Error::SizeMismatch`] if `normals` has another number of rows than
    /// inputs.
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

    /// Returns whether this posterior is `base` with more evidence, or equal to it. O(n).
    pub(crate) fn extends(&self, base: &Posterior) -> bool {
        let rows = base.len();
        self.prior == base.prior
            && self.len() >= rows
            && self.shift[..rows] == base.shift
            && self.support.slice(0..rows) == base.support
            && self.cholesky.diagonal()[..rows] == base.cholesky.diagonal()
    }

    /// Returns g = L_B⁻¹RᵀTb̂, n.
    pub(crate) fn solved_target(&self) -> &[f64] {
        &self.solved_target
    }

    /// Appends the m missing rows of the support to `features`, which holds (L_B⁻¹Rᵀt)ᵀ for the first rows, with t the
    /// whitened covariance of an input with the support. Returns tᵀb̂ over the appended rows, one per input. O(nm) an
    /// input. The features must end between two absorptions.
    pub(crate) fn append_features(&self, inputs: &Inputs, features: &mut Matrix) -> Result<Vec<f64>> {
        self.support.check_dimension(inputs)?;
        let first = features.columns();
        let mut new = self.prior.kernel().cross(inputs, &self.support.slice(first..self.len()))?;
        let segments = &self.segments[self.segments.partition_point(|segment| segment.first < first)..];
        whiten_columns(segments, first, &mut new);
        let shifted = new.times(&self.shift[first..]);
        rotate_columns(segments, first, &mut new);
        features.append_columns(&new);
        self.cholesky.solve_rows(features, first);
        Ok(shifted)
    }

    fn joint_about_prior_mean(&self, inputs: &Inputs) -> Result<(Vec<f64>, Matrix)> {
        let features = self.features_at(inputs)?;
        let mut covariance = self.prior.kernel().gram(inputs)?;
        add_symmetric_product(-1.0, features.solved.t(), &mut covariance);
        Ok((self.mean_about_prior_mean(&features), covariance))
    }

    /// Returns the summary of this posterior at `inducing_points`: the message that turns the prior there into this
    /// posterior's joint mean and covariance. For a posterior of events alone it equals [`Summary::marginal`].
    /// O(Mn² + M²n + M³).
    ///
    /// # Errors
    /// As [`Posterior::latent`] and [`Summary::empty`].
    pub fn summarise(&self, inducing_points: &Inputs) -> Result<Summary> {
        let (mean, covariance) = self.joint_about_prior_mean(inducing_points)?;
        Summary::from_moments(&self.prior, inducing_points, &mean, &covariance)
    }

    /// Returns the message that a receiver who holds `known` lacks at `inducing_points`. See [`Summary::residual`].
    ///
    /// # Errors
    /// [`crate::Error::DifferentPriors`], and as [`Posterior::summarise`] of both.
    pub fn residual(&self, known: &Posterior, inducing_points: &Inputs) -> Result<Summary> {
        self.summarise(inducing_points)?.residual(&known.summarise(inducing_points)?)
    }

    /// Returns t = W k(support, x), one column per point.
    fn whitened_covariances(&self, inputs: &Inputs) -> Result<Matrix> {
        self.support.check_dimension(inputs)?;
        let mut covariances = self.prior.kernel().cross(&self.support, inputs)?;
        whiten(&self.segments, 0, &mut covariances);
        Ok(covariances)
    }

    fn features_at(&self, inputs: &Inputs) -> Result<PointFeatures> {
        Ok(self.features(self.whitened_covariances(inputs)?))
    }

    /// Returns the features of points with these whitened covariances with the support (n×m). O(n²m).
    fn features(&self, mut covariances: Matrix) -> PointFeatures {
        let shifted = covariances.transposed_times(&self.shift);
        rotate(&self.segments, 0, &mut covariances);
        self.cholesky.solve_lower_matrix(&mut covariances);
        PointFeatures { shifted, solved: covariances }
    }

    fn mean_about_prior_mean(&self, features: &PointFeatures) -> Vec<f64> {
        let corrections = features.solved.transposed_times(&self.solved_target);
        features.shifted.iter().zip(corrections).map(|(shifted, correction)| shifted - correction).collect()
    }
}

impl PointFeatures {
    /// Returns the explained part of the prior variance at every point.
    fn explained(&self) -> Vec<f64> {
        (0..self.solved.columns()).map(|point| squared_norm(self.solved.column(point))).collect()
    }
}
