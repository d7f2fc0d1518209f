//! Errors of an agent.

use crate::team::config::TeamError;
use crate::types::bounds::{COORDINATE_M, HEADING_DEG};
use crate::types::event::VehicleId;

/// Error of an agent.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// The vehicle is not a member of the team, so it cannot send.
    #[error("{0} is not a member of the team, so it has no number to send under")]
    NotAMember(VehicleId),
    /// The vehicle has used all counters of the key epoch. A counter must not be used twice under one key.
    #[error("{id} has used up all counters of key epoch {epoch}; sending needs a new epoch")]
    CountersUsedUp {
        /// Name of the vehicle.
        id: VehicleId,
        /// The key epoch.
        epoch: u32,
    },
    /// The event belongs to another receiver. A vehicle records only its own receptions and misses.
    #[error("{id} cannot record an event of receiver {receiver}: a vehicle records only its own receptions and misses")]
    NotMine {
        /// Name of the vehicle.
        id: VehicleId,
        /// Receiver of the event.
        receiver: VehicleId,
    },
    /// A time is not finite.
    #[error("a time must be a finite number of seconds, found {time_s}")]
    NoTime {
        /// The time, in seconds.
        time_s: f64,
    },
    /// The time is outside the vehicle's own slots.
    #[error("{id} has no slot of its own at {time_s} s")]
    NotMyTurn {
        /// Name of the vehicle.
        id: VehicleId,
        /// The time, in seconds.
        time_s: f64,
    },
    /// A coordinate is out of bounds.
    #[error("a coordinate must be {COORDINATE_M}, found {value_m}")]
    Nowhere {
        /// The coordinate, in metres.
        value_m: f64,
    },
    /// A heading is out of bounds.
    #[error("a heading must be {HEADING_DEG}, found {heading_deg}")]
    NoHeading {
        /// The heading, in degrees.
        heading_deg: f64,
    },
    /// The number of an entry is out of bounds.
    #[error("the number of an entry must be below 2^48, found {0}")]
    NumberTooLarge(u64),
    /// The bytes are not an entry of a journal.
    #[error("not an entry of a journal: {problem}")]
    Entry {
        /// Description of the problem.
        problem: String,
    },
    /// The vehicle is not another member of the team.
    #[error("{0} is not another member of the team")]
    NotAPeer(VehicleId),
    /// The time has no numbered slot.
    #[error("the schedule has no numbered slot at {time_s} s")]
    NoSlot {
        /// The time, in seconds.
        time_s: f64,
    },
    /// The vehicle proposed no frame with this number, or does not store it any more.
    #[error("no stored frame has the transmission number {0}")]
    NoSuchFrame(u64),
    /// The alternative model has another chart origin than the team's model, or only one of both has depths.
    #[error("the alternative model must have the chart origin and the depth columns of the team's model")]
    DifferentInputs,
    /// The frame is too small for a packet.
    #[error(transparent)]
    Team(#[from] TeamError),
    /// A packet cannot be encoded.
    #[error(transparent)]
    Packet(#[from] pingmap_packet::Error),
    /// The bytes are not a snapshot of this vehicle.
    #[error("not a snapshot of {id}: {problem}")]
    Snapshot {
        /// Name of the vehicle.
        id: VehicleId,
        /// Description of the problem.
        problem: String,
    },
    /// A computation of the method failed.
    #[error(transparent)]
    Method(#[from] dgpc::Error),
}
