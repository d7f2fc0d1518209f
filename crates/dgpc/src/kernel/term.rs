//! The summands of a kernel.

use super::correlation::{Correlation, Slopes};
use super::reflection::Reflection;
use super::scaled::Scaled;
use super::shape::Shape;
use crate::error::{Result, positive};
use crate::inputs::Inputs;
use crate::linalg::add_scaled;
use crate::parameter::Parameter;

/// One term of a kernel: variance · correlation (or a product of several correlations, each over columns of its own),
/// reciprocal if it has a reflection: ½[k(x, x′) + k(x, Rx′)].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Parts", into = "Parts"))]
pub struct Term {
    variance: f64,
    /// At least one.
    correlations: Vec<Correlation>,
    reflection: Option<Reflection>,
}

/// Points as a term sees them: as each of its correlations does.
type Seen = Vec<Scaled>;

/// Points of one side against those of another, as a term sees them.
pub(super) struct Pairs {
    left: Seen,
    /// Of the right side, and of its reflection for a reciprocal term.
    images: Vec<Seen>,
}

/// Room for numbers of many pairs of points.
#[derive(Default)]
pub(super) struct Room {
    products: Vec<f64>,
    factors: Vec<f64>,
}

impl Term {
    /// A term over `columns` with one length-scale per column, each learned by itself.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a variance that is not finite and positive, and as [`Correlation::new`].
    pub fn new(shape: Shape, variance: f64, columns: &[usize], length_scales: &[f64]) -> Result<Self> {
        Self::of(variance, Correlation::new(shape, columns, length_scales)?)
    }

    /// An isotropic term over the first `dimension` columns, which share one length-scale. See [`Term::new`].
    ///
    /// # Errors
    /// As [`Term::new`].
    pub fn isotropic(shape: Shape, variance: f64, length_scale: f64, dimension: usize) -> Result<Self> {
        Self::of(variance, Correlation::isotropic(shape, &Vec::from_iter(0..dimension), length_scale)?)
    }

    /// A variance and a correlation.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a variance that is not finite and positive.
    pub fn of(variance: f64, correlation: Correlation) -> Result<Self> {
        positive("kernel variance", variance)?;
        Ok(Self { variance, correlations: vec![correlation], reflection: None })
    }

    /// The term times another correlation: two points are alike only if they are alike in both.
    ///
    /// # Errors
    /// [`crate::Error::NotReciprocal`] when the term is reciprocal and the correlation cannot be.
    pub fn times(mut self, correlation: Correlation) -> Result<Self> {
        let correlation = match &self.reflection {
            Some(reflection) => correlation.tied_by(reflection)?,
            None => correlation,
        };
        self.correlations.push(correlation);
        Ok(self)
    }

    /// Makes the term reciprocal: ½[k(x, x′) + k(x, Rx′)] (section 7 of [`crate::method`]). Its diagonal depends on x.
    /// Columns that the reflection exchanges are tied.
    ///
    /// # Errors
    /// [`crate::Error::NotReciprocal`] when the reflection leaves the columns of a correlation or exchanges columns of
    /// different length-scale: the result would not be positive definite.
    pub fn reciprocal(mut self, reflection: Reflection) -> Result<Self> {
        let tied = self.correlations.into_iter().map(|correlation| correlation.tied_by(&reflection));
        self.correlations = tied.collect::<Result<_>>()?;
        self.reflection = Some(reflection);
        Ok(self)
    }

    /// The same term with another variance.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a variance that is not finite and positive.
    pub fn with_variance(&self, variance: f64) -> Result<Self> {
        positive("kernel variance", variance)?;
        Ok(Self { variance, ..self.clone() })
    }

    /// The same term with another shape of its first correlation, whose parameters are as given.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] for a parameter of the shape out of its range.
    pub fn with_shape(&self, shape: Shape) -> Result<Self> {
        let mut term = self.clone();
        term.correlations[0] = term.correlations[0].with_shape(shape)?;
        Ok(term)
    }

    /// The same term with one length-scale of its first correlation, by its number among those that are not tied, times a
    /// positive factor.
    ///
    /// # Errors
    /// [`crate::Error::OutOfRange`] where it has no such length-scale, or where that leaves the range of numbers.
    pub fn with_length_scale_times(&self, number: usize, factor: f64) -> Result<Self> {
        let mut term = self.clone();
        term.correlations[0] = term.correlations[0].with_length_scale_times(number, factor)?;
        Ok(term)
    }

    /// Variance of the term (before the halving of the reciprocal form).
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// The correlations that it is a product of, at least one.
    pub fn correlations(&self) -> &[Correlation] {
        &self.correlations
    }

    /// What makes it reciprocal, if it is.
    pub fn reflection(&self) -> Option<&Reflection> {
        self.reflection.as_ref()
    }

    /// Whether the term is reciprocal.
    pub fn is_reciprocal(&self) -> bool {
        self.reflection.is_some()
    }

    /// Number of parameters that can be learned: the variance, and those of every correlation.
    pub(super) fn parameter_count(&self) -> usize {
        1 + self.correlations.iter().map(Correlation::parameter_count).sum::<usize>()
    }

    /// ln of the variance and of the parameters of every correlation.
    pub(super) fn log_parameters(&self) -> impl Iterator<Item = f64> {
        std::iter::once(self.variance.ln()).chain(self.correlations.iter().flat_map(Correlation::log_parameters))
    }

    /// The same term with other parameters, as [`Term::log_parameters`] lays them out.
    pub(super) fn with_log_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let variance = positive("kernel variance", parameters[0].exp())?;
        let correlations = self.parts().map(|(correlation, part)| correlation.with_log_parameters(&parameters[part]));
        let correlations = correlations.collect::<Result<_>>()?;
        Ok(Self { variance, correlations, reflection: self.reflection.clone() })
    }

    /// What each of the parameters is.
    pub(super) fn parameters(&self) -> impl Iterator<Item = Parameter> {
        std::iter::once(Parameter::Variance).chain(self.correlations.iter().flat_map(Correlation::parameters))
    }

    /// Every correlation, and which of the term's parameters are its own.
    fn parts(&self) -> impl Iterator<Item = (&Correlation, std::ops::Range<usize>)> {
        self.correlations.iter().scan(1, |first, correlation| {
            let part = *first..*first + correlation.parameter_count();
            *first = part.end;
            Some((correlation, part))
        })
    }

    /// Whether the other differs in nothing but numbers that can be learned.
    pub(super) fn has_structure_of(&self, other: &Self) -> bool {
        let mut pairs = self.correlations.iter().zip(&other.correlations);
        self.correlations.len() == other.correlations.len()
            && self.reflection == other.reflection
            && pairs.all(|(own, other)| own.has_structure_of(other))
    }

    fn seen(&self, inputs: &Inputs, reflection: Option<&Reflection>) -> Seen {
        self.correlations.iter().map(|correlation| correlation.scaled(inputs, reflection)).collect()
    }

    /// The scaled points and, for a reciprocal term, their reflections.
    fn images(&self, inputs: &Inputs) -> Vec<Seen> {
        let mut images = vec![self.seen(inputs, None)];
        images.extend(self.reflection.as_ref().map(|reflection| self.seen(inputs, Some(reflection))));
        images
    }

    /// Adds `weight` · the product of correlations between point `n` of `points` and those of `others` from `first` on
    /// to `out`.
    fn add_products(
        &self,
        weight: f64,
        (points, n): (&Seen, usize),
        (others, first): (&Seen, usize),
        out: &mut [f64],
        room: &mut Room,
    ) {
        let Room { products, factors } = room;
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

    /// `a` against `b`, as the term sees them.
    pub(super) fn pairs(&self, a: &Inputs, b: &Inputs) -> Pairs {
        Pairs { left: self.seen(a, None), images: self.images(b) }
    }

    /// Adds the covariances of points `first..` of the left side with point `n` of the right one to `out`.
    pub(super) fn add_column(&self, pairs: &Pairs, (first, n): (usize, usize), out: &mut [f64], room: &mut Room) {
        let weight = self.variance / pairs.images.len() as f64;
        for image in &pairs.images {
            self.add_products(weight, (image, n), (&pairs.left, first), out, room);
        }
    }

    /// Whether every point correlates fully with itself, as all but those without a label do.
    fn is_one_with_itself(&self) -> bool {
        !self.correlations.iter().any(|correlation| correlation.shape().is_of_labels())
    }

    /// Adds k(x, x) for every point to `out`.
    pub(super) fn add_diagonal(&self, inputs: &Inputs, out: &mut [f64]) {
        if self.reflection.is_none() && self.is_one_with_itself() {
            out.iter_mut().for_each(|v| *v += self.variance);
            return;
        }
        let (pairs, mut room) = (self.pairs(inputs, inputs), Room::default());
        for (n, out) in out.iter_mut().enumerate() {
            self.add_column(&pairs, (n, n), std::slice::from_mut(out), &mut room);
        }
    }

    /// Adds the slopes of every correlation, weighted also by all the others, to `sums`.
    fn add_slopes(
        &self,
        (points, n): (&Seen, usize),
        (others, first): (&Seen, usize),
        weights: &[f64],
        sums: &mut [Slopes],
        room: &mut Room,
    ) {
        let Room { products, factors } = room;
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

    /// Sums for [`Term::add_column_slopes`], all zero.
    pub(super) fn slopes(&self) -> Vec<Slopes> {
        self.correlations.iter().map(Correlation::slopes).collect()
    }

    /// Adds what [`Term::add_column`] adds, but for the variance, times `weights` to `sums`, with its slopes.
    pub(super) fn add_column_slopes(
        &self,
        pairs: &Pairs,
        (first, n): (usize, usize),
        weights: &[f64],
        sums: &mut [Slopes],
        room: &mut Room,
    ) {
        for image in &pairs.images {
            self.add_slopes((image, n), (&pairs.left, first), weights, sums, room);
        }
    }

    /// Adds Σ w ∂k/∂(log parameters) to `gradient`, from the sums of [`Term::add_column_slopes`].
    pub(super) fn add_gradient(&self, pairs: &Pairs, sums: &[Slopes], gradient: &mut [f64]) {
        let factor = self.variance / pairs.images.len() as f64;
        // The correlations' weighted sums are all that of their product.
        gradient[0] += factor * sums[0].correlation;
        for ((correlation, part), sums) in self.parts().zip(sums) {
            correlation.add_gradient(factor, sums, &mut gradient[part]);
        }
    }

    /// Adds Σ w_n ∂k(x_n, x_n)/∂(log parameters) to `gradient`.
    pub(super) fn add_diagonal_gradient(&self, inputs: &Inputs, weights: &[f64], gradient: &mut [f64]) {
        if self.reflection.is_none() && self.is_one_with_itself() {
            gradient[0] += self.variance * weights.iter().sum::<f64>();
            return;
        }
        let pairs = self.pairs(inputs, inputs);
        let (mut sums, mut room) = (self.slopes(), Room::default());
        for (n, weight) in weights.iter().enumerate() {
            self.add_column_slopes(&pairs, (n, n), std::slice::from_ref(weight), &mut sums, &mut room);
        }
        self.add_gradient(&pairs, &sums, gradient);
    }
}

/// The parts of a term as they are written down.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Parts {
    variance: f64,
    correlations: Vec<Correlation>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reflection: Option<Reflection>,
}

#[cfg(feature = "serde")]
impl TryFrom<Parts> for Term {
    type Error = crate::error::Error;

    fn try_from(Parts { variance, correlations, reflection }: Parts) -> Result<Self> {
        let count = correlations.len() as f64;
        let mut correlations = correlations.into_iter();
        let first = correlations.next().ok_or(crate::error::Error::OutOfRange {
            what: "number of correlations of a kernel term",
            expected: "at least 1",
            value: count,
        })?;
        let term = correlations.try_fold(Self::of(variance, first)?, Self::times)?;
        match reflection {
            Some(reflection) => term.reciprocal(reflection),
            None => Ok(term),
        }
    }
}

#[cfg(feature = "serde")]
impl From<Term> for Parts {
    fn from(Term { variance, correlations, reflection }: Term) -> Self {
        Self { variance, correlations, reflection }
    }
}
