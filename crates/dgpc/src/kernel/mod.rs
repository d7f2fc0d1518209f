//! Covariance functions (section 7 of [`crate::method`]).
//!
//! A [`Kernel`] is a sum of [`Term`]s; a term is a variance times one or more [`Correlation`]s over columns of their
//! own, reciprocal if it has a [`Reflection`]; a correlation is a [`Shape`] of the scaled distance. Whoever adds a
//! shape needs nothing but `shape.rs`, where its names and parameters are, and `formula.rs`.

mod formula;
mod reflection;
mod scaled;
mod shape;
mod correlation;
mod term;

pub use correlation::Correlation;
pub use reflection::{Image, Reflection};
pub use shape::Shape;
pub use term::Term;

use crate::error::{Error, Result, positive, same_size};
use crate::inputs::Inputs;
use crate::linalg::Matrix;
use crate::parameter::Parameter;

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
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "Vec<Term>", into = "Vec<Term>")
)]
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
        self.terms.iter().flat_map(Term::correlations).flat_map(Correlation::columns).copied()
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
        let mut cross = Matrix::zeros(a.len(), b.len());
        self.write_cross(a, b, &mut cross)?;
        Ok(cross)
    }

    /// Writes [`Kernel::cross`] over a matrix of its size.
    pub(crate) fn write_cross(&self, a: &Inputs, b: &Inputs, out: &mut Matrix) -> Result<()> {
        self.check(a)?;
        self.check(b)?;
        (0..out.columns()).for_each(|column| out.column_mut(column).fill(0.0));
        for term in &self.terms {
            term.add_gram(a, b, |_| 0, out);
        }
        Ok(())
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

    /// What is learned of a kernel, as logarithms: term by term the variance, then for every correlation its untied
    /// length-scales and the parameters of its shape.
    pub fn log_parameters(&self) -> Vec<f64> {
        self.terms.iter().flat_map(Term::log_parameters).collect()
    }

    /// What each of [`Kernel::log_parameters`] is.
    pub fn parameters(&self) -> impl Iterator<Item = Parameter> {
        self.terms.iter().flat_map(Term::parameters)
    }

    /// The same kernel with other parameters, as [`Kernel::log_parameters`] lays them out.
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] for another number of parameters, [`Error::OutOfRange`] or [`Error::NotFinite`] where a
    /// variance or length-scale leaves the range of numbers.
    pub fn with_log_parameters(&self, parameters: &[f64]) -> Result<Self> {
        same_size("parameters of a kernel", self.parameter_count(), parameters.len())?;
        let terms = self.parts().map(|(term, part)| term.with_log_parameters(&parameters[part]));
        Ok(Self { terms: terms.collect::<Result<_>>()? })
    }

    /// Whether the other differs in nothing but numbers that can be learned.
    pub(crate) fn has_structure_of(&self, other: &Kernel) -> bool {
        let mut pairs = self.terms.iter().zip(&other.terms);
        self.terms.len() == other.terms.len() && pairs.all(|(own, other)| own.has_structure_of(other))
    }

    /// Number of parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.terms.iter().map(Term::parameter_count).sum()
    }

    /// Every term, and which parameters are its own.
    fn parts(&self) -> impl Iterator<Item = (&Term, std::ops::Range<usize>)> {
        self.terms.iter().scan(0, |first, term| {
            let part = *first..*first + term.parameter_count();
            *first = part.end;
            Some((term, part))
        })
    }

    /// Σ_ij W_ij ∂k(x_i, x_j)/∂(log parameters) for a symmetric W, N×N. O(N²d).
    pub(crate) fn gram_gradient(&self, inputs: &Inputs, weights: &Matrix) -> Vec<f64> {
        let mut gradient = vec![0.0; self.parameter_count()];
        for (term, part) in self.parts() {
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
        for (term, part) in self.parts() {
            term.add_cross_gradient((a, b), |_| 0, weights, &mut gradient[part]);
        }
        gradient
    }

    /// Σ_n w_n ∂k(x_n, x_n)/∂(log parameters). O(Nd).
    pub(crate) fn diagonal_gradient(&self, inputs: &Inputs, weights: &[f64]) -> Vec<f64> {
        let mut gradient = vec![0.0; self.parameter_count()];
        for (term, part) in self.parts() {
            term.add_diagonal_gradient(inputs, weights, &mut gradient[part]);
        }
        gradient
    }
}

impl TryFrom<Vec<Term>> for Kernel {
    type Error = Error;

    fn try_from(terms: Vec<Term>) -> Result<Self> {
        Self::new(terms)
    }
}

impl From<Kernel> for Vec<Term> {
    fn from(kernel: Kernel) -> Self {
        kernel.terms
    }
}
