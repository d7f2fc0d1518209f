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
        // Farther than numbers reach, where the products below would be 0 · ∞.
        if !squared_distance.is_finite() {
            return 0.0;
        }
        match self {
            Shape::SquaredExponential => (-0.5 * squared_distance).exp(),
            Shape::Matern32 => {
                let r = (3.0 * squared_distance).sqrt();
                let decay = (-r).exp();
                decay + r * decay
            }
            Shape::Matern52 => {
                let r = (5.0 * squared_distance).sqrt();
                let decay = (-r).exp();
                decay + r * decay + r * (r * decay) / 3.0
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
        Self::new(columns.iter().map(|&column| (column, column, -1.0)).collect())
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
    length_scales: Vec<f64>,
    reflection: Option<Reflection>,
}

impl Term {
    /// A term over `columns` with one length-scale per column (the same everywhere: isotropic).
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
        Ok(Self { shape, variance, columns: columns.to_vec(), length_scales: length_scales.to_vec(), reflection: None })
    }

    /// An isotropic term over the first `dimension` columns. See [`Term::new`].
    ///
    /// # Errors
    /// As [`Term::new`].
    pub fn isotropic(shape: Shape, variance: f64, length_scale: f64, dimension: usize) -> Result<Self> {
        let columns: Vec<usize> = (0..dimension).collect();
        Self::new(shape, variance, &columns, &vec![length_scale; dimension])
    }

    /// Makes the term reciprocal: ½[k(x, x′) + k(x, Rx′)] (docs/method.md, section 7). Its diagonal depends on x.
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
        self.reflection = Some(reflection);
        Ok(self)
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

    /// Whether the term is reciprocal.
    pub fn is_reciprocal(&self) -> bool {
        self.reflection.is_some()
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
        let mut images = vec![self.scaled(b, false)];
        if self.reflection.is_some() {
            images.push(self.scaled(b, true));
        }
        let weight = self.variance / images.len() as f64;
        for image in &images {
            for (column, point) in image.chunks_exact(width).enumerate() {
                let first = first_row(column);
                self.add_correlations(weight, point, &left[first * width..], &mut out.column_mut(column)[first..]);
            }
        }
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
}
