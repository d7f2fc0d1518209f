//! Long computations: without the interpreter's lock, and with Ctrl-C.

use pingmap::Interrupt;
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

use crate::errors::Error;

/// Runs a computation on a thread of its own. This thread waits without the interpreter's lock, and checks for signals.
///
/// If a signal raises an exception, such as `KeyboardInterrupt`, the computation is requested to stop. The exception is
/// returned after the computation ended.
pub fn work<T: Send>(py: Python<'_>, compute: impl FnOnce(&Interrupt) -> T + Send) -> PyResult<T> {
    let interrupt = Interrupt::default();
    let attached = interrupt.clone();
    // A pool of one thread instead of the global pool, whose threads do not exist in a forked process.
    let pool = ThreadPoolBuilder::new().num_threads(1).start_handler(move |_| attached.attach()).build();
    let pool = pool.map_err(|error| Error::new_err(error.to_string()))?;
    let compute = || pool.install(|| compute(&interrupt));
    signals::watch(py, compute, || py.check_signals(), || interrupt.request())?.map_err(Error::new_err)
}
