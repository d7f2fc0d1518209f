//! Memory of a request to stop.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::error::{Error, Result};
use crate::monitor::{Monitor, Progress};

/// Remembers a request to stop: later progress is not reported to the callback. Other threads may have begun a call.
pub(super) struct Latch<'a> {
    monitor: Monitor<'a>,
    is_stopped: AtomicBool,
}

impl<'a> Latch<'a> {
    pub(super) fn new(monitor: Monitor<'a>) -> Self {
        Self { monitor, is_stopped: AtomicBool::new(false) }
    }

    /// Reports progress to the callback, unless the callback has asked to stop.
    pub(super) fn report(&self, progress: Progress) -> ControlFlow<()> {
        if self.check().and_then(|()| self.monitor.report(progress)).is_ok() {
            return ControlFlow::Continue(());
        }
        self.is_stopped.store(true, Ordering::Relaxed);
        ControlFlow::Break(())
    }

    /// Returns [`Error::Stopped`] if the callback has asked to stop.
    pub(super) fn check(&self) -> Result<()> {
        if self.is_stopped.load(Ordering::Relaxed) { Err(Error::Stopped) } else { Ok(()) }
    }
}
