//! Long computations: without the interpreter's lock, and with Ctrl-C.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use pingmap::Interrupt;
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;

use crate::errors::{Error, panicked};

/// Time between two checks for signals.
const CHECK_AFTER: Duration = Duration::from_millis(50);

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
    let (sender, mut receiver) = channel();
    pool.in_place_scope(|scope| {
        let computed = &interrupt;
        scope.spawn(move |_| {
            let result = catch_unwind(AssertUnwindSafe(|| compute(computed)));
            // The receiver waits for it.
            let _ = sender.send(result);
        });
        let mut signal = None;
        loop {
            let receiver = &mut receiver;
            match (py.detach(move || receiver.recv_timeout(CHECK_AFTER)), &signal) {
                (Ok(result), None) => break result.map_err(panicked),
                (Err(RecvTimeoutError::Timeout), None) => {
                    signal = py.check_signals().inspect_err(|_| interrupt.request()).err();
                }
                (Err(RecvTimeoutError::Timeout), Some(_)) => {}
                (_, _) => break Err(signal.unwrap_or_else(|| Error::new_err("internal error: no result"))),
            }
        }
    })
}
