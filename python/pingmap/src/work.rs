//! Long computations: without the interpreter's lock, with Ctrl-C, and with warnings.

use pingmap::{Interrupt, Warnings};
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

use crate::errors::Error;

/// Runs a computation on a thread of its own. This thread waits without the interpreter's lock, and checks for signals.
///
/// If a signal raises an exception, such as `KeyboardInterrupt`, the computation is requested to stop. The exception is
/// returned after the computation ended.
pub fn work<T: Send>(py: Python<'_>, compute: impl FnOnce(&Interrupt) -> T + Send) -> PyResult<T> {
    on_own_thread(py, compute, || py.check_signals())
}

/// Runs a computation as [`work`] does, and calls `warn` with each of its warnings. An exception of `warn` counts as
/// one of a signal.
pub fn work_and_warn<T: Send>(
    py: Python<'_>,
    warn: &Bound<'_, PyAny>,
    compute: impl FnOnce(&Interrupt) -> T + Send,
) -> PyResult<T> {
    let warnings = Warnings::default();
    let of_thread = warnings.clone();
    let report = || warnings.take().into_iter().try_for_each(|text| warn.call1((text,)).map(drop));
    let attached = |interrupt: &Interrupt| {
        of_thread.attach();
        compute(interrupt)
    };
    let result = on_own_thread(py, attached, || py.check_signals().and_then(|()| report()))?;
    report().map(|()| result)
}

fn on_own_thread<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce(&Interrupt) -> T + Send,
    check: impl FnMut() -> PyResult<()>,
) -> PyResult<T> {
    let interrupt = Interrupt::default();
    let attached = interrupt.clone();
    // A pool of one thread instead of the global pool, whose threads do not exist in a forked process.
    let pool = ThreadPoolBuilder::new().num_threads(1).start_handler(move |_| attached.attach()).build();
    let pool = pool.map_err(|error| Error::new_err(error.to_string()))?;
    let compute = || pool.install(|| compute(&interrupt));
    signals::watch(py, compute, check, || interrupt.request())?.map_err(Error::new_err)
}
