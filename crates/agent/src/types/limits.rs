//! Limits on the computing time and memory of a vehicle.

use serde::{Deserialize, Serialize};

use crate::types::bounds::{self, Bounds};

/// Limits on computing time and memory. The number of packets has its own limit,
/// [`crate::Team::packets_per_sender_max`], which must be equal in the whole team.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Maximum number of own events that a vehicle stores. It stores the latest events.
    pub events_max: usize,
    /// Maximum number of events of a dense fit, which takes O(N³). Fits of more events use M inducing points and take
    /// O(NM²).
    pub dense_events_max: usize,
    /// Maximum number of inducing points of a sparse fit.
    pub inducing_points_max: usize,
    /// Maximum number of events that are candidates for inducing points. [`dgpc::spread_out`] spreads them over time.
    pub candidates_max: usize,
    /// Maximum number of events that posteriors absorb one at a time after the last fit. It holds for own and for
    /// remote events separately. Further events wait for the next fit. See [`Limits::refit_threshold`].
    pub pending_events_max: usize,
    /// Maximum number of past slots that a report may contain.
    pub report_window_slots: usize,
}

/// Minimum of the refit threshold, in events.
const PENDING_MIN: usize = 8;

/// Fitted events for each event that may change before the next fit.
const FITTED_PER_PENDING: usize = 16;

impl Default for Limits {
    fn default() -> Self {
        Self {
            events_max: 100_000,
            dense_events_max: 1200,
            inducing_points_max: 256,
            candidates_max: 1000,
            pending_events_max: 256,
            report_window_slots: 16_384,
        }
    }
}

impl Limits {
    /// Returns the name, the value and the bounds of every limit.
    pub fn entries(&self) -> [(&'static str, usize, Bounds); 6] {
        [
            ("events_max", self.events_max, bounds::EVENTS),
            ("dense_events_max", self.dense_events_max, bounds::DENSE_EVENTS),
            ("inducing_points_max", self.inducing_points_max, bounds::INDUCING_POINTS),
            ("candidates_max", self.candidates_max, bounds::CANDIDATES),
            ("pending_events_max", self.pending_events_max, bounds::PENDING_EVENTS),
            ("report_window_slots", self.report_window_slots, bounds::REPORT_WINDOW),
        ]
    }

    /// Returns true if `events` is at most a sixteenth of `fitted`.
    pub(crate) fn is_small(events: usize, fitted: usize) -> bool {
        events * FITTED_PER_PENDING <= fitted
    }

    /// Returns the number of changed events above which a fit of `events` events is repeated.
    ///
    /// Changed events are those that were added or removed since the fit. The threshold is a sixteenth of `events`, at
    /// least 8 and at most [`Limits::pending_events_max`]. An event that is absorbed after a fit is represented nearly
    /// as well as a fitted event.
    pub fn refit_threshold(&self, events: usize) -> usize {
        (events / FITTED_PER_PENDING).max(PENDING_MIN).min(self.pending_events_max)
    }
}
