//! What a vehicle can refuse to do.

use crate::bounds::COORDINATE_M;
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
    /// An event that somebody else should have heard. Its receiver owns it.
    #[error("an event of {receiver} is none of {id}: a vehicle records what it should have heard itself")]
    NotMine {
        /// The vehicle.
        id: VehicleId,
        /// Who should have heard it.
        receiver: VehicleId,
    },
    /// A time that is none.
    #[error("the time of an event must be a finite number of seconds, found {time_s}")]
    NoTime {
        /// What it is.
        time_s: f64,
    },
    /// A time at which it is not the vehicle's turn to send.
    #[error("{id} has no slot of its own at {time_s} s")]
    NotMyTurn {
        /// The vehicle.
        id: VehicleId,
        /// The time.
        time_s: f64,
    },
    /// A place that is nowhere on Earth.
    #[error("a coordinate must be {COORDINATE_M}, found {value_m}")]
    Nowhere {
        /// What it is.
        value_m: f64,
    },
    /// A number of an entry that no vehicle comes to.
    #[error("an entry of a memory has a number below 2^48, found {number}")]
    NumberTooLarge {
        /// What it is.
        number: u64,
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
