//! Covariance functions: sums of stationary terms over chosen input columns, each reciprocal or not (docs/method.md, section 7).

use crate::error::{Error, Result, finite, positive, same_size};
use crate::inputs::Inputs;
use crate::linalg::Matrix;

/// How covariance falls with scaled distance r.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// exp(−r²/2): infinitely smooth.
    SquaredExponential,
    /// (1 + √3 r) exp(−√3 r): once differentiable.
    Matern32,
    /// (1 + √5 r + 5r²/3) exp(−√5 r): twice differentiable.
    Matern52,
}

impl Shape {
    /// Correlation at squared scaled distance r².
    #[inline]
    fn correlation(self, squared_distance: f64) -> f64 {
        self.correlation_and_slope(squared_distance).0
    }

    /// Correlation at squared scaled distance r², and its derivative by r².
    #[inline]
    fn correlation_and_slope(self, squared_distance: f64) -> (f64, f64) {
        // Farther than numbers reach, where the products below would be 0 · ∞.
        if !squared_distance.is_finite() {
            return (0.0, 0.0);
        }
        match self {
            Shape::SquaredExponential => {
                let correlation = (-0.5 * squared_distance).exp();
                (correlation, -0.5 * correlation)
            }
            Shape::Matern32 => {
                let r = (3.0 * squared_distance).sqrt();
                let decay = (-r).exp();
                (decay + r * decay, -1.5 * decay)
            }
            Shape::Matern52 => {
                let r = (5.0 * squared_distance).sqrt();
                let decay = (-r).exp();
                let linear = decay + r * decay;
                (linear + r * (r * decay) / 3.0, -5.0 / 6.0 * linear)
            }
        }
    }
}

/// An involution x → Rx of the inputs that exchanges columns or turns their sign, such as swapping the two ends of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Reflection {
    /// (Rx)_column = sign · x_source for each (column, source, sign); other columns stay as they are.
    images: Vec<(usize, usize, f64)>,
}

impl Reflection {
    /// Exchanges the columns of each pair: `swap(&[(0, 2), (1, 3)])` turns (a, b, c, d) into (c, d, a, b).
    ///
    /// # Errors
    /// [`Error::RepeatedColumn`] when a column is named twice.
    pub fn swap(pairs: &[(usize, usize)]) -> Result<Self> {
        Self::new(pairs.iter().flat_map(|&(a, b)| [(a, b, 1.0), (b, a, 1.0)]).collect())
    }

    /// Turns the sign of the named columns.
    ///
    /// # Errors
    /// [`Error::RepeatedColumn`] when a column is named twice.
    pub fn negate(columns: &[usize]) -> Result<Self> {
        Self { images: Vec::new() }.and_negate(columns)
    }

    /// The same reflection that also turns the sign of other columns.
    ///
    /// # Errors
    /// [`Error::RepeatedColumn`] when a column is named twice or is already exchanged.
    pub fn and_negate(mut self, columns: &[usize]) -> Result<Self> {
        self.images.extend(columns.iter().map(|&column| (column, column, -1.0)));
        Self::new(self.images)
    }

    /// Checks that no column is named twice.
    fn new(images: Vec<(usize, usize, f64)>) -> Result<Self> {
        for (n, &(column, ..)) in images.iter().enumerate() {
            if images[..n].iter().any(|&(other, ..)| other == column) {
                return Err(Error::RepeatedColumn { what: "reflection", column });
            }
        }
        Ok(Self { images })
    }

    /// The column that lands in `column`, and with which sign.
    fn image(&self, column: usize) -> (usize, f64) {
        let image = self.images.iter().find(|&&(own, ..)| own == column);
        image.map_or((column, 1.0), |&(_, source, sign)| (source, sign))
    }
}

/// One term of a kernel: variance · correlation(scaled distance over the chosen columns), reciprocal if it has a reflection:
/// ½[k(x, x′) + k(x, Rx′)].
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    shape: Shape,
    variance: f64,
    columns: Vec<usize>,
    /// One per column.
    length_scales: Vec<f64>,
    /// For every column the group whose length-scale it shares; groups are numbered from 0 in the order of their first column.
    groups: Vec<usize>,
    reflection: Option<Reflection>,
}

impl Term {
    /// A term over `columns` with one length-scale per column, each learned by itself (see [`Term::tied`]).
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a variance or length-scale that is not finite and positive or for no columns,
    /// [`Error::SizeMismatch`] for another number of length-scales than columns, [`Error::RepeatedColumn`].
    pub fn new(shape: Shape, variance: f64, columns: &[usize], length_scales: &[f64]) -> Result<Self> {
        positive("kernel variance", variance)?;
        positive("number of kernel columns", columns.len() as f64)?;
        same_size("length-scales, one per kernel column", columns.len(), length_scales.len())?;
        for &length_scale in length_scales {
            positive("length-scale", length_scale)?;
            finite("reciprocal of a length-scale", length_scale.recip())?;
        }
        for (i, column) in columns.iter().enumerate() {
            if columns[..i].contains(column) {
                return Err(Error::RepeatedColumn { what: "kernel term", column: *column });
            }
        }
        let groups = (0..columns.len()).collect();
        let (columns, length_scales) = (columns.to_vec(), length_scales.to_vec());
        Ok(Self { shape, variance, columns, length_scales, groups, reflection: None })
    }

    /// An isotropic term over the first `dimension` columns, which share one length-scale. See [`Term::new`].
    ///
    /// # Errors
    /// As [`Term::new`].
    pub fn isotropic(shape: Shape, variance: f64, length_scale: f64, dimension: usize) -> Result<Self> {
        let columns: Vec<usize> = (0..dimension).collect();
        Self::new(shape, variance, &columns, &vec![length_scale; dimension])?.tied(&vec![0; dimension])
    }

    /// Ties the length-scales of columns with the same number in `groups` (one per column) to each other: they are one
    /// parameter when the kernel is learned.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of groups than columns, [`Error::Different`] when tied length-scales differ.
    pub fn tied(mut self, groups: &[usize]) -> Result<Self> {
        same_size("groups of length-scales, one per kernel column", self.columns.len(), groups.len())?;
        let first = |group: usize| groups.iter().position(|&other| other == group).unwrap_or_default();
        for (column, &group) in groups.iter().enumerate() {
            if self.length_scales[first(group)] != self.length_scales[column] {
                return Err(Error::Different { what: "tied columns of a kernel term", of: "length-scales" });
            }
        }
        self.groups = renumbered(groups);
        Ok(self)
    }

    /// Makes the term reciprocal: ½[k(x, x′) + k(x, Rx′)] (docs/method.md, section 7). Its diagonal depends on x. Columns that
    /// the reflection exchanges are tied.
    ///
    /// # Errors
    /// [`Error::NotReciprocal`] when the reflection leaves the term's columns or exchanges columns of different
    /// length-scale: the result would not be positive definite.
    pub fn reciprocal(mut self, reflection: Reflection) -> Result<Self> {
        let length_scale = |column: usize| {
            let place = self.columns.iter().position(|&c| c == column);
            place.map_or(f64::NAN, |place| self.length_scales[place])
        };
        for (&column, &own) in self.columns.iter().zip(&self.length_scales) {
            let (partner, _) = reflection.image(column);
            if length_scale(partner) != own {
                return Err(Error::NotReciprocal {
                    column,
                    partner,
                    length_scale: own,
                    partner_length_scale: length_scale(partner),
                });
            }
        }
        for (place, column) in self.columns.iter().enumerate() {
            let (partner, _) = reflection.image(*column);
            let partner = self.columns.iter().position(|&c| c == partner).unwrap_or(place);
            let (own, other) = (self.groups[place], self.groups[partner]);
            self.groups.iter_mut().filter(|group| **group == other).for_each(|group| *group = own);
        }
        self.groups = renumbered(&self.groups);
        self.reflection = Some(reflection);
        Ok(self)
    }

    /// The same term with another variance.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a variance that is not finite and positive.
    pub fn with_variance(&self, variance: f64) -> Result<Self> {
        positive("kernel variance", variance)?;
        Ok(Self { variance, ..self.clone() })
    }

    /// How covariance falls with distance.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Variance of the term (before the halving of the reciprocal form).
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// The input columns the term looks at.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// One length-scale per column, in the order of [`Term::columns`].
    pub fn length_scales(&self) -> &[f64] {
        &self.length_scales
    }

    /// For every column the group of tied columns that it belongs to, numbered from 0.
    pub fn groups(&self) -> &[usize] {
        &self.groups
    }

    /// Whether the term is reciprocal.
    pub fn is_reciprocal(&self) -> bool {
        self.reflection.is_some()
    }

    /// Number of length-scales that are not tied to each other.
    fn group_count(&self) -> usize {
        self.groups.iter().max().map_or(0, |last| last + 1)
    }

    /// Number of parameters that can be learned: the variance, and a length-scale for every group.
    pub(crate) fn parameter_count(&self) -> usize {
        1 + self.group_count()
    }

    /// ln of the variance and of every group's length-scale.
    pub(crate) fn log_parameters(&self) -> impl Iterator<Item = f64> {
        let length_scale = |group: usize| {
            let column = self.groups.iter().position(|&other| other == group).unwrap_or_default();
            self.length_scales[column].ln()
        };
        std::iter::once(self.variance.ln()).chain((0..self.group_count()).map(length_scale))
    }

    /// The same term with other parameters, as [`Term::log_parameters`] lays them out.
    pub(crate) fn with_log_parameters(&self, parameters: &[f64]) -> Result<Self> {
        let length_scales: Vec<f64> = self.groups.iter().map(|&group| parameters[1 + group].exp()).collect();
        let checked = Self::new(self.shape, parameters[0].exp(), &self.columns, &length_scales)?;
        Ok(Self { groups: self.groups.clone(), reflection: self.reflection.clone(), ..checked })
    }

    /// The chosen columns of every point, reflected if asked, divided by their length-scales: N rows of `columns.len()`.
    fn scaled(&self, inputs: &Inputs, reflected: bool) -> Vec<f64> {
        let picks: Vec<(usize, f64)> = self
            .columns
            .iter()
            .zip(&self.length_scales)
            .map(|(&column, &length_scale)| match &self.reflection {
                Some(reflection) if reflected => {
                    let (source, sign) = reflection.image(column);
                    (source, sign / length_scale)
                }
                _ => (column, 1.0 / length_scale),
            })
            .collect();
        inputs.rows().flat_map(|row| picks.iter().map(|&(column, factor)| row[column] * factor)).collect()
    }

    /// The scaled points and, for a reciprocal term, their reflections.
    fn images(&self, inputs: &Inputs) -> Vec<Vec<f64>> {
        let mut images = vec![self.scaled(inputs, false)];
        if self.reflection.is_some() {
            images.push(self.scaled(inputs, true));
        }
        images
    }

    /// Adds `weight` · correlation between `point` and every one of `others` (rows of scaled coordinates) to `out`.
    fn add_correlations(&self, weight: f64, point: &[f64], others: &[f64], out: &mut [f64]) {
        for (other, out) in others.chunks_exact(point.len()).zip(out) {
            let mut squared_distance = 0.0;
            for (a, b) in point.iter().zip(other) {
                squared_distance += (a - b) * (a - b);
            }
            *out += weight * self.shape.correlation(squared_distance);
        }
    }

    /// Adds the term's Gram matrix of `a` against `b`, from row `first_row(column)` of each column on.
    fn add_gram(&self, a: &Inputs, b: &Inputs, first_row: impl Fn(usize) -> usize, out: &mut Matrix) {
        let width = self.columns.len();
        let left = self.scaled(a, false);
        let images = self.images(b);
        let weight = self.variance / images.len() as f64;
        for image in &images {
            for (column, point) in image.chunks_exact(width).enumerate() {
                let first = first_row(column);
                self.add_correlations(weight, point, &left[first * width..], &mut out.column_mut(column)[first..]);
            }
        }
    }

    /// Adds Σ wᵢ · (correlation, its derivative by r² times each column's part of r²) over the pairs of `point` and `others`
    /// to `sums`, one entry more than columns.
    fn add_slopes(&self, point: &[f64], others: &[f64], weights: &[f64], sums: &mut [f64]) {
        let mut squares = vec![0.0; point.len()];
        for (other, weight) in others.chunks_exact(point.len()).zip(weights) {
            for ((square, a), b) in squares.iter_mut().zip(point).zip(other) {
                *square = (a - b) * (a - b);
            }
            let (correlation, slope) = self.shape.correlation_and_slope(squares.iter().sum());
            sums[0] += weight * correlation;
            let slope = weight * slope;
            // Beyond the reach of numbers the slope is zero and the square may be infinite.
            if slope != 0.0 {
                sums[1..].iter_mut().zip(&squares).for_each(|(sum, square)| *sum += slope * square);
            }
        }
    }

    /// Adds `factor` · the sums of [`Term::add_slopes`] to a gradient by ln variance and ln length-scales: ∂r²/∂ln ℓ_c is
    /// −2 · (column c's part of r²).
    fn add_parts(&self, factor: f64, sums: &[f64], gradient: &mut [f64]) {
        gradient[0] += factor * sums[0];
        for (sum, &group) in sums[1..].iter().zip(&self.groups) {
            gradient[1 + group] -= 2.0 * factor * sum;
        }
    }

    /// Adds Σ W_ij ∂k(a_i, b_j)/∂(log parameters) to `gradient`, over rows from `first_row(column)` of each column on.
    fn add_cross_gradient(
        &self,
        (a, b): (&Inputs, &Inputs),
        first_row: impl Fn(usize) -> usize,
        weights: &Matrix,
        gradient: &mut [f64],
    ) {
        let width = self.columns.len();
        let left = self.scaled(a, false);
        let images = self.images(b);
        let mut sums = vec![0.0; 1 + width];
        for image in &images {
            for (column, point) in image.chunks_exact(width).enumerate() {
                let first = first_row(column);
                self.add_slopes(point, &left[first * width..], &weights.column(column)[first..], &mut sums);
            }
        }
        self.add_parts(self.variance / images.len() as f64, &sums, gradient);
    }

    /// Adds Σ w_n ∂k(x_n, x_n)/∂(log parameters) to `gradient`.
    fn add_diagonal_gradient(&self, inputs: &Inputs, weights: &[f64], gradient: &mut [f64]) {
        let width = self.columns.len();
        let mut sums = vec![0.0; 1 + width];
        let total: f64 = weights.iter().sum();
        if self.reflection.is_none() {
            gradient[0] += self.variance * total;
            return;
        }
        let (points, images) = (self.scaled(inputs, false), self.scaled(inputs, true));
        for ((point, image), weight) in points.chunks_exact(width).zip(images.chunks_exact(width)).zip(weights) {
            self.add_slopes(point, image, std::slice::from_ref(weight), &mut sums);
        }
        sums[0] += total;
        self.add_parts(0.5 * self.variance, &sums, gradient);
    }

    /// Adds k(x, x) for every point to `out`.
    fn add_diagonal(&self, inputs: &Inputs, out: &mut [f64]) {
        if self.reflection.is_none() {
            out.iter_mut().for_each(|v| *v += self.variance);
            return;
        }
        let width = self.columns.len();
        let (points, images) = (self.scaled(inputs, false), self.scaled(inputs, true));
        for ((point, image), out) in points.chunks_exact(width).zip(images.chunks_exact(width)).zip(out) {
            *out += 0.5 * self.variance;
            self.add_correlations(0.5 * self.variance, point, image, std::slice::from_mut(out));
        }
    }
}

/// A covariance function: the sum of its terms.
///
/// ```
/// use dgpc::{Inputs, Kernel, Reflection, Shape, Term};
///
/// // A link (tx east, tx north, rx east, rx north) whose two directions behave alike.
/// let term = Term::isotropic(Shape::Matern52, 4.0, 300.0, 4)?.reciprocal(Reflection::swap(&[(0, 2), (1, 3)])?)?;
/// let kernel = Kernel::new(vec![term])?;
/// let ends = Inputs::from_rows(&[[0.0, 0.0, 500.0, 0.0], [500.0, 0.0, 0.0, 0.0]])?;
/// let gram = kernel.gram(&ends)?;
/// assert!((gram[(0, 1)] - gram[(0, 0)]).abs() < 1e-12);
/// # Ok::<(), dgpc::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Kernel {
    terms: Vec<Term>,
}

impl Kernel {
    /// The sum of `terms`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] when there are none.
    pub fn new(terms: Vec<Term>) -> Result<Self> {
        positive("number of kernel terms", terms.len() as f64)?;
        Ok(Self { terms })
    }

    /// The terms.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Every column that a term looks at.
    pub(crate) fn columns(&self) -> impl Iterator<Item = usize> {
        self.terms.iter().flat_map(|term| &term.columns).copied()
    }

    /// Checks that inputs have every column that a term looks at.
    pub(crate) fn check(&self, inputs: &Inputs) -> Result<()> {
        let columns = inputs.dimension();
        match self.columns().find(|&column| column >= columns) {
            Some(column) => Err(Error::BadColumn { what: "kernel term", column, columns }),
            None => Ok(()),
        }
    }

    /// The N×N Gram matrix of `inputs`. O(N²d).
    ///
    /// # Errors
    /// [`Error::BadColumn`] when a term looks at a column that the inputs do not have.
    pub fn gram(&self, inputs: &Inputs) -> Result<Matrix> {
        self.check(inputs)?;
        let mut gram = Matrix::zeros(inputs.len(), inputs.len());
        for term in &self.terms {
            term.add_gram(inputs, inputs, |column| column, &mut gram);
        }
        gram.mirror_lower();
        Ok(gram)
    }

    /// The N_a×N_b Gram matrix of `a` against `b`. O(N_a N_b d).
    ///
    /// # Errors
    /// As [`Kernel::gram`].
    pub fn cross(&self, a: &Inputs, b: &Inputs) -> Result<Matrix> {
        self.check(a)?;
        self.check(b)?;
        let mut cross = Matrix::zeros(a.len(), b.len());
        for term in &self.terms {
            term.add_gram(a, b, |_| 0, &mut cross);
        }
        Ok(cross)
    }

    /// k(x, x) of every point. O(Nd).
    ///
    /// # Errors
    /// As [`Kernel::gram`].
    pub fn diagonal(&self, inputs: &Inputs) -> Result<Vec<f64>> {
        self.check(inputs)?;
        let mut diagonal = vec![0.0; inputs.len()];
        for term in &self.terms {
            term.add_diagonal(inputs, &mut diagonal);
        }
        Ok(diagonal)
    }

    /// What is learned of a kernel: term by term ln of the variance, then ln of the length-scale of every group of tied columns.
    pub fn log_parameters(&self) -> Vec<f64> {
        self.terms.iter().flat_map(Term::log_parameters).collect()
    }

    /// The same kernel with other parameters, as [`Kernel::log_parameters`] lays them out.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of parameters, [`Error::OutOfRange`] or [`Error::NotFinite`] where a variance or
    /// length-scale leaves the range of numbers.
    pub fn with_log_parameters(&self, parameters: &[f64]) -> Result<Self> {
        same_size("parameters of a kernel", self.parameter_count(), parameters.len())?;
        let parts = self.parts();
        let terms = self.terms.iter().zip(parts).map(|(term, part)| term.with_log_parameters(&parameters[part]));
        Ok(Self { terms: terms.collect::<Result<_>>()? })
    }

    /// Whether the other differs in nothing but variances and length-scales.
    pub(crate) fn has_structure_of(&self, other: &Kernel) -> bool {
        let same = |(own, other): (&Term, &Term)| {
            let part = |term: &Term| (term.shape, term.columns.clone(), term.groups.clone(), term.reflection.clone());
            part(own) == part(other)
        };
        self.terms.len() == other.terms.len() && self.terms.iter().zip(&other.terms).all(same)
    }

    /// Number of parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.terms.iter().map(Term::parameter_count).sum()
    }

    /// Places of the variances among the parameters.
    pub(crate) fn variance_places(&self) -> impl Iterator<Item = usize> {
        self.parts().map(|part| part.start)
    }

    /// Places of the length-scales among the parameters.
    pub(crate) fn length_scale_places(&self) -> impl Iterator<Item = usize> {
        self.parts().flat_map(|part| part.start + 1..part.end)
    }

    /// Which parameters belong to each term.
    fn parts(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        self.terms.iter().scan(0, |first, term| {
            let part = *first..*first + term.parameter_count();
            *first = part.end;
            Some(part)
        })
    }

    /// Σ_ij W_ij ∂k(x_i, x_j)/∂(log parameters) for a symmetric W, N×N. O(N²d).
    pub(crate) fn gram_gradient(&self, inputs: &Inputs, weights: &Matrix) -> Vec<f64> {
        let mut gradient = vec![0.0; self.parameter_count()];
        for (term, part) in self.terms.iter().zip(self.parts()) {
            term.add_cross_gradient((inputs, inputs), |column| column, weights, &mut gradient[part]);
        }
        gradient.iter_mut().for_each(|entry| *entry *= 2.0);
        let diagonal = self.diagonal_gradient(inputs, &weights.diagonal());
        gradient.iter_mut().zip(&diagonal).for_each(|(entry, diagonal)| *entry -= diagonal);
        gradient
    }

    /// Σ_ij W_ij ∂k(a_i, b_j)/∂(log parameters), W of size N_a×N_b. O(N_a N_b d).
    pub(crate) fn cross_gradient(&self, a: &Inputs, b: &Inputs, weights: &Matrix) -> Vec<f64> {
        let mut gradient = vec![0.0; self.parameter_count()];
        for (term, part) in self.terms.iter().zip(self.parts()) {
            term.add_cross_gradient((a, b), |_| 0, weights, &mut gradient[part]);
        }
        gradient
    }

    /// Σ_n w_n ∂k(x_n, x_n)/∂(log parameters). O(Nd).
    pub(crate) fn diagonal_gradient(&self, inputs: &Inputs, weights: &[f64]) -> Vec<f64> {
        let mut gradient = vec![0.0; self.parameter_count()];
        for (term, part) in self.terms.iter().zip(self.parts()) {
            term.add_diagonal_gradient(inputs, weights, &mut gradient[part]);
        }
        gradient
    }
}

/// The same partition with groups numbered from 0 in the order of their first member.
fn renumbered(groups: &[usize]) -> Vec<usize> {
    let mut seen: Vec<usize> = Vec::new();
    let number = |&group: &usize| {
        seen.iter().position(|&other| other == group).unwrap_or_else(|| {
            seen.push(group);
            seen.len() - 1
        })
    };
    groups.iter().map(number).collect()
}
