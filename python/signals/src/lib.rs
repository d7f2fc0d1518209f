//! Long computations that signals of the Python process stop.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use pyo3::prelude::*;

/// Time between two checks.
pub const CHECK_AFTER: Duration = Duration::from_millis(50);

/// Time that a computation has to stop before it is left alone.
const LEAVE_AFTER: Duration = Duration::from_millis(500);

/// The result of a computation, or the text of a panic, which is a defect of the computation.
pub type Ended<T> = Result<T, String>;

/// Runs a computation on a thread of its own. This thread waits without the interpreter's lock, and calls `check` in
/// between.
///
/// After an exception of `check`, such as `KeyboardInterrupt`, `stop` is called once. The exception is returned after
/// the computation ended.
pub fn watch<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce() -> T + Send,
    check: impl FnMut() -> PyResult<()>,
    stop: impl Fn(),
) -> PyResult<Ended<T>> {
    let (ended, end) = channel();
    std::thread::scope(|scope| {
        std::thread::Builder::new().spawn_scoped(scope, move || run(compute, ended))?;
        wait(py, end, check, stop, Duration::MAX)
    })
}

/// Runs a computation without effects as [`watch`] does, but returns the exception half a second after `stop` at the
/// latest. A computation that has not ended by then continues on its thread, and its result is dropped.
pub fn watch_or_leave<T: Send + 'static>(
    py: Python<'_>,
    compute: impl FnOnce() -> T + Send + 'static,
    check: impl FnMut() -> PyResult<()>,
    stop: impl Fn(),
) -> PyResult<Ended<T>> {
    let (ended, end) = channel();
    std::thread::Builder::new().spawn(move || run(compute, ended))?;
    wait(py, end, check, stop, LEAVE_AFTER)
}

fn run<T>(compute: impl FnOnce() -> T, ended: Sender<Ended<T>>) {
    let result = catch_unwind(AssertUnwindSafe(compute)).map_err(|panic| text_of(&*panic));
    // Without a receiver, the computation was left alone.
    let _ = ended.send(result);
}

/// Waits for the end of a computation, and after an exception of `check` not longer than `patience`.
fn wait<T: Send>(
    py: Python<'_>,
    end: Receiver<Ended<T>>,
    mut check: impl FnMut() -> PyResult<()>,
    stop: impl Fn(),
    patience: Duration,
) -> PyResult<Ended<T>> {
    let mut next = move || match end.recv_timeout(CHECK_AFTER) {
        Ok(ended) => Some(ended),
        Err(RecvTimeoutError::Timeout) => None,
        Err(RecvTimeoutError::Disconnected) => Some(Err("internal error: no result".to_owned())),
    };
    let exception = loop {
        if let Some(ended) = py.detach(&mut next) {
            return Ok(ended);
        }
        if let Err(exception) = check() {
            break exception;
        }
    };
    stop();
    let stopped = Instant::now();
    while py.detach(&mut next).is_none() && stopped.elapsed() < patience {}
    Err(exception)
}

/// Returns the text of a panic.
pub fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    format!("internal error: {}", text.unwrap_or_default())
}
