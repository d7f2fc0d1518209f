//! Locality regions: sets of events for a summary.

use numpy::PyArray1;
use pyo3::prelude::*;

use crate::border::{Count, Numbers, Points, Vector, long_work, vector, work};

/// The inputs within a radius of a centre. `region_around` and `busiest_region` return it.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> region = dgpc.region_around([[0.0], [3.0], [0.5]], [0.0], 1.0)
///     >>> region
///     Region of 2 inputs within 1 of [0.0]
#[pyclass(frozen, module = "dgpc")]
pub struct LocalityRegion(dgpc::LocalityRegion);

#[pymethods]
impl LocalityRegion {
    /// The centre, shape (d,).
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Vector<'py> {
        vector(py, self.0.centre.as_slice())
    }

    /// The radius, in the unit of the inputs.
    #[getter]
    fn radius(&self) -> f64 {
        self.0.radius
    }

    /// Indices of the inputs inside, ascending.
    #[getter]
    fn members<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.0.members.iter().map(|&index| index as i64))
    }

    fn __repr__(&self) -> String {
        format!("Region of {} inputs within {} of {:?}", self.0.members.len(), self.0.radius, self.0.centre)
    }
}

/// Returns the region around a centre.
///
/// Parameters
/// ----------
/// x : array of shape (N, d)
/// centre : array of shape (d,)
/// radius : float
///     In the unit of the inputs.
/// count_max : int, optional
///     Keeps only this number of inputs, those nearest to the centre.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> dgpc.region_around([[0.0], [3.0], [0.5]], [0.0], 1.0).members
///     array([0, 2])
#[pyfunction]
#[pyo3(signature = (x, centre, radius, *, count_max=None))]
pub fn region_around(
    py: Python<'_>,
    x: Points,
    centre: Numbers,
    radius: f64,
    count_max: Option<Count>,
) -> PyResult<LocalityRegion> {
    work(py, || {
        let mut region = dgpc::LocalityRegion::around(&x.0, &centre.0, radius)?;
        if let Some(Count(count)) = count_max {
            region.keep_nearest(&x.0, count);
        }
        Ok(LocalityRegion(region))
    })
}

/// Returns the region around the input with most inputs within the radius, or `None` if there are no inputs.
///
/// Of more than 1000 inputs, 1000 are tried as the centre. See `region_around` for the parameters.
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> dgpc.busiest_region([[0.0], [3.0], [3.5], [4.0]], 1.0).members
///     array([1, 2, 3])
#[pyfunction]
#[pyo3(signature = (x, radius, *, count_max=None))]
pub fn busiest_region(
    py: Python<'_>,
    x: Points,
    radius: f64,
    count_max: Option<Count>,
) -> PyResult<Option<LocalityRegion>> {
    long_work(py, move || {
        let mut region = dgpc::LocalityRegion::busiest(&x.0, radius)?;
        if let (Some(region), Some(Count(count))) = (&mut region, count_max) {
            region.keep_nearest(&x.0, count);
        }
        Ok(region.map(LocalityRegion))
    })
}
