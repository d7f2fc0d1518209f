//! What a posterior says anywhere (section 6 of [`crate::method`]).

use super::{Posterior, rotate, whiten};
use crate::error::{Result, same_size};
use crate::inputs::Inputs;
use crate::latent::Latent;
use crate::linalg::{Cholesky, Matrix, Single, add_symmetric_product, dot, squared_norm};

impl Posterior {
    /// Latent mean and variance at every point. O(n²) a point, in blocks, on several threads where there are: memory does not
    /// grow with the number of points.
    ///
    /// # Errors
    /// [`crate::Error::BadColumn`] when the inputs do not fit the prior, [`crate::Error::NotFinite`] when numbers
    /// near the end of the range overflow.
    pub fn latent(&self, inputs: &Inputs) -> Result<Latent> {
        self.latent_by(None, inputs)
    }

    /// [`Posterior::latent`] of many points at once, such as the cells of a map, 1.4 times faster: what is explained of the prior
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
        self.latent_by(self.cholesky.single().as_ref(), inputs)
    }

    /// Probability of success at every point. See [`Posterior::latent`].
    ///
    /// # Errors
    /// As [`Posterior::latent`].
    pub fn probability(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        Ok(self.latent(inputs)?.probability())
    }

    fn latent_by(&self, single: Option<&Single>, inputs: &Inputs) -> Result<Latent> {
        Latent::in_blocks(&self.prior, inputs, self.len() * self.len(), |block, mean, variance| {
            let mut features = self.features(block)?;
            for (n, mean) in mean.iter_mut().enumerate() {
                *mean += dot(features.column(n), &self.weights);
            }
            let explained = self.explained(&mut features, single);
            variance.iter_mut().zip(explained).for_each(|(variance, explained)| *variance -= explained);
            Ok(())
        })
    }

    /// How much of the prior variance is explained, from whitened features.
    fn explained(&self, features: &mut Matrix, single: Option<&Single>) -> Vec<f64> {
        rotate(&self.segments, 0, features);
        if let Some(explained) = single.and_then(|single| single.squared_norms_of_solved(features)) {
            return explained;
        }
        self.cholesky.solve_lower_matrix(features);
        (0..features.columns()).map(|n| squared_norm(features.column(n))).collect()
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

    pub(super) fn joint_about_prior_mean(&self, inputs: &Inputs) -> Result<(Vec<f64>, Matrix)> {
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

    /// Whitened k(support, x), one column per point.
    pub(super) fn features(&self, inputs: &Inputs) -> Result<Matrix> {
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
