//! Options of one vehicle.

use crate::types::sharing::Sharing;

/// Options of one vehicle. Members of a team need not agree on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AgentOptions {
    /// Ways of sharing that the vehicle uses.
    pub sharing: Sharing,
    /// Record the events of every receiver as own events: for a vehicle or a station that has the logs of others.
    pub record_all_receivers: bool,
    /// Allow a probability that rises with range beyond the longest observed link. By default the prediction for a
    /// longer link never exceeds that for its part of the longest observed length.
    pub allow_extrapolated_increase: bool,
}
