//! Covariance functions ([`crate::method::kernels`]).
//!
//! A [`Kernel`] is a sum of [`Term`]s. A term is a variance times one or more [`Correlation`]s, each over its own
//! columns. With a [`Reflection`] the term is reciprocal. A correlation is a [`Shape`] of the scaled distance. A new
//! shape needs changes in `shape.rs`, which holds names and parameters, and in `formula.rs` only.

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

use std::ops::Range;

use correlation::Slopes;
use term::{Pairs, Scratch};

use crate::error::{Error, Result, positive, same_size};
use crate::inputs::Inputs;
use crate::linalg::{Matrix, add_scaled};
use crate::parameter::Parameter;
use crate::parts::{on_parts, stretches};

/// Number of Gram matrix columns in a unit of work for one thread.
const PANEL: usize = 64;

/// A covariance function: the sum of its terms.
///
/// ```
/// use dgpc::{Inputs, Kernel, Reflection, Shape, Term};
///
/// // A link (tx east, tx north, rx east, rx north) with equal covariances in both directions.
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
    /// Creates the sum of `terms`.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] if there are no terms.
    pub fn new(terms: Vec<Term>) -> Result<Self> {
        positive("number of kernel terms", terms.len() as f64)?;
        Ok(Self { terms })
    }

    /// Returns the terms.
    pub fn terms(&self) -> &[Term] {
        &self.terms
    }

    /// Returns every column that a term uses.
    pub(crate) fn columns(&self) -> impl Iterator<Item = usize> {
        self.terms.iter().flat_map(Term::correlations).flat_map(Correlation::columns).copied()
    }

    /// Checks that inputs have every column that a term uses.
    pub(crate) fn check(&self, inputs: &Inputs) -> Result<()> {
        let columns = inputs.dimension();
        match self.columns().find(|&column| column >= columns) {
            Some(column) => Err(Error::BadColumn { what: "kernel term", column, columns }),
            None => Ok(()),
        }
    }

    /// Returns the N×N Gram matrix of `inputs`. O(N²d).
    ///
    /// # Errors
    /// [`Error::BadColumn`] if a term uses a column that the inputs do not have.
    pub fn gram(&self, inputs: &Inputs) -> Result<Matrix> {
        let mut gram = Matrix::zeros(inputs.len(), inputs.len());
        self.write_gram(inputs, &mut gram)?;
        Ok(gram)
    }

    /// Writes [`Kernel::gram`] to a matrix of the same size.
    pub(crate) fn write_gram(&self, inputs: &Inputs, gram: &mut Matrix) -> Result<()> {
        self.check(inputs)?;
        let (pairs, mut columns) = (self.pairs(inputs, inputs), gram.split_columns());
        on_parts(columns.chunks_mut(PANEL).enumerate().collect(), |(panel, columns)| {
            let mut scratch = Scratch::default();
            for (n, column) in (panel * PANEL..).zip(columns) {
                column[n..].fill(0.0);
                pairs.iter().for_each(|(term, pairs)| term.add_column(pairs, (n, n), &mut column[n..], &mut scratch));
            }
        });
        gram.mirror_lower();
        Ok(())
    }

    /// Returns the N_a×N_b matrix of covariances between `a` and `b`. O(N_a N_b d).
    ///
    /// # Errors
    /// As [`Kernel::gram`].
    pub fn cross(&self, a: &Inputs, b: &Inputs) -> Result<Matrix> {
        let mut cross = Matrix::zeros(a.len(), b.len());
        self.write_cross(a, b, &mut cross)?;
        Ok(cross)
    }

    /// Writes [`Kernel::cross`] to a matrix of the same size.
    pub(crate) fn write_cross(&self, a: &Inputs, b: &Inputs, out: &mut Matrix) -> Result<()> {
        self.check(a)?;
        self.check(b)?;
        let (pairs, mut scratch) = (self.pairs(a, b), Scratch::default());
        for n in 0..out.columns() {
            let column = out.column_mut(n);
            column.fill(0.0);
            pairs.iter().for_each(|(term, pairs)| term.add_column(pairs, (0, n), column, &mut scratch));
        }
        Ok(())
    }

    /// Returns every term with its scaled points of `a` and `b`.
    fn pairs(&self, a: &Inputs, b: &Inputs) -> Vec<(&Term, Pairs)> {
        self.terms.iter().map(|term| (term, term.pairs(a, b))).collect()
    }

    /// Returns k(x, x) of every point. O(Nd).
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

    /// Returns the learned parameters. Each term has its variance first, then its reciprocity if that is between 0 and
    /// 1, then the parameters of every correlation: untied length-scales, and the parameters of the shape.
    ///
    /// The values are logarithms. For a reciprocity they are log-odds.
    pub fn parameter_values(&self) -> Vec<f64> {
        self.terms.iter().flat_map(Term::parameter_values).collect()
    }

    /// Returns the kind of each entry of [`Kernel::parameter_values`].
    pub fn parameters(&self) -> impl Iterator<Item = Parameter> {
        self.terms.iter().flat_map(Term::parameters)
    }

    /// Returns the kernel with other parameters, in the order of [`Kernel::parameter_values`].
    ///
    /// # Errors
    /// [`Error::SizeMismatch`] if the number of parameters differs. [`Error::OutOfRange`] or [`Error::NotFinite`] if a
    /// variance or length-scale leaves the floating-point range.
    pub fn with_parameters(&self, parameters: &[f64]) -> Result<Self> {
        same_size("parameters of a kernel", self.parameter_count(), parameters.len())?;
        let terms = self.parts().map(|(term, part)| term.with_parameters(&parameters[part]));
        Ok(Self { terms: terms.collect::<Result<_>>()? })
    }

    /// Returns whether the two kernels differ in learned parameters only.
    pub(crate) fn has_structure_of(&self, other: &Kernel) -> bool {
        let mut pairs = self.terms.iter().zip(&other.terms);
        self.terms.len() == other.terms.len() && pairs.all(|(own, other)| own.has_structure_of(other))
    }

    /// Returns the number of parameters.
    pub(crate) fn parameter_count(&self) -> usize {
        self.terms.iter().map(Term::parameter_count).sum()
    }

    /// Returns every term with the range of its parameters.
    fn parts(&self) -> impl Iterator<Item = (&Term, Range<usize>)> {
        self.terms.iter().scan(0, |first, term| {
            let part = *first..*first + term.parameter_count();
            *first = part.end;
            Some((term, part))
        })
    }

    /// Returns Σ_ij W_ij ∂k(x_i, x_j)/∂(parameters) for a symmetric W, N×N. Only its lower triangle is read.
    /// O(N²d).
    pub(crate) fn gram_gradient(&self, inputs: &Inputs, weights: &Matrix) -> Vec<f64> {
        let pairs = self.pairs(inputs, inputs);
        let panels = stretches(0..inputs.len(), PANEL).collect();
        let mut gradient = vec![0.0; self.parameter_count()];
        for of_panel in on_parts(panels, |panel| self.columns_gradient(&pairs, panel, |n| n, weights)) {
            add_scaled(2.0, &of_panel, &mut gradient);
        }
        add_scaled(-1.0, &self.diagonal_gradient(inputs, &weights.diagonal()), &mut gradient);
        gradient
    }

    /// Returns Σ_ij W_ij ∂k(a_i, b_j)/∂(parameters), W of size N_a×N_b. O(N_a N_b d).
    pub(crate) fn cross_gradient(&self, a: &Inputs, b: &Inputs, weights: &Matrix) -> Vec<f64> {
        self.columns_gradient(&self.pairs(a, b), 0..b.len(), |_| 0, weights)
    }

    /// Returns the sum over some columns only, each from row `first_row(column)` on.
    fn columns_gradient(
        &self,
        pairs: &[(&Term, Pairs)],
        columns: Range<usize>,
        first_row: impl Fn(usize) -> usize,
        weights: &Matrix,
    ) -> Vec<f64> {
        let mut sums: Vec<Vec<Slopes>> = self.terms.iter().map(Term::slopes).collect();
        let mut scratch = Scratch::default();
        for n in columns {
            let first = first_row(n);
            for ((term, pairs), sums) in pairs.iter().zip(&mut sums) {
                term.add_column_slopes(pairs, (first, n), &weights.column(n)[first..], sums, &mut scratch);
            }
        }
        let mut gradient = vec![0.0; self.parameter_count()];
        for ((term, part), sums) in self.parts().zip(&sums) {
            term.add_gradient(sums, &mut gradient[part]);
        }
        gradient
    }

    /// Returns Σ_n w_n ∂k(x_n, x_n)/∂(parameters). O(Nd).
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
