//! Options of a fit.

use std::ops::ControlFlow;

use crate::error::{Result, not_negative, positive, same_size};
use crate::inputs::Inputs;
use crate::monitor::{Monitor, Progress};
use crate::summary::Summary;

/// Options of a fit: the messages of peers, the inducing points, the stopping rule and the starting point.
///
/// ```
/// use dgpc::{FitOptions, Inputs};
///
/// let inducing_points = Inputs::from_rows(&[[0.0], [2.0]])?;
/// let options = FitOptions::default().inducing_points(&inducing_points).tolerance(1e-6);
/// assert_eq!(options.iterations_max, 1000);
/// # Ok::<(), dgpc::Error>(())
/// ```
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct FitOptions<'a> {
    /// Messages of peers about the same latent function; none by default. Messages count with their kernel-free
    /// factors, whatever prior they were formed under.
    pub messages: &'a [&'a Summary],
    /// Inducing points that support the posterior, in place of all events: O(NM²) an iteration instead of O(N³). The
    /// inducing points of the messages are added to them.
    pub inducing_points: Option<&'a Inputs>,
    /// The fit stops when no tilt changes by more than this in one iteration. The default is 1e-10.
    pub tolerance: f64,
    /// The fit stops after this number of iterations even without convergence. The default is 1000.
    /// [`crate::Fit::change`] then gives the remaining change.
    pub iterations_max: usize,
    /// The callback that receives the progress and can stop the fit; none by default.
    pub monitor: Monitor<'a>,
    /// Tilts to start from, one per event, such as [`crate::Fit::tilts`] of a fit under a similar prior.
    pub start: Option<&'a [f64]>,
}

impl Default for FitOptions<'_> {
    fn default() -> Self {
        Self {
            messages: &[],
            inducing_points: None,
            tolerance: 1e-10,
            iterations_max: 1000,
            monitor: Monitor::default(),
            start: None,
        }
    }
}

impl<'a> FitOptions<'a> {
    /// Sets [`FitOptions::messages`].
    #[must_use]
    pub fn messages(self, messages: &'a [&'a Summary]) -> Self {
        Self { messages, ..self }
    }

    /// Sets [`FitOptions::inducing_points`].
    #[must_use]
    pub fn inducing_points(self, inducing_points: &'a Inputs) -> Self {
        Self { inducing_points: Some(inducing_points), ..self }
    }

    /// Sets [`FitOptions::tolerance`].
    #[must_use]
    pub fn tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// Sets [`FitOptions::iterations_max`].
    #[must_use]
    pub fn iterations_max(self, iterations_max: usize) -> Self {
        Self { iterations_max, ..self }
    }

    /// Sets [`FitOptions::monitor`].
    #[must_use]
    pub fn monitor(self, callback: &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync)) -> Self {
        Self { monitor: Monitor::new(callback), ..self }
    }

    /// Sets [`FitOptions::start`].
    #[must_use]
    pub fn start(self, tilts: &'a [f64]) -> Self {
        Self { start: Some(tilts), ..self }
    }

    /// Checks the options for a fit of `events` events.
    pub(super) fn check(&self, events: usize) -> Result<()> {
        not_negative("tolerance", self.tolerance)?;
        positive("largest number of iterations", self.iterations_max as f64)?;
        if let Some(start) = self.start {
            same_size("tilts to start from, one per event", events, start.len())?;
            for &tilt in start {
                positive("tilt to start from", tilt)?;
            }
        }
        Ok(())
    }

    /// Returns the inducing points followed by those of the messages, or `None` for a dense fit.
    pub(crate) fn support(&self) -> Result<Option<Inputs>> {
        let Some(points) = self.inducing_points else { return Ok(None) };
        let mut support = points.clone();
        self.messages.iter().try_for_each(|message| support.append(message.inducing_points()))?;
        Ok(Some(support))
    }
}
