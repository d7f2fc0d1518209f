//! Requests to stop: SIGTERM, SIGINT, or the program around the process.

use std::cell::Cell;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Time for a host to read the last messages after a request to stop.
const GRACE: Duration = Duration::from_secs(2);

/// A request to stop, which the owner checks.
pub(crate) struct StopRequest<'a> {
    signalled: Arc<AtomicBool>,
    is_stopped_by_caller: &'a dyn Fn() -> bool,
    noticed: Cell<Option<Instant>>,
}

impl<'a> StopRequest<'a> {
    /// Catches the signals from now on. A second signal ends the process at once.
    pub(crate) fn new(is_stopped_by_caller: &'a dyn Fn() -> bool) -> io::Result<Self> {
        let signalled = Arc::new(AtomicBool::new(false));
        for signal in [SIGTERM, SIGINT] {
            // The order matters: the first signal finds the flag unset.
            flag::register_conditional_shutdown(signal, 1, signalled.clone())?;
            flag::register(signal, signalled.clone())?;
        }
        Ok(Self { signalled, is_stopped_by_caller, noticed: Cell::new(None) })
    }

    /// Returns whether the process is requested to stop.
    pub(crate) fn is_made(&self) -> bool {
        let is_made = self.signalled.load(Ordering::Relaxed) || (self.is_stopped_by_caller)();
        if is_made && self.noticed.get().is_none() {
            self.noticed.set(Some(Instant::now()));
        }
        is_made
    }

    /// Returns whether the time for the last messages is over.
    pub(crate) fn is_overdue(&self) -> bool {
        self.is_made() && self.noticed.get().is_some_and(|noticed| noticed.elapsed() > GRACE)
    }
}
