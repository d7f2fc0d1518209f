//! Gibbs sampling.

use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::border::{Count, Numbers, Outcomes, Points, check_memory, generator, long_work, report_step, watched};
use crate::posterior::observations;
use crate::prior::Prior;

/// Draws the latent function and ω at the events from their exact posterior. A sweep costs O(N³/3).
///
/// The result has the layout of ArviZ: `arviz.from_dict({"posterior": draws})` of ArviZ 1 accepts it, and
/// `arviz.from_dict(posterior=draws)` of earlier versions.
///
/// Parameters
/// ----------
/// prior : Prior
/// x : array of shape (N, d)
/// y : array of shape (N,)
///     Outcomes, 0 or 1.
/// draws : int
///     Number of draws that are kept of each chain.
/// seed : int
///     Equal seeds give equal draws. Each chain has a random stream of its own.
/// chains : int, optional
/// warm_up : int, optional
///     Number of sweeps before the first draw.
/// weights : array of shape (N,), optional
///     Whole numbers up to a million.
/// progress : callable, optional
///     Receives a dictionary with the number of sweeps, `"iterations"`, about twice a second, from two seconds on.
///
/// Returns
/// -------
/// dict
///     `"f"` and `"omega"`, each an array of shape (chains, draws, N).
///
/// Examples
/// --------
///     >>> import dgpc
///     >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, dimension=1))
///     >>> draws = dgpc.gibbs(prior, [[0.0], [1.0]], [1, 0], 50, seed=1, chains=2)
///     >>> draws["f"].shape
///     (2, 50, 2)
#[pyfunction]
#[pyo3(signature = (prior, x, y, draws, *, seed, chains=Count(1), warm_up=Count(100), weights=None,
                    progress=None),
       text_signature = "(prior, x, y, draws, *, seed, chains=1, warm_up=100, weights=None, progress=None)")]
#[expect(clippy::too_many_arguments)]
pub fn gibbs<'py>(
    py: Python<'py>,
    prior: &Prior,
    x: Points,
    y: Outcomes,
    draws: Count,
    seed: Count,
    chains: Count,
    warm_up: Count,
    weights: Option<Numbers>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let events = observations(x, y, weights)?;
    let (Count(draws), Count(chains), Count(warm_up), size) = (draws, chains, warm_up, events.len());
    let sweeps = warm_up.checked_add(draws).ok_or_else(|| PyValueError::new_err("too many sweeps"))?;
    check_memory(&[5, size, size])?;
    check_memory(&[2, chains, draws, size])?;
    let prior = prior.0.clone();
    let (latent, omega) = watched(py, progress.as_ref(), move |monitor| {
        let (mut latent, mut omega) = (Vec::new(), Vec::new());
        for chain in 0..chains {
            let mut sampler = dgpc::Gibbs::new(&prior, events.clone())?;
            let mut generator = generator(seed, chain);
            for sweep in 0..sweeps {
                sampler.sweep(&mut generator)?;
                if sweep >= warm_up {
                    latent.extend_from_slice(sampler.latent());
                    omega.extend_from_slice(sampler.omega());
                }
                report_step(monitor, chain * sweeps + sweep + 1)?;
            }
        }
        Ok((latent, omega))
    })?;
    let shaped = |values| -> PyResult<Bound<'py, PyArray3<f64>>> {
        PyArray1::from_vec(py, values).reshape([chains, draws, size])
    };
    let result = PyDict::new(py);
    result.set_item("f", shaped(latent)?)?;
    result.set_item("omega", shaped(omega)?)?;
    Ok(result)
}

/// Returns the number of independent draws that would estimate the mean as well as these draws of one chain do.
///
/// Parameters
/// ----------
/// draws : array of shape (draws,)
///
/// Examples
/// --------
///     >>> import dgpc, numpy as np
///     >>> dgpc.effective_sample_size(np.repeat([0.3, -1.2, 0.8, 0.1, -0.4, 1.5, -0.9, 0.6], 4)) < 20
///     True
#[pyfunction]
pub fn effective_sample_size(py: Python<'_>, draws: Numbers) -> PyResult<f64> {
    long_work(py, move || Ok(dgpc::effective_sample_size(&draws.0)))
}
