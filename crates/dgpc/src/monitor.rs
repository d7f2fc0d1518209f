//! Progress of long computations, and the request to stop them.

use std::fmt;
use std::ops::ControlFlow;

use crate::error::{Error, Result};

/// The progress of a fit or of learning.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Progress {
    /// A fit made an iteration.
    Iteration {
        /// Number of iterations so far.
        iterations: usize,
        /// Largest change of a tilt in this iteration, or of an ω or a κ in expectation propagation.
        change: f64,
    },
    /// A search evaluated the evidence bound and its gradient.
    Evaluation {
        /// E plus the log density of the hyperprior, in nats, over the events of the search.
        objective: f64,
    },
}

/// A callback that receives the progress of a fit or of learning, and can stop it.
///
/// The callback is called once an iteration and once an evaluation. If it returns [`ControlFlow::Break`], the
/// computation ends with [`Error::Stopped`]. With the feature `parallel`, learning calls it from several threads at
/// once. The calls have no influence on results.
///
/// ```
/// use std::ops::ControlFlow;
///
/// use dgpc::{Error, FitOptions, Inputs, Kernel, Observations, Prior, PriorMean, Progress, Shape, Term, fit};
///
/// let events = Observations::new(Inputs::from_rows(&[[0.0], [1.0]])?, vec![true, false])?;
/// let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1)?])?;
/// let prior = Prior::new(kernel, PriorMean::Zero)?;
/// let at_most_two = |progress: Progress| match progress {
///     Progress::Iteration { iterations: 2, .. } => ControlFlow::Break(()),
///     _ => ControlFlow::Continue(()),
/// };
/// let stopped = fit(&prior, &events, &FitOptions::default().monitor(&at_most_two));
/// assert_eq!(stopped.err(), Some(Error::Stopped));
/// # Ok::<(), Error>(())
/// ```
#[derive(Clone, Copy, Default)]
pub struct Monitor<'a>(Option<&'a Callback<'a>>);

type Callback<'a> = dyn Fn(Progress) -> ControlFlow<()> + Sync + 'a;

impl<'a> Monitor<'a> {
    /// Creates a monitor that calls `callback`.
    pub fn new(callback: &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync + 'a)) -> Self {
        Self(Some(callback))
    }

    /// Reports progress to the callback. Returns [`Error::Stopped`] if the callback asks to stop.
    pub(crate) fn report(self, progress: Progress) -> Result<()> {
        match self.0.map_or(ControlFlow::Continue(()), |callback| callback(progress)) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Stopped),
        }
    }
}

impl fmt::Debug for Monitor<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(if self.0.is_some() { "Monitor(callback)" } else { "Monitor(none)" })
    }
}
