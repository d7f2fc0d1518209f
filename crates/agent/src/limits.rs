//! Bounds on the work and memory of a vehicle.

use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};

/// Bounds on work and memory. Packets are bounded by [`crate::Team::packets_per_sender_max`], on which a team must
/// agree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// How many of its own events a vehicle keeps: the latest.
    pub events_max: usize,
    /// Up to so many events are fitted densely, O(N³); beyond, with inducing points, O(NM²).
    pub dense_events_max: usize,
    /// How many inducing points a sparse fit has at most.
    pub inducing_points_max: usize,
    /// How many events are candidates for inducing points at most, spread over time by [`dgpc::spread_out`].
    pub candidates_max: usize,
    /// How many events may stand beside the last fit at most, of its own and of those that it was told each: more wait for
    /// the next. See [`Limits::beside_fit`].
    pub events_beside_max: usize,
    /// How many slots a report looks back on at most.
    pub slots_back_max: usize,
}

/// Events that may stand beside any fit,
const BESIDE_MIN: usize = 8;

/// and one for so many that are in it.
const FITTED_PER_BESIDE: usize = 16;

impl Default for Limits {
    fn default() -> Self {
        Self {
            events_max: 100_000,
            dense_events_max: 1200,
            inducing_points_max: 256,
            candidates_max: 1000,
            events_beside_max: 256,
            slots_back_max: 16_384,
        }
    }
}

impl Limits {
    /// Every limit: its name, what it is, and its bounds.
    pub fn entries(&self) -> [(&'static str, usize, Bounds); 6] {
        [
            ("events_max", self.events_max, bounds::EVENTS),
            ("dense_events_max", self.dense_events_max, bounds::DENSE_EVENTS),
            ("inducing_points_max", self.inducing_points_max, bounds::INDUCING_POINTS),
            ("candidates_max", self.candidates_max, bounds::CANDIDATES),
            ("events_beside_max", self.events_beside_max, bounds::EVENTS_BESIDE),
            ("slots_back_max", self.slots_back_max, bounds::SLOTS_BACK),
        ]
    }

    /// Whether so many events are a small share of those that were fitted.
    pub(crate) fn is_small(events: usize, fitted: usize) -> bool {
        events * FITTED_PER_BESIDE <= fitted
    }

    /// How many events may come or go before a fit of so many is due anew: a sixteenth as many, eight at least and
    /// [`Limits::events_beside_max`] at most. What stands beside a fit is known nearly as well as what is in it: predictions
    /// are by 0.001 to 0.003 nats better for it than with 64 always.
    pub fn beside_fit(&self, events: usize) -> usize {
        (events / FITTED_PER_BESIDE).max(BESIDE_MIN).min(self.events_beside_max)
    }
}
