//! What a vehicle can refuse to do.

use crate::event::VehicleId;
use crate::team::TeamError;

/// What an agent can refuse to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// Only members send.
    #[error("{id} is not a member of the team, and has no number to send under")]
    NotAMember {
        /// Who it is.
        id: VehicleId,
    },
    /// A counter must never repeat under one key.
    #[error("{id} has used up all counters of key epoch {epoch}; sending needs a new epoch")]
    CountersUsedUp {
        /// The vehicle.
        id: VehicleId,
        /// The epoch.
        epoch: u32,
    },
    /// The frame is too small.
    #[error(transparent)]
    Team(#[from] TeamError),
    /// A packet could not be encoded.
    #[error(transparent)]
    Packet(#[from] pingmap_packet::Error),
    /// Bytes that are no snapshot of this vehicle.
    #[error("not a snapshot of {id}: {problem}")]
    Snapshot {
        /// The vehicle.
        id: VehicleId,
        /// What is wrong.
        problem: String,
    },
    /// The method refused.
    #[error(transparent)]
    Method(#[from] dgpc::Error),
}
