//! What a fit is given beside prior and events.

use crate::error::{Result, not_negative, positive, same_size};
use crate::inputs::Inputs;
use crate::summary::Summary;

/// What a fit is given beside prior and events: what others said, which inducing points to use, when to stop and where
/// to start.
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
    /// What others said of the same latent function; none if not said otherwise. Messages count with their kernel-free
    /// factors, whatever prior they were formed under.
    pub messages: &'a [&'a Summary],
    /// Support the posterior on these points instead of on all events: O(NM²) an iteration instead of O(N³). Those of
    /// the messages come on top.
    pub inducing_points: Option<&'a Inputs>,
    /// Stop when no tilt changes by more than this in one iteration; 1e-10 if not said otherwise.
    pub tolerance: f64,
    /// Stop after so many iterations all the same, 1000 if not said otherwise; [`crate::Fit::change`] then says how far
    /// it was.
    pub iterations_max: usize,
    /// Tilts to start from, one per event, such as [`crate::Fit::tilts`] of a fit under a similar prior.
    pub start: Option<&'a [f64]>,
}

impl Default for FitOptions<'_> {
    fn default() -> Self {
        Self { messages: &[], inducing_points: None, tolerance: 1e-10, iterations_max: 1000, start: None }
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

    /// Sets [`FitOptions::start`].
    #[must_use]
    pub fn start(self, tilts: &'a [f64]) -> Self {
        Self { start: Some(tilts), ..self }
    }

    /// Checks the numbers for a fit of `events` events.
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

    /// The inducing points, with those of the messages below; `None` for a dense fit.
    pub(crate) fn support(&self) -> Result<Option<Inputs>> {
        let Some(points) = self.inducing_points else { return Ok(None) };
        let mut support = points.clone();
        self.messages.iter().try_for_each(|message| support.append(message.inducing_points()))?;
        Ok(Some(support))
    }
}
