//! Long computations: without the interpreter's lock, after a fork, and with Ctrl-C.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, MutexGuard};
use std::time::{Duration, Instant};

use dgpc::{Inputs, Latent, Progress};
use pyo3::exceptions::{PyMemoryError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::{ThreadPool, ThreadPoolBuilder};
use signals::{CHECK_AFTER, text_of};

use super::arrays::Count;
use super::errors::{Error, failed};

/// Time after which progress is reported, and the time between two reports.
const PROGRESS_AFTER: Duration = Duration::from_secs(2);
const PROGRESS_EVERY: Duration = Duration::from_millis(500);

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

/// Runs a long computation as [`work`] does, on a thread of its own. After Ctrl-C, the caller continues within half a
/// second. The computation then continues alone, and its result is dropped.
pub fn long_work<T: Send + 'static>(
    py: Python<'_>,
    compute: impl FnOnce() -> dgpc::Result<T> + Send + 'static,
) -> PyResult<T> {
    watched(py, None, |_| compute())
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

/// Multiply-adds of a prediction without a thread of its own, and of a part of a longer prediction.
const PREDICTION_WORK: usize = 1 << 32;

/// Points in the smallest part. `dgpc` predicts in blocks of such lengths, so the parts do not change any bit.
const PREDICTION_POINTS: usize = 256;

/// Predicts at points without the interpreter's lock, and stops after Ctrl-C. A point costs `work_each` multiply-adds.
pub fn predicted(
    py: Python<'_>,
    inputs: Inputs,
    work_each: usize,
    latent: impl Fn(&Inputs) -> dgpc::Result<Latent> + Send + 'static,
) -> PyResult<Latent> {
    if inputs.len().saturating_mul(work_each) <= PREDICTION_WORK {
        return work(py, move || latent(&inputs));
    }
    let blocks = PREDICTION_WORK / work_each.saturating_mul(PREDICTION_POINTS).max(1);
    let points = blocks.max(1) * PREDICTION_POINTS;
    watched(py, None, move |monitor| {
        let mut all = Latent { mean: Vec::new(), variance: Vec::new() };
        for first in (0..inputs.len()).step_by(points) {
            let found = latent(&inputs.slice(first..inputs.len().min(first + points)))?;
            all.mean.extend(found.mean);
            all.variance.extend(found.variance);
            report_step(monitor, first)?;
        }
        Ok(all)
    })
}

/// A callback that receives the progress of a computation, and may stop it.
pub type Callback<'a> = dyn Fn(Progress) -> ControlFlow<()> + Sync + 'a;

/// Reports the number of steps of a computation that has no other progress. Returns an error if it must stop.
pub fn report_step(monitor: &Callback<'_>, iterations: usize) -> dgpc::Result<()> {
    match monitor(Progress::Iteration { iterations, change: f64::NAN }) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(dgpc::Error::Stopped),
    }
}

/// Runs a computation on a thread of its own. Meanwhile the calling thread checks for Ctrl-C, and reports progress.
///
/// `compute` receives the callback for its options. After Ctrl-C, or after an exception of `progress`, the computation
/// ends with its next iteration. The caller continues half a second later even if the iteration takes longer.
pub fn watched<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    compute: impl FnOnce(&Callback<'_>) -> dgpc::Result<T> + Send + 'static,
) -> PyResult<T> {
    let state = Arc::new((AtomicBool::new(false), Mutex::new(Latest::default())));
    let of_thread = state.clone();
    let compute = move || {
        let (is_stopped, latest) = &*of_thread;
        compute(&|progress| {
            locked(latest).record(progress);
            if is_stopped.load(Ordering::Relaxed) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
    };
    let (is_stopped, latest) = &*state;
    let mut next = Instant::now() + PROGRESS_AFTER;
    let check = || {
        py.check_signals()?;
        match progress {
            Some(callable) if Instant::now() > next => {
                next = Instant::now() + PROGRESS_EVERY;
                // The lock is free while Python runs, because the computation takes it in each iteration.
                let seen = locked(latest).clone();
                seen.report_to(py, callable)
            }
            _ => Ok(()),
        }
    };
    let stop = || is_stopped.store(true, Ordering::Relaxed);
    on_own_thread(py, || on_live_threads(compute), check, stop)
}

/// Runs a computation on a thread of its own, and leaves it alone half a second after `stop`.
fn on_own_thread<T: Send + 'static>(
    py: Python<'_>,
    compute: impl FnOnce() -> PyResult<dgpc::Result<T>> + Send + 'static,
    check: impl FnMut() -> PyResult<()>,
    stop: impl Fn(),
) -> PyResult<T> {
    signals::watch_or_leave(py, compute, check, stop)?.map_err(Error::new_err)??.map_err(failed)
}

/// The latest progress of a computation.
#[derive(Clone, Default)]
struct Latest {
    iterations: usize,
    change: Option<f64>,
    evaluations: usize,
    objective: Option<f64>,
}

impl Latest {
    fn record(&mut self, progress: Progress) {
        match progress {
            // A step of `report_step` has no change.
            Progress::Iteration { iterations, change } => {
                self.iterations = iterations;
                self.change = Some(change).filter(|change| !change.is_nan());
            }
            Progress::Evaluation { objective } => {
                self.evaluations += 1;
                self.objective = Some(objective);
            }
            _ => {}
        }
    }

    /// Calls a callable of Python with the progress as a dictionary.
    fn report_to(self, py: Python<'_>, callable: &Py<PyAny>) -> PyResult<()> {
        let content = PyDict::new(py);
        content.set_item("iterations", self.iterations)?;
        content.set_item("change", self.change)?;
        content.set_item("evaluations", self.evaluations)?;
        content.set_item("objective", self.objective)?;
        callable.call1(py, (content,)).map(drop)
    }
}

/// Computes as [`long_work`] does with an object that threads share. After Ctrl-C, the object stays locked until the
/// computation ends.
///
/// The object is locked before the computation enters a pool, because a thread of a pool may begin another computation
/// while it waits.
pub fn work_on<S: Send + 'static, T: Send + 'static>(
    py: Python<'_>,
    shared: &Arc<Mutex<S>>,
    compute: impl FnOnce(&mut S) -> dgpc::Result<T> + Send + 'static,
) -> PyResult<T> {
    let shared = shared.clone();
    let compute = move || {
        let mut guard = locked(&shared);
        let object = &mut *guard;
        on_live_threads(|| compute(object))
    };
    on_own_thread(py, compute, || py.check_signals(), || ())
}

/// Locks an object that threads share. If another thread panicked while it held the lock, this thread continues.
pub fn locked<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

/// Runs `compute` where threads exist. A forked process does not have the threads of its parent, and would wait for
/// them for ever, so it gets a pool of its own. A panic, which is a defect of the computation, becomes an exception.
fn on_live_threads<T: Send>(compute: impl FnOnce() -> T + Send) -> PyResult<T> {
    let compute = || catch_unwind(AssertUnwindSafe(compute)).map_err(|panic| Error::new_err(text_of(&*panic)));
    let process = std::process::id();
    if process == *LOADED_BY {
        return compute();
    }
    let pool = {
        let mut known = locked(&AFTER_FORK);
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
    pool.install(compute)
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
