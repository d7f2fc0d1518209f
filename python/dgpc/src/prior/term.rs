//! Terms of kernels.

use dgpc::{Reflection, Shape};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::kernel::{AnyKernel, Kernel};
use crate::border::{Count, Numbers, Whole, bad_input};

/// A factor of a kernel term: a shape of the distance over some columns.
///
/// `Term.correlations` returns the factors of a term.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> (correlation,) = dgpc.Term("matern52", [0.5, 2.0]).correlations
///     >>> correlation.length_scales
///     [0.5, 2.0]
#[pyclass(frozen, module = "dgpc")]
pub struct Correlation(dgpc::Correlation);

#[pymethods]
impl Correlation {
    /// The shape, with its parameter: `"matern52"` or `"rational-quadratic:1.5"`.
    #[getter]
    fn shape(&self) -> String {
        self.0.shape().to_string()
    }

    /// The columns of the inputs.
    #[getter]
    fn columns(&self) -> Vec<usize> {
        self.0.columns().to_vec()
    }

    /// One length-scale for every column.
    #[getter]
    fn length_scales(&self) -> Vec<f64> {
        self.0.length_scales().to_vec()
    }

    /// For every column, the number of its length-scale. Columns with equal numbers share a length-scale in learning.
    #[getter]
    fn ties(&self) -> Vec<usize> {
        self.0.ties().to_vec()
    }

    fn __repr__(&self) -> String {
        format!("{} over columns {:?} with length-scales {:?}", self.shape(), self.columns(), self.length_scales())
    }
}

/// A term of a kernel: a variance times a correlation over some columns.
///
/// Terms are added to kernels and multiplied by other terms.
///
/// Parameters
/// ----------
/// shape : str
///     `"squared-exponential"`, `"matern12"`, `"matern32"`, `"matern52"`, `"rational-quadratic"` or `"label"`. The
///     parameter α of a rational quadratic may follow a colon: `"rational-quadratic:1.5"`. Columns of a `"label"`
///     are equal or not, and have no length-scale.
/// length_scale : float or array of shape (d,), optional
///     One number is shared by all columns. An array has one length-scale for each column, and each is learned alone.
/// variance : float, optional
///     Variance of the latent function that this term contributes.
/// columns : array of int, optional
///     The columns that the term uses, counted from 0.
/// dimension : int, optional
///     The number of columns, in place of `columns`: the first `dimension` columns.
/// ties : array of int, optional
///     One number for each column. Columns with equal numbers share one length-scale.
///
/// Raises
/// ------
/// ValueError
///     If a number is outside its range, or if neither `columns` nor `dimension` nor an array of length-scales says
///     which columns to use.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> dgpc.Term("matern52", 0.8, variance=4.0, dimension=2)
///     4 * matern52 over columns [0, 1] with length-scales [0.8, 0.8]
///     >>> dgpc.Term("squared-exponential", [0.5, 2.0]) + dgpc.Term("label", columns=[2])
///     Kernel of 2 terms
#[pyclass(frozen, module = "dgpc")]
pub struct Term(pub dgpc::Term);

/// One length-scale for all columns, or one for each.
enum LengthScale {
    Shared(f64),
    Each(Numbers),
}

impl<'py> FromPyObject<'_, 'py> for LengthScale {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if object.len().is_ok() { object.extract().map(Self::Each) } else { object.extract().map(Self::Shared) }
    }
}

/// Returns the columns of a term.
fn chosen_columns(
    columns: Option<Whole>,
    dimension: Option<Count>,
    length_scale: &LengthScale,
) -> PyResult<Vec<usize>> {
    match (columns, dimension, length_scale) {
        (Some(Whole(columns)), None, _) => Ok(columns),
        (None, Some(Count(dimension)), _) if dimension <= dgpc::COLUMN_MAX => Ok((0..dimension).collect()),
        (None, Some(_), _) => Err(PyValueError::new_err("dimension must be at most 65535")),
        (None, None, LengthScale::Each(Numbers(each))) => Ok((0..each.len()).collect()),
        (Some(_), Some(_), _) => Err(PyValueError::new_err("give either columns or dimension, not both")),
        (None, None, LengthScale::Shared(_)) => {
            Err(PyValueError::new_err("give columns, dimension or one length-scale for every column"))
        }
    }
}

#[pymethods]
impl Term {
    #[new]
    #[pyo3(signature = (shape, length_scale=LengthScale::Shared(1.0), *, variance=1.0, columns=None, dimension=None,
                        ties=None),
           text_signature = "(shape, length_scale=1.0, *, variance=1.0, columns=None, dimension=None, ties=None)")]
    fn new(
        shape: &str,
        length_scale: LengthScale,
        variance: f64,
        columns: Option<Whole>,
        dimension: Option<Count>,
        ties: Option<Whole>,
    ) -> PyResult<Self> {
        let columns = chosen_columns(columns, dimension, &length_scale)?;
        let build = || {
            let shape: Shape = shape.parse()?;
            let mut correlation = match (shape, &length_scale) {
                (Shape::Label, _) => dgpc::Correlation::of_labels(&columns)?,
                (shape, LengthScale::Shared(shared)) => dgpc::Correlation::isotropic(shape, &columns, *shared)?,
                (shape, LengthScale::Each(Numbers(each))) => dgpc::Correlation::new(shape, &columns, each)?,
            };
            if let Some(Whole(ties)) = &ties {
                correlation = correlation.tied(ties)?;
            }
            dgpc::Term::of(variance, correlation)
        };
        build().map(Self).map_err(bad_input)
    }

    /// Returns the term as a reciprocal one: ½[k(x, x′) + c k(x, Rx′)], where R exchanges or negates columns.
    ///
    /// Parameters
    /// ----------
    /// swap : sequence of (int, int), optional
    ///     Pairs of columns that R exchanges.
    /// negate : array of int, optional
    ///     Columns whose sign R changes.
    /// reciprocity : float, optional
    ///     c, above 0 and at most 1. It is learned unless it is 1.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     If R exchanges columns of different length-scales, or columns outside the term.
    ///
    /// Examples
    /// --------
    ///     >>> import dgpc
    ///     >>> link = dgpc.Term("matern52", 300.0, dimension=4).reciprocal([(0, 2), (1, 3)])
    ///     >>> link.reciprocity
    ///     1.0
    #[pyo3(signature = (swap=vec![], negate=None, *, reciprocity=1.0),
           text_signature = "($self, swap=(), negate=None, *, reciprocity=1.0)")]
    fn reciprocal(&self, swap: Vec<(Count, Count)>, negate: Option<Whole>, reciprocity: f64) -> PyResult<Self> {
        let pairs: Vec<(usize, usize)> = swap.iter().map(|(a, b)| (a.0, b.0)).collect();
        let negated = negate.map(|Whole(columns)| columns).unwrap_or_default();
        let reflection = Reflection::swap(&pairs).and_then(|swap| swap.and_negate(&negated));
        let term = reflection.and_then(|reflection| self.0.clone().partly_reciprocal(reflection, reciprocity));
        term.map(Self).map_err(bad_input)
    }

    /// The variance of the term.
    #[getter]
    fn variance(&self) -> f64 {
        self.0.variance()
    }

    /// The factors of the term, at least one.
    #[getter]
    fn correlations(&self) -> Vec<Correlation> {
        self.0.correlations().iter().cloned().map(Correlation).collect()
    }

    /// The reciprocity c: 1 for a reciprocal term, 0 for a term without reflection.
    #[getter]
    fn reciprocity(&self) -> f64 {
        self.0.reciprocity()
    }

    fn __add__(&self, other: AnyKernel) -> PyResult<Kernel> {
        Kernel::sum([self.0.clone()].iter().chain(other.0.terms()))
    }

    /// Multiplies two terms. The variances are multiplied, too. A reciprocal term must come first.
    fn __mul__(&self, other: Factor<'_>) -> PyResult<Self> {
        let product = match other {
            Factor::Number(factor) => self.0.with_variance(self.0.variance() * factor),
            Factor::Term(other) if other.get().0.reflection().is_some() => {
                return Err(PyValueError::new_err("the second factor of a product cannot be reciprocal"));
            }
            Factor::Term(other) => {
                let other = &other.get().0;
                let product = self.0.with_variance(self.0.variance() * other.variance());
                let mut factors = other.correlations().iter().cloned();
                product.and_then(|product| factors.try_fold(product, dgpc::Term::times))
            }
        };
        product.map(Self).map_err(bad_input)
    }

    fn __rmul__(&self, factor: f64) -> PyResult<Self> {
        self.0.with_variance(self.0.variance() * factor).map(Self).map_err(bad_input)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let factors: Vec<String> = self.correlations().iter().map(Correlation::__repr__).collect();
        let reciprocal = if self.0.reflection().is_some() { ", reciprocal" } else { "" };
        format!("{} * {}{reciprocal}", self.0.variance(), factors.join(" * "))
    }
}

/// The second factor of a product.
#[derive(FromPyObject)]
enum Factor<'py> {
    Term(Bound<'py, Term>),
    Number(f64),
}
