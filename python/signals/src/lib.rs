//! Long computations that signals of the Python process stop.

use std::any::Any;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pyo3::prelude::*;

/// Time between two checks.
pub const CHECK_AFTER: Duration = Duration::from_millis(50);

/// Runs a computation on a thread of its own. This thread waits without the interpreter's lock, and calls `check` in
/// between.
///
/// After an exception of `check`, such as `KeyboardInterrupt`, `stop` is called once. The exception is returned after
/// the computation ended. The inner error is the text of a panic, which is a defect of the computation.
pub fn watch<T: Send>(
    py: Python<'_>,
    compute: impl FnOnce() -> T + Send,
    mut check: impl FnMut() -> PyResult<()>,
    stop: impl Fn(),
) -> PyResult<Result<T, String>> {
    let (running, end) = channel::<()>();
    let mut is_running = move || end.recv_timeout(CHECK_AFTER) == Err(RecvTimeoutError::Timeout);
    std::thread::scope(|scope| {
        let thread = scope.spawn(move || {
            // The end of the thread, also by a panic, closes the channel.
            let _running = running;
            compute()
        });
        let mut checked = Ok(());
        while py.detach(&mut is_running) {
            if checked.is_ok() {
                checked = check().inspect_err(|_| stop());
            }
        }
        let result = thread.join().map_err(|panic| text_of(&*panic));
        checked.map(|()| result)
    })
}

/// Returns the text of a panic.
pub fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    format!("internal error: {}", text.unwrap_or_default())
}
