//! Options for learning a prior.

use std::ops::ControlFlow;

use super::bounds::{self, Bounds};
use super::hyper_prior::HyperPrior;
use crate::error::{Result, not_negative, positive, same_size};
use crate::inputs::Inputs;
use crate::monitor::{Monitor, Progress};
use crate::prior::Prior;
use crate::summary::Summary;

/// Options for the search for the parameters of a prior.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct LearnOptions<'a> {
    /// Messages of peers about the same latent function; none by default.
    pub messages: &'a [&'a Summary],
    /// Distribution of the parameters about the template's values.
    pub hyper_prior: HyperPrior,
    /// Bounds of the parameters, one per entry of [`Prior::parameter_values`]; none by default. A search moves no
    /// parameter beyond its bounds, and the calibration of the variances does not either.
    pub bounds: &'a [Bounds],
    /// The only start, apart from `further_starts`: an earlier [`crate::Learned::optimum`], of the template's
    /// structure. The new optimum is never worse in E, over the events of the search. Without a warm start there are
    /// several starts.
    pub warm_start: Option<&'a Prior>,
    /// Initial tilts of the first fits, one per event, such as [`crate::Fit::tilts`] under a similar prior. They change
    /// only the duration of these fits.
    pub tilts: Option<&'a [f64]>,
    /// Further starts, of the template's structure. With a warm start they are always searched. Otherwise a further
    /// start is dropped if it leads to the same optimum or loses the race ([`LearnOptions::race_events_max`]).
    pub further_starts: &'a [Prior],
    /// Largest number of events on which the starts are compared. The default is 150.
    pub start_events_max: usize,
    /// Number of events in the race, which decides from which starts all events are searched. The default is 500.
    ///
    /// The race takes place if there are at least twice as many events. With 0 there is no race, and all starts are
    /// searched. Races on 250 events have hidden the better of two optima.
    pub race_events_max: usize,
    /// Largest number of events in the search, spread evenly. The default is 4000. The result is then fitted to all
    /// events. More events would still change the parameters, but not noticeably the predictions.
    pub search_events_max: usize,
    /// Largest number of events for which E is that of a dense fit, O(N³) an evaluation. The default is 1200. Beyond
    /// it, E is that of a sparse fit, O(NM²).
    pub dense_events_max: usize,
    /// Largest number M of inducing points of a sparse fit, chosen greedily among the events. The default is 256. The
    /// inducing points of the messages are added to them.
    pub inducing_points_max: usize,
    /// Inducing points of all fits of the searched events, in place of the choice; none by default. With them, these
    /// fits are sparse however few the events are. The inducing points of the messages are added to them.
    pub inducing_points: Option<&'a Inputs>,
    /// Largest number of steps of a search. The default is 60.
    pub iterations_max: usize,
    /// A search ends when a step gains less than this, in nats an event. The default is 1e-7. A search also ends when
    /// the gradient and the curvature of E predict a remaining gain of less than ten times this.
    pub tolerance: f64,
    /// Whether all variances are finally multiplied by the common factor that maximises the corrected evidence
    /// ([`crate::Fit::corrected_evidence`]). The default is true. The slack of E grows with the variance, so that E
    /// alone leaves the variance too small.
    pub calibrate: bool,
    /// The callback that receives the progress and can stop the search; none by default.
    pub monitor: Monitor<'a>,
}

impl Default for LearnOptions<'_> {
    fn default() -> Self {
        Self {
            messages: &[],
            hyper_prior: HyperPrior::default(),
            bounds: &[],
            warm_start: None,
            tilts: None,
            further_starts: &[],
            start_events_max: 150,
            race_events_max: 500,
            search_events_max: 4000,
            dense_events_max: 1200,
            inducing_points_max: 256,
            inducing_points: None,
            iterations_max: 60,
            tolerance: 1e-7,
            calibrate: true,
            monitor: Monitor::default(),
        }
    }
}

impl<'a> LearnOptions<'a> {
    /// Sets [`LearnOptions::messages`].
    #[must_use]
    pub fn messages(self, messages: &'a [&'a Summary]) -> Self {
        Self { messages, ..self }
    }

    /// Sets [`LearnOptions::hyper_prior`].
    #[must_use]
    pub fn hyper_prior(self, hyper_prior: HyperPrior) -> Self {
        Self { hyper_prior, ..self }
    }

    /// Sets [`LearnOptions::bounds`].
    #[must_use]
    pub fn bounds(self, bounds: &'a [Bounds]) -> Self {
        Self { bounds, ..self }
    }

    /// Sets [`LearnOptions::warm_start`].
    #[must_use]
    pub fn warm_start(self, optimum: &'a Prior) -> Self {
        Self { warm_start: Some(optimum), ..self }
    }

    /// Sets [`LearnOptions::tilts`].
    #[must_use]
    pub fn tilts(self, tilts: &'a [f64]) -> Self {
        Self { tilts: Some(tilts), ..self }
    }

    /// Sets [`LearnOptions::further_starts`].
    #[must_use]
    pub fn further_starts(self, further_starts: &'a [Prior]) -> Self {
        Self { further_starts, ..self }
    }

    /// Sets [`LearnOptions::start_events_max`].
    #[must_use]
    pub fn start_events_max(self, start_events_max: usize) -> Self {
        Self { start_events_max, ..self }
    }

    /// Sets [`LearnOptions::race_events_max`].
    #[must_use]
    pub fn race_events_max(self, race_events_max: usize) -> Self {
        Self { race_events_max, ..self }
    }

    /// Sets [`LearnOptions::search_events_max`].
    #[must_use]
    pub fn search_events_max(self, search_events_max: usize) -> Self {
        Self { search_events_max, ..self }
    }

    /// Sets [`LearnOptions::dense_events_max`] and [`LearnOptions::inducing_points_max`].
    #[must_use]
    pub fn sparse_beyond(self, dense_events_max: usize, inducing_points_max: usize) -> Self {
        Self { dense_events_max, inducing_points_max, ..self }
    }

    /// Sets [`LearnOptions::inducing_points`].
    #[must_use]
    pub fn inducing_points(self, inducing_points: &'a Inputs) -> Self {
        Self { inducing_points: Some(inducing_points), ..self }
    }

    /// Sets [`LearnOptions::iterations_max`].
    #[must_use]
    pub fn iterations_max(self, iterations_max: usize) -> Self {
        Self { iterations_max, ..self }
    }

    /// Sets [`LearnOptions::tolerance`].
    #[must_use]
    pub fn tolerance(self, tolerance: f64) -> Self {
        Self { tolerance, ..self }
    }

    /// Sets [`LearnOptions::calibrate`].
    #[must_use]
    pub fn calibrate(self, calibrate: bool) -> Self {
        Self { calibrate, ..self }
    }

    /// Sets [`LearnOptions::monitor`].
    #[must_use]
    pub fn monitor(self, callback: &'a (dyn Fn(Progress) -> ControlFlow<()> + Sync)) -> Self {
        Self { monitor: Monitor::new(callback), ..self }
    }

    /// Checks the options.
    pub(super) fn check(&self, template: &Prior, events: usize) -> Result<()> {
        bounds::check(template, self.bounds)?;
        if let Some(tilts) = self.tilts {
            same_size("tilts to begin at, one per event", events, tilts.len())?;
        }
        positive("largest number of inducing points", self.inducing_points_max as f64)?;
        positive("largest number of events in a search", self.search_events_max as f64)?;
        not_negative("tolerance of a search", self.tolerance)?;
        self.hyper_prior.check()
    }
}
