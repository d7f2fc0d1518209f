//! How a prior is learned.

use super::hyper_prior::HyperPrior;
use crate::error::{Result, not_negative, positive, same_size};
use crate::prior::Prior;
use crate::summary::Summary;

/// How to search for the parameters of a prior.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct LearnOptions<'a> {
    /// What others said of the same latent function; none if not said otherwise.
    pub messages: &'a [&'a Summary],
    /// How far parameters may go from the template's.
    pub hyper_prior: HyperPrior,
    /// Start here, on all events that the search looks at: an earlier [`crate::Learned::optimum`], of the template's
    /// structure. The new optimum is never worse in E of these. Without it there are several starts.
    pub warm_start: Option<&'a Prior>,
    /// Fits begin at these tilts, one per event: those of [`crate::Fit::tilts`] under a similar prior. They change nothing but
    /// how long the first ones take.
    pub tilts: Option<&'a [f64]>,
    /// Start here too, beside where the search starts anyway: beside a warm start always, else unless that leads to the same
    /// place or loses the race ([`LearnOptions::race_events_max`]); of the template's structure.
    pub further_starts: &'a [Prior],
    /// How many events the starts are compared on, at most: 150 if not said otherwise.
    pub start_events_max: usize,
    /// How many events decide from which starts all of them are searched, where there are at least twice as many: 500 if not
    /// said otherwise; at 0 all starts are searched from. Half as many have been seen to hide the better of two optima.
    pub race_events_max: usize,
    /// The search looks at so many events at most, spread evenly, 4000 if not said otherwise; what it finds is then fitted to
    /// all of them. What more events would still move in the parameters, predictions do not show.
    pub search_events_max: usize,
    /// Up to so many events, 1200 if not said otherwise, E is that of the dense fit, O(N³) an evaluation; beyond, that
    /// of a sparse one, O(NM²).
    pub dense_events_max: usize,
    /// Inducing points M of a sparse fit, chosen greedily among the events, beside those of the messages: 256 if not
    /// said otherwise.
    pub inducing_points_max: usize,
    /// How many steps a search takes at most: 60 if not said otherwise.
    pub iterations_max: usize,
    /// A search ends where a step gains less than this, in nats an event, or where ten times as much is all that is left to
    /// gain, by the gradient and how E bends: 1e-7 if not said otherwise.
    pub tolerance: f64,
    /// Whether all variances are multiplied by a common factor at the end, that which maximises the corrected evidence
    /// ([`crate::Fit::corrected_evidence`]): the slack of E grows with the variance, so that E alone leaves it too
    /// small. So it is if not said otherwise.
    pub calibrate: bool,
}

impl Default for LearnOptions<'_> {
    fn default() -> Self {
        Self {
            messages: &[],
            hyper_prior: HyperPrior::default(),
            warm_start: None,
            tilts: None,
            further_starts: &[],
            start_events_max: 150,
            race_events_max: 500,
            search_events_max: 4000,
            dense_events_max: 1200,
            inducing_points_max: 256,
            iterations_max: 60,
            tolerance: 1e-7,
            calibrate: true,
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

    /// Checks the numbers.
    pub(super) fn check(&self, events: usize) -> Result<()> {
        if let Some(tilts) = self.tilts {
            same_size("tilts to begin at, one per event", events, tilts.len())?;
        }
        positive("largest number of inducing points", self.inducing_points_max as f64)?;
        positive("largest number of events that a search looks at", self.search_events_max as f64)?;
        not_negative("tolerance of a search", self.tolerance)?;
        self.hyper_prior.check()
    }
}
