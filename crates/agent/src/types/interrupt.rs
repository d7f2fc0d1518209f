//! The request to stop the computations of some threads.

use std::cell::RefCell;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use dgpc::{Error, Progress, Result};

thread_local! {
    static ATTACHED: RefCell<Interrupt> = RefCell::default();
}

/// A request to stop long computations.
///
/// A host attaches it to the threads that compute. After [`Interrupt::request`], fits, learning and predictions on
/// these threads end with [`dgpc::Error::Stopped`]. A thread without an attached interrupt is never stopped. Results do
/// not depend on it. Clones share one request.
///
/// ```
/// use pingmap_agent::Interrupt;
///
/// let interrupt = Interrupt::default();
/// interrupt.attach();
/// assert!(Interrupt::check().is_ok());
/// interrupt.request();
/// assert_eq!(Interrupt::check(), Err(dgpc::Error::Stopped));
/// ```
#[derive(Debug, Clone, Default)]
pub struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Requests the computations to stop.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns whether the computations are requested to stop.
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Attaches the interrupt to this thread, in place of an earlier one.
    pub fn attach(&self) {
        ATTACHED.set(self.clone());
    }

    /// Returns the interrupt of this thread.
    pub(crate) fn attached() -> Self {
        ATTACHED.with_borrow(Clone::clone)
    }

    /// Checks that this thread is not requested to stop.
    ///
    /// # Errors
    /// [`dgpc::Error::Stopped`] after a request.
    pub fn check() -> Result<()> {
        if Self::attached().is_requested() { Err(Error::Stopped) } else { Ok(()) }
    }

    /// Stops a fit or a search after a request.
    pub(crate) fn monitor(&self, _: Progress) -> ControlFlow<()> {
        if self.is_requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
