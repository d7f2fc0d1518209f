//! Candidates for inducing points.

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::border::{Count, Points, Share, Whole, check_memory, generator, long_work};
use crate::posterior::Posterior;
use crate::prior::AnyKernel;

/// Chosen candidates. The methods of `Candidates` return it.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> kernel = dgpc.Term("squared-exponential", 1.0, dimension=1)
///     >>> selection = dgpc.Candidates(kernel, [[0.0], [9.0]]).minimise_trace(2)
///     >>> selection.indices, abs(selection.trace) < 1e-9
///     (array([0, 1]), True)
#[pyclass(frozen, module = "dgpc")]
pub struct Selection(dgpc::Selection);

#[pymethods]
impl Selection {
    /// Indices of the chosen candidates, in the order of choice. There are fewer than requested if candidates coincide.
    #[getter]
    fn indices<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.0.indices.iter().map(|&index| index as i64))
    }

    /// The prior variance at all candidates that the chosen points leave unexplained, summed.
    #[getter]
    fn trace(&self) -> f64 {
        self.0.trace
    }

    fn __len__(&self) -> usize {
        self.0.indices.len()
    }

    fn __repr__(&self) -> String {
        format!("Selection of {:?} with trace {:.6}", self.0.indices, self.0.trace)
    }
}

/// N candidates for inducing points, with their covariance given the points that are known. N² memory.
///
/// Every choice uses the trace: the prior variance at the candidates that the chosen points leave unexplained.
///
/// Parameters
/// ----------
/// kernel : Kernel, Term or Prior
/// x : array of shape (N, d)
///     The candidates.
/// known : array of shape (M, d), optional
///     Points at which the latent function counts as known.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> kernel = dgpc.Term("squared-exponential", 1.0, dimension=1)
///     >>> candidates = dgpc.Candidates(kernel, [[0.0], [0.1], [5.0], [5.1], [5.2]])
///     >>> candidates.minimise_trace(2).indices
///     array([1, 3])
#[pyclass(frozen, module = "dgpc")]
pub struct Candidates(dgpc::Candidates);

#[pymethods]
impl Candidates {
    #[new]
    #[pyo3(signature = (kernel, x, known=None))]
    fn new(py: Python<'_>, kernel: AnyKernel, x: Points, known: Option<Points>) -> PyResult<Self> {
        check_memory(&[2, x.0.len(), x.0.len()])?;
        long_work(py, move || match known {
            Some(known) => dgpc::Candidates::given(&kernel.0, &x.0, &known.0),
            None => dgpc::Candidates::new(&kernel.0, &x.0),
        })
        .map(Self)
    }

    /// Returns candidates for the residual of the posterior `own` beyond the posterior `public`.
    ///
    /// A choice reduces the variance of `public` there to that of `own`.
    #[staticmethod]
    fn for_residual(py: Python<'_>, public: Py<Posterior>, own: Py<Posterior>, x: Points) -> PyResult<Self> {
        check_memory(&[x.0.len(), x.0.len() + public.get().posterior.len()])?;
        long_work(py, move || {
            dgpc::Candidates::for_residual(&public.get().posterior, &own.get().posterior, &x.0).map(Self)
        })
    }

    /// Returns the points with the smallest trace, the paper's good points.
    ///
    /// The choice is exact for one and for two points. More points are chosen greedily and then exchanged. O(N³).
    fn minimise_trace(slf: Py<Self>, py: Python<'_>, count: Count) -> PyResult<Selection> {
        long_work(py, move || Ok(Selection(slf.get().0.minimise_trace(count.0))))
    }

    /// Returns the points with the largest trace, the paper's bad points.
    fn maximise_trace(slf: Py<Self>, py: Python<'_>, count: Count) -> PyResult<Selection> {
        long_work(py, move || Ok(Selection(slf.get().0.maximise_trace(count.0))))
    }

    /// Returns the greedy choice. The first points are the greedy choice of fewer points.
    fn greedy(slf: Py<Self>, py: Python<'_>, count: Count) -> PyResult<Selection> {
        long_work(py, move || Ok(Selection(slf.get().0.greedy(count.0))))
    }

    /// Returns distinct candidates, drawn uniformly. Equal seeds give equal choices.
    #[pyo3(signature = (count, *, seed))]
    fn random(slf: Py<Self>, py: Python<'_>, count: Count, seed: Count) -> PyResult<Selection> {
        long_work(py, move || Ok(Selection(slf.get().0.random(count.0, &mut generator(seed, 0)))))
    }

    /// Returns the indices of candidates that keep at least this share of their prior variance given those before.
    #[pyo3(signature = (share_min=Share(dgpc::DISTINCT_SHARE)), text_signature = "($self, share_min=1e-4)")]
    fn distinct(slf: Py<Self>, py: Python<'_>, share_min: Share) -> PyResult<Bound<'_, PyArray1<i64>>> {
        let kept = long_work(py, move || Ok(slf.get().0.distinct(share_min.0)))?;
        Ok(PyArray1::from_iter(py, kept.into_iter().map(|index| index as i64)))
    }

    /// Returns the candidates given the latent function at those with the indices.
    fn condition_on(slf: Py<Self>, py: Python<'_>, indices: Whole) -> PyResult<Self> {
        let size = slf.get().0.len();
        let chosen = crate::border::indices(indices, size)?;
        check_memory(&[size, size])?;
        long_work(py, move || {
            let mut candidates = slf.get().0.clone();
            candidates.condition_on(&chosen);
            Ok(Self(candidates))
        })
    }

    /// The trace before any choice.
    #[getter]
    fn trace(&self) -> f64 {
        self.0.trace()
    }

    /// The jitter on the diagonal of the covariance at the known points, ordinarily 0.
    #[getter]
    fn jitter(&self) -> f64 {
        self.0.jitter()
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        format!("{} candidates", self.0.len())
    }
}

/// Number of candidates for each inducing point of a greedy choice among many inputs.
const CANDIDATES_EACH: usize = 4;

/// Returns `count` of the inputs, chosen greedily among four times as many that are spread over all of them.
pub fn greedy(kernel: &dgpc::Kernel, x: &dgpc::Inputs, count: usize) -> dgpc::Result<dgpc::Inputs> {
    let candidates = x.select(&dgpc::spread_out(x.len(), count.saturating_mul(CANDIDATES_EACH)));
    let chosen = dgpc::Candidates::new(kernel, &candidates)?.greedy(count);
    Ok(candidates.select(&chosen.indices))
}

/// Chooses inputs, each with the largest variance given those before it. O(N·count²) time, N·count memory.
///
/// Parameters
/// ----------
/// kernel : Kernel, Term or Prior
/// x : array of shape (N, d)
/// count : int
///
/// Returns
/// -------
/// Selection
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> kernel = dgpc.Term("squared-exponential", 1.0, dimension=1)
///     >>> len(dgpc.greedy_by_variance(kernel, [[0.0], [0.1], [5.0]], 2))
///     2
#[pyfunction]
pub fn greedy_by_variance(py: Python<'_>, kernel: AnyKernel, x: Points, count: Count) -> PyResult<Selection> {
    check_memory(&[x.0.len(), count.0.min(x.0.len())])?;
    long_work(py, move || dgpc::greedy_by_variance(&kernel.0, &x.0, count.0.min(x.0.len())).map(Selection))
}

/// Chooses inputs greedily for the smallest trace over at most `judges_max` inputs. O(N·judges·count) time.
///
/// Parameters
/// ----------
/// kernel : Kernel, Term or Prior
/// x : array of shape (N, d)
/// count : int
/// judges_max : int, optional
///
/// Returns
/// -------
/// Selection
///     Its trace is over all inputs.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> kernel = dgpc.Term("squared-exponential", 1.0, dimension=1)
///     >>> dgpc.greedy_judged(kernel, [[0.0], [0.1], [0.2], [5.0]], 1).indices
///     array([1])
#[pyfunction]
#[pyo3(signature = (kernel, x, count, judges_max=Count(1000)), text_signature = "(kernel, x, count, judges_max=1000)")]
pub fn greedy_judged(
    py: Python<'_>,
    kernel: AnyKernel,
    x: Points,
    count: Count,
    judges_max: Count,
) -> PyResult<Selection> {
    check_memory(&[x.0.len(), judges_max.0.min(x.0.len()).saturating_add(count.0.min(x.0.len()))])?;
    long_work(py, move || dgpc::greedy_judged(&kernel.0, &x.0, count.0.min(x.0.len()), judges_max.0).map(Selection))
}
