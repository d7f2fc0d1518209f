//! Terms, the summands of a kernel.

use super::correlation::{Correlation, Slopes};
use super::reflection::Reflection;
use super::scaled::Scaled;
use super::shape::Shape;
use crate::error::{Result, finite, in_range, positive};
use crate::inputs::Inputs;
use crate::linalg::add_scaled;
use crate::parameter::Parameter;
use crate::special::logistic;

/// One term of a kernel: a variance times a correlation, or times a product of several correlations over their own
/// columns. With a reflection R and a reciprocity c the term is ½[k(x, x′) + c k(x, Rx′)].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Term {
    variance: f64,
    /// The factors, at least one.
    correlations: Vec<Correlation>,
    reflection: Option<Reflection>,
    /// See [`Term::reciprocity`].
    reciprocity: f64,
}

/// Smallest distance of a learned reciprocity from 0 and from 1, where it would no longer be a parameter.
const RECIPROCITY_MARGIN: f64 = 1e-9;

/// Points scaled for each correlation of a term.
type ScaledPoints = Vec<Scaled>;

/// The scaled points of both sides of a matrix of covariances.
pub(super) struct Pairs {
    left: ScaledPoints,
    /// The right side and, for a reciprocal term, its reflection.
    images: Vec<ScaledPoints>,
}

/// Work areas for many pairs of points.
#[derive(Default)]
pub(super) struct Scratch {
    products: Vec<f64>,
    factors: Vec<f64>,
}

impl Term {
    /// Creates a term over `columns` with one length-scale per column. Each length-scale is learned separately.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a variance that is not finite and positive, and as [`Correlation::new`].
    pub fn new(shape: Shape, variance: f64, columns: &[usize], length_scales: &[f64]) -> Result<Self> {
        Self::of(variance, Correlation::new(shape, columns, length_scales)?)
    }

    /// Creates an isotropic term over the first `dimension` columns, which share one length-scale. See [`Term::new`].
    ///
    /// # Errors
    /// As [`Term::new`].
    pub fn isotropic(shape: Shape, variance: f64, length_scale: f64, dimension: usize) -> Result<Self> {
        Self::of(variance, Correlation::isotropic(shape, &Vec::from_iter(0..dimension), length_scale)?)
    }

    /// Creates a term from a variance and a correlation.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a variance that is not finite and positive.
    pub fn of(variance: f64, correlation: Correlation) -> Result<Self> {
        positive("kernel variance", variance)?;
        Ok(Self { variance, correlations: vec![correlation], reflection: None, reciprocity: 0.0 })
    }

    /// Multiplies the term by another correlation. Two points are then similar only if both factors are large.
    ///
    /// # Errors
    /// [`crate::Error::NotReciprocal`] if the term is reciprocal and the correlation cannot be.
    pub fn times(mut self, correlation: Correlation) -> Result<Self> {
        let correlation = match &self.reflection {
            Some(reflection) => correlation.tied_by(reflection)?,
            None => correlation,
        };
        self.correlations.push(correlation);
        Ok(self)
    }

    /// Makes the term reciprocal: ½[k(x, x′) + k(x, Rx′)] ([`crate::method::kernels`]). Its diagonal then depends
    /// on x. Columns that the reflection exchanges become tied.
    ///
    /// # Errors
    /// [`crate::Error::NotReciprocal`] if the result would not be positive definite. This is so if the reflection maps
    /// a column to a column outside the correlation, or exchanges columns of different length-scales.
    pub fn reciprocal(self, reflection: Reflection) -> Result<Self> {
        self.partly_reciprocal(reflection, 1.0)
    }

    /// Makes the term reciprocal in part: ½[k(x, x′) + c k(x, Rx′)] ([`crate::method::kernels`]). The reciprocity c is
    /// a learned parameter unless it is 1.
    ///
    /// # Errors
    /// As [`Term::reciprocal`], and [`crate::Error::OutOfRange`] for a reciprocity that is not above 0 and at most 1.
    pub fn partly_reciprocal(mut self, reflection: Reflection, reciprocity: f64) -> Result<Self> {
        let range = f64::MIN_POSITIVE..=1.0;
        self.reciprocity = in_range("reciprocity of a kernel term", reciprocity, range, "above 0, and at most 1")?;
        let tied = self.correlations.into_iter().map(|correlation| correlation.tied_by(&reflection));
        self.correlations = tied.collect::<Result<_>>()?;
        self.reflection = Some(reflection);
        Ok(self)
    }

    /// Returns the term with another variance.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a variance that is not finite and positive.
    pub fn with_variance(&self, variance: f64) -> Result<Self> {
        positive("kernel variance", variance)?;
        Ok(Self { variance, ..self.clone() })
    }

    /// Returns the term with another shape for its first correlation.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a parameter of the shape outside its range.
    pub fn with_shape(&self, shape: Shape) -> Result<Self> {
        let mut term = self.clone();
        term.correlations[0] = term.correlations[0].with_shape(shape)?;
        Ok(term)
    }

    /// Returns the term with one length-scale of its first correlation multiplied by a positive factor. `number` counts
    /// the untied length-scales from 0.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] if there is no such length-scale, or if the product leaves the floating-point
    /// range.
    pub fn with_length_scale_times(&self, number: usize, factor: f64) -> Result<Self> {
        let mut term = self.clone();
        term.correlations[0] = term.correlations[0].with_length_scale_times(number, factor)?;
        Ok(term)
    }

    /// Returns the variance of the term, before the factor ½ of the reciprocal form.
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// Returns the correlations, the factors of the term, at least one.
    pub fn correlations(&self) -> &[Correlation] {
        &self.correlations
    }

    /// Returns the reflection of a reciprocal term; `None` for other terms.
    pub fn reflection(&self) -> Option<&Reflection> {
        self.reflection.as_ref()
    }

    /// Returns the reciprocity c: the correlation of a point with its image, if the two are far apart.
    ///
    /// It is 1 if the term is equal for both, and 0 if they are independent or the term has no reflection.
    pub fn reciprocity(&self) -> f64 {
        self.reciprocity
    }

    /// Returns whether the reciprocity is a parameter.
    fn learns_reciprocity(&self) -> bool {
        self.reciprocity > 0.0 && self.reciprocity < 1.0
    }

    /// Returns the number of parameters that belong to no correlation: the variance and a learned reciprocity.
    fn own_parameter_count(&self) -> usize {
        1 + usize::from(self.learns_reciprocity())
    }

    /// Returns the number of learned parameters: the variance, a reciprocity between 0 and 1, and those of every
    /// correlation.
    pub(super) fn parameter_count(&self) -> usize {
        self.own_parameter_count() + self.correlations.iter().map(Correlation::parameter_count).sum::<usize>()
    }

    /// Returns ln of the variance, the log-odds of a learned reciprocity, and ln of the parameters of every
    /// correlation.
    pub(super) fn parameter_values(&self) -> impl Iterator<Item = f64> {
        let log_odds = self.learns_reciprocity().then(|| (self.reciprocity / (1.0 - self.reciprocity)).ln());
        let own = std::iter::once(self.variance.ln()).chain(log_odds);
        own.chain(self.correlations.iter().flat_map(Correlation::log_parameters))
    }

    /// Returns the term with other parameters, in the order of [`Term::parameter_values`].
    pub(super) fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let variance = positive("kernel variance", parameters[0].exp())?;
        let reciprocity = match self.learns_reciprocity() {
            true => logistic(finite("log-odds of a reciprocity", parameters[1])?)
                .clamp(RECIPROCITY_MARGIN, 1.0 - RECIPROCITY_MARGIN),
            false => self.reciprocity,
        };
        let correlations = self.parts().map(|(correlation, part)| correlation.with_log_parameters(&parameters[part]));
        let correlations = correlations.collect::<Result<_>>()?;
        Ok(Self { variance, correlations, reflection: self.reflection.clone(), reciprocity })
    }

    /// Returns the kind of each parameter.
    pub(super) fn parameters(&self) -> impl Iterator<Item = Parameter> {
        let own = std::iter::once(Parameter::Variance);
        let own = own.chain(self.learns_reciprocity().then_some(Parameter::Reciprocity));
        own.chain(self.correlations.iter().flat_map(Correlation::parameters))
    }

    /// Returns every correlation with the range of its parameters among those of the term.
    fn parts(&self) -> impl Iterator<Item = (&Correlation, std::ops::Range<usize>)> {
        self.correlations.iter().scan(self.own_parameter_count(), |first, correlation| {
            let part = *first..*first + correlation.parameter_count();
            *first = part.end;
            Some((correlation, part))
        })
    }

    /// Returns whether the two terms differ in learned parameters only.
    pub(super) fn has_structure_of(&self, other: &Self) -> bool {
        let mut pairs = self.correlations.iter().zip(&other.correlations);
        self.correlations.len() == other.correlations.len()
            && self.reflection == other.reflection
            && self.learns_reciprocity() == other.learns_reciprocity()
            && (self.learns_reciprocity() || self.reciprocity == other.reciprocity)
            && pairs.all(|(own, other)| own.has_structure_of(other))
    }

    fn scaled_points(&self, inputs: &Inputs, reflection: Option<&Reflection>) -> ScaledPoints {
        self.correlations.iter().map(|correlation| correlation.scaled(inputs, reflection)).collect()
    }

    /// Returns the scaled points and, for a reciprocal term, their reflections.
    fn images(&self, inputs: &Inputs) -> Vec<ScaledPoints> {
        let mut images = vec![self.scaled_points(inputs, None)];
        images.extend(self.reflection.as_ref().map(|reflection| self.scaled_points(inputs, Some(reflection))));
        images
    }

    /// Adds `weight` · the product of correlations to `out`, between point `n` of `points` and those of `others` from
    /// `first` on.
    fn add_products(
        &self,
        weight: f64,
        (points, n): (&ScaledPoints, usize),
        (others, first): (&ScaledPoints, usize),
        out: &mut [f64],
        scratch: &mut Scratch,
    ) {
        let Scratch { products, factors } = scratch;
        products.resize(out.len(), 0.0);
        let mut parts = self.correlations.iter().zip(points).zip(others);
        if let Some(((correlation, points), others)) = parts.next() {
            correlation.write_to((points, n), (others, first), products);
        }
        for ((correlation, points), others) in parts {
            factors.resize(out.len(), 0.0);
            correlation.write_to((points, n), (others, first), factors);
            products.iter_mut().zip(&*factors).for_each(|(product, factor)| *product *= factor);
        }
        add_scaled(weight, products, out);
    }

    /// Returns the scaled points of `a` and `b`.
    pub(super) fn pairs(&self, a: &Inputs, b: &Inputs) -> Pairs {
        Pairs { left: self.scaled_points(a, None), images: self.images(b) }
    }

    /// Returns the factor of the correlations with each image of [`Term::images`].
    fn image_weights(&self) -> [f64; 2] {
        match self.reflection {
            Some(_) => [0.5 * self.variance, 0.5 * self.variance * self.reciprocity],
            None => [self.variance, 0.0],
        }
    }

    /// Adds the covariances of point `n` of the right side with the points from `first` on of the left side to `out`.
    pub(super) fn add_column(&self, pairs: &Pairs, (first, n): (usize, usize), out: &mut [f64], scratch: &mut Scratch) {
        for (image, weight) in pairs.images.iter().zip(self.image_weights()) {
            self.add_products(weight, (image, n), (&pairs.left, first), out, scratch);
        }
    }

    /// Returns whether every point has correlation 1 with itself. Points with a negative label do not.
    fn has_unit_diagonal(&self) -> bool {
        !self.correlations.iter().any(|correlation| correlation.shape().is_of_labels())
    }

    /// Adds k(x, x) for every point to `out`.
    pub(super) fn add_diagonal(&self, inputs: &Inputs, out: &mut [f64]) {
        if self.reflection.is_none() && self.has_unit_diagonal() {
            out.iter_mut().for_each(|v| *v += self.variance);
            return;
        }
        let (pairs, mut scratch) = (self.pairs(inputs, inputs), Scratch::default());
        for (n, out) in out.iter_mut().enumerate() {
            self.add_column(&pairs, (n, n), std::slice::from_mut(out), &mut scratch);
        }
    }

    /// Adds the slopes of every correlation to `sums`. The weights include the product of the other correlations.
    fn add_slopes(
        &self,
        (points, n): (&ScaledPoints, usize),
        (others, first): (&ScaledPoints, usize),
        weights: &[f64],
        sums: &mut [Slopes],
        scratch: &mut Scratch,
    ) {
        let Scratch { products, factors } = scratch;
        for (which, correlation) in self.correlations.iter().enumerate() {
            let place = |which: usize| ((&points[which], n), (&others[which], first));
            let (point, rows) = place(which);
            if self.correlations.len() == 1 {
                return correlation.add_slopes(point, rows, weights, &mut sums[which]);
            }
            products.clear();
            products.extend_from_slice(weights);
            factors.resize(weights.len(), 0.0);
            for (other, correlation) in self.correlations.iter().enumerate().filter(|(other, _)| *other != which) {
                let (point, rows) = place(other);
                correlation.write_to(point, rows, factors);
                products.iter_mut().zip(&*factors).for_each(|(product, factor)| *product *= factor);
            }
            correlation.add_slopes(point, rows, products, &mut sums[which]);
        }
    }

    /// Returns sums for [`Term::add_column_slopes`], all zero: one for each image and correlation.
    pub(super) fn slopes(&self) -> Vec<Slopes> {
        let images = 1 + usize::from(self.reflection.is_some());
        (0..images).flat_map(|_| self.correlations.iter().map(Correlation::slopes)).collect()
    }

    /// Adds the weighted correlations of [`Term::add_column`], without the variance, and their slopes to `sums`.
    pub(super) fn add_column_slopes(
        &self,
        pairs: &Pairs,
        (first, n): (usize, usize),
        weights: &[f64],
        sums: &mut [Slopes],
        scratch: &mut Scratch,
    ) {
        for (image, sums) in pairs.images.iter().zip(sums.chunks_mut(self.correlations.len())) {
            self.add_slopes((image, n), (&pairs.left, first), weights, sums, scratch);
        }
    }

    /// Adds Σ w ∂k/∂(parameters) to `gradient`, from the sums of [`Term::add_column_slopes`].
    pub(super) fn add_gradient(&self, sums: &[Slopes], gradient: &mut [f64]) {
        let images = sums.chunks(self.correlations.len());
        for (number, (sums, weight)) in images.zip(self.image_weights()).enumerate() {
            // The weighted sum of every correlation includes all other factors, so any of them is the sum of products.
            let products = weight * sums[0].correlation;
            gradient[0] += products;
            if number == 1 && self.learns_reciprocity() {
                gradient[1] += (1.0 - self.reciprocity) * products;
            }
            for ((correlation, part), sums) in self.parts().zip(sums) {
                correlation.add_gradient(weight, sums, &mut gradient[part]);
            }
        }
    }

    /// Adds Σ w_n ∂k(x_n, x_n)/∂(parameters) to `gradient`.
    pub(super) fn add_diagonal_gradient(&self, inputs: &Inputs, weights: &[f64], gradient: &mut [f64]) {
        if self.reflection.is_none() && self.has_unit_diagonal() {
            gradient[0] += self.variance * weights.iter().sum::<f64>();
            return;
        }
        let pairs = self.pairs(inputs, inputs);
        let (mut sums, mut scratch) = (self.slopes(), Scratch::default());
        for (n, weight) in weights.iter().enumerate() {
            self.add_column_slopes(&pairs, (n, n), std::slice::from_ref(weight), &mut sums, &mut scratch);
        }
        self.add_gradient(&sums, gradient);
    }
}

/// The serialised form of [`Term`].
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    variance: f64,
    correlations: Vec<Correlation>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reflection: Option<Reflection>,
    /// Absent for a term without reflection.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reciprocity: Option<f64>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Term {
    type Error = crate::error::Error;

    fn try_from(Parts { variance, correlations, reflection, reciprocity }: Parts) -> Result<Self> {
        let count = correlations.len() as f64;
        let mut correlations = correlations.into_iter();
        let first = correlations.next().ok_or(crate::error::Error::OutOfRange {
            what: "number of correlations of a kernel term",
            expected: "at least 1",
            value: count,
        })?;
        let term = correlations.try_fold(Self::of(variance, first)?, Self::times)?;
        match reflection {
            Some(reflection) => term.partly_reciprocal(reflection, reciprocity.unwrap_or(1.0)),
            None => Ok(term),
        }
    }
}

#[cfg(feature = "serde")]
impl From<Term> for Parts {
    fn from(Term { variance, correlations, reflection, reciprocity }: Term) -> Self {
        let reciprocity = reflection.is_some().then_some(reciprocity);
        Self { variance, correlations, reflection, reciprocity }
    }
}
