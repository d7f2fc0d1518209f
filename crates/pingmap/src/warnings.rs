//! Warnings for a host that shows them itself.

use std::cell::RefCell;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

thread_local! {
    static ATTACHED: RefCell<Option<Warnings>> = const { RefCell::new(None) };
}

/// A list of warnings.
///
/// A host attaches it to the thread that calls [`crate::run`], [`crate::run_until`] or [`crate::read_team`]. Warnings
/// are then appended to the list. Without a list they go to standard error. Clones share one list.
///
/// ```
/// let warnings = pingmap::Warnings::default();
/// warnings.attach();
/// pingmap::run(["pingmap", "packet", "schema"], &mut Vec::new())?;
/// assert!(warnings.take().is_empty());
/// # Ok::<(), pingmap::Failure>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct Warnings(Arc<Mutex<Vec<String>>>);

impl Warnings {
    /// Attaches the list to this thread, in place of an earlier one.
    pub fn attach(&self) {
        ATTACHED.set(Some(self.clone()));
    }

    /// Removes the warnings from the list, and returns them in the order in which they were found.
    pub fn take(&self) -> Vec<String> {
        std::mem::take(&mut self.texts())
    }

    /// Returns the list of this thread.
    pub(crate) fn attached() -> Option<Self> {
        ATTACHED.with_borrow(Clone::clone)
    }

    pub(crate) fn push(&self, text: String) {
        self.texts().push(text);
    }

    fn texts(&self) -> MutexGuard<'_, Vec<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
