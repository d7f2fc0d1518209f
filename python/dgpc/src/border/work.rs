//! Long computations: without the interpreter's lock, after a fork, and with Ctrl-C.

use std::sync::{Arc, LazyLock, Mutex};
use std::time::{Duration, Instant};

use pyo3::exceptions::{PyMemoryError, PyRuntimeError};
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::arrays::Count;
use super::errors::failed;

/// Time between two checks for Ctrl-C.
const CHECK_AFTER: Duration = Duration::from_millis(50);

/// The process that loaded this module. The threads of rayon's global pool belong to it.
static LOADED_BY: LazyLock<u32> = LazyLock::new(std::process::id);

/// The pool of a forked process, and the identifier of that process.
static AFTER_FORK: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Remembers the process that loads this module.
pub fn remember_process() {
    LazyLock::force(&LOADED_BY);
}

/// Runs a computation without the interpreter's lock. Its error becomes an exception.
pub fn work<T: Send>(py: Python<'_>, compute: impl FnOnce() -> dgpc::Result<T> + Send) -> PyResult<T> {
    py.detach(|| on_live_threads(compute))?.map_err(failed)
}

/// Repeats a step `times` times without the interpreter's lock, and checks for Ctrl-C in between.
pub fn interruptible(
    py: Python<'_>,
    times: usize,
    mut step: impl FnMut(usize) -> dgpc::Result<()> + Send,
) -> PyResult<()> {
    let mut done = 0;
    while done < times {
        py.check_signals()?;
        let begin = Instant::now();
        work(py, || {
            while done < times && begin.elapsed() < CHECK_AFTER {
                step(done)?;
                done += 1;
            }
            Ok(())
        })?;
    }
    py.check_signals()
}

/// Runs `compute` where threads exist. A forked process does not have the threads of its parent, and would wait for
/// them for ever, so it gets a pool of its own.
fn on_live_threads<T: Send>(compute: impl FnOnce() -> T + Send) -> PyResult<T> {
    let process = std::process::id();
    if process == *LOADED_BY {
        return Ok(compute());
    }
    let pool = {
        let mut known = AFTER_FORK.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        match &*known {
            Some((of, pool)) if *of == process => pool.clone(),
            _ => {
                let pool = ThreadPoolBuilder::new().build();
                let pool = Arc::new(pool.map_err(|error| PyRuntimeError::new_err(error.to_string()))?);
                // The pool of a parent is never dropped, because its threads do not exist here.
                std::mem::forget(known.replace((process, pool.clone())));
                pool
            }
        }
    };
    Ok(pool.install(compute))
}

/// Checks that memory for a product of sizes, in numbers of eight bytes, can be reserved.
pub fn check_memory(sizes: &[usize]) -> PyResult<()> {
    let numbers = sizes.iter().try_fold(1_usize, |product, &size| product.checked_mul(size));
    let is_free = numbers.is_some_and(|numbers| Vec::<f64>::new().try_reserve_exact(numbers).is_ok());
    if is_free {
        return Ok(());
    }
    let product = sizes.iter().map(usize::to_string).collect::<Vec<_>>().join(" × ");
    Err(PyMemoryError::new_err(format!("not enough memory for {product} numbers of eight bytes")))
}

/// Returns the random number generator of a seed and a stream. Streams of one seed are independent.
pub fn generator(Count(seed): Count, stream: usize) -> ChaCha8Rng {
    let mut generator = ChaCha8Rng::seed_from_u64(seed as u64);
    generator.set_stream(stream as u64);
    generator
}
