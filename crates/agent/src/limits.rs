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
}

impl Default for Limits {
    fn default() -> Self {
        Self { events_max: 100_000, dense_events_max: 1000, inducing_points_max: 256, candidates_max: 1000 }
    }
}

impl Limits {
    /// Every limit: its name, what it is, and its bounds.
    pub fn entries(&self) -> [(&'static str, usize, Bounds); 4] {
        [
            ("events_max", self.events_max, bounds::EVENTS),
            ("dense_events_max", self.dense_events_max, bounds::DENSE_EVENTS),
            ("inducing_points_max", self.inducing_points_max, bounds::INDUCING_POINTS),
            ("candidates_max", self.candidates_max, bounds::CANDIDATES),
        ]
    }
}
