//! Bounds on the work and memory of a vehicle.

use dgpc::Inputs;

/// Bounds on work and memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Up to so many events are fitted densely, O(N³); beyond, with inducing points, O(NM²).
    pub dense_events_max: usize,
    /// How many inducing points a sparse fit has at most.
    pub inducing_points_max: usize,
    /// How many events are candidates for inducing points at most: every k-th in time, with the smallest k that keeps to this.
    pub candidates_max: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { dense_events_max: 1000, inducing_points_max: 256, candidates_max: 1000 }
    }
}

impl Limits {
    /// Every k-th of some inputs in time, k the smallest that keeps to [`Limits::candidates_max`].
    pub(crate) fn candidates(&self, inputs: &Inputs) -> Inputs {
        let step = inputs.len().div_ceil(self.candidates_max.max(1)).max(1);
        inputs.select(&(0..inputs.len()).step_by(step).collect::<Vec<_>>())
    }
}
