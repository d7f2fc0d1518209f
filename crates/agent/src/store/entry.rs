//! The entries of a vehicle's memory.

use crate::error::AgentError;
use crate::types::bounds::{COORDINATE_M, HEADING_DEG};
use crate::types::event::{Event, Position, VehicleId};

/// Largest number of an entry, plus one.
const NUMBER_MAX: u64 = 1 << 48;

/// One entry of a vehicle's memory. The memory is the set of its entries: they may be applied in any order, in parts,
/// and more than once.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Entry {
    /// An event that the vehicle recorded.
    Observed {
        /// Number of events recorded before it. It distinguishes two equal events from one event that is applied twice.
        number: u64,
        /// The event.
        event: Event,
    },
    /// A position from the vehicle's own navigation.
    Navigated {
        /// Time in seconds.
        time_s: f64,
        /// Position in the chart's reference system.
        position: Position,
    },
    /// Whether the vehicle heard a message of another member, without the positions of the ends. It counts as an event
    /// as soon as both positions are known by a rule that does not depend on the outcome: see
    /// [`Agent::record_outcome`](crate::Agent::record_outcome).
    Outcome {
        /// Time of transmission, in seconds.
        time_s: f64,
        /// The member that transmitted.
        transmitter_id: VehicleId,
        /// Whether the vehicle heard the message.
        success: bool,
    },
    /// A position of another member that the host knows.
    PeerPosition {
        /// The member.
        member: VehicleId,
        /// Time in seconds.
        time_s: f64,
        /// Position in the chart's reference system.
        position: Position,
        /// Whether the host knows it whether or not the vehicle receives the member.
        is_independent: bool,
    },
    /// A slot in which its member did not transmit.
    UnusedSlot {
        /// Member that the slot belongs to.
        sender: VehicleId,
        /// The slot.
        slot: u32,
    },
    /// Outcomes that another member piggybacked on a message of its host.
    Piggyback {
        /// Member that recorded the outcomes.
        sender: VehicleId,
        /// Newest slot.
        newest: u32,
        /// Whether the member heard the message of that slot, and of the slots before it in which it could receive.
        outcomes: Vec<bool>,
    },
    /// A frame that the vehicle received.
    Received {
        /// Time of reception in seconds, if known.
        time_s: Option<f64>,
        /// Bytes of the frame.
        bytes: Vec<u8>,
    },
    /// A frame that the vehicle proposed to its host, and what the host reported about it. If several entries have one
    /// number, the one with the latest [`FrameState`] counts.
    Sent {
        /// Number of frames proposed before it.
        number: u64,
        /// State of the frame.
        state: FrameState,
        /// The slot of the transmission, if it is one of the vehicle's own; see
        /// [`Slots::next_slot`](crate::Slots::next_slot). A report that lists this slot as heard acknowledges the
        /// frame.
        slot: Option<u32>,
        /// Bytes of the frame.
        bytes: Vec<u8>,
    },
}

/// State of a frame that the vehicle proposed to its host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FrameState {
    /// The host has it, and has not reported its departure. It counts as transmitted.
    Proposed,
    /// It never left. No member received it, but its counter stays used.
    Dropped,
    /// It left.
    Departed,
}

pub(crate) fn check_number(number: u64) -> Result<(), AgentError> {
    if number < NUMBER_MAX { Ok(()) } else { Err(AgentError::NumberTooLarge(number)) }
}

/// Checks that the time and both positions of an event are finite and within bounds.
pub(crate) fn check_event(event: &Event) -> Result<(), AgentError> {
    check_time(event.time_s)?;
    event.link.ends().iter().try_for_each(check_position)
}

pub(crate) fn check_time(time_s: f64) -> Result<(), AgentError> {
    if time_s.is_finite() { Ok(()) } else { Err(AgentError::NoTime { time_s }) }
}

pub(crate) fn check_position(at: &Position) -> Result<(), AgentError> {
    let mut coordinates = [Some(at.east_m), Some(at.north_m), at.depth_m].into_iter().flatten();
    if let Some(value_m) = coordinates.find(|&value_m| COORDINATE_M.check(value_m).is_none()) {
        return Err(AgentError::Nowhere { value_m });
    }
    match at.heading_deg.filter(|&heading_deg| HEADING_DEG.check(heading_deg).is_none()) {
        Some(heading_deg) => Err(AgentError::NoHeading { heading_deg }),
        None => Ok(()),
    }
}
