//! What can happen to a memory.

use crate::agent_error::AgentError;
use crate::bounds::COORDINATE_M;
use crate::event::{Event, Position, VehicleId};

/// Numbers of entries from here on are no vehicle's.
const NUMBER_MAX: u64 = 1 << 48;

/// Something that a vehicle remembers from then on. All that it knows follows from the set of its entries, whatever
/// their order and however often each of them came: a journal of them can be applied again, in parts and twice over.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Entry {
    /// An event of its own.
    Observed {
        /// How many it had observed before: what tells two equal events from one that came twice.
        number: u64,
        /// The event.
        event: Event,
    },
    /// Where it was, by its own navigation.
    Navigated {
        /// When, in seconds.
        time_s: f64,
        /// Where.
        position: Position,
    },
    /// Whether a member sent in a slot of its own.
    Turn {
        /// Whose slot it is.
        sender: VehicleId,
        /// The slot.
        slot: u32,
        /// Whether it sent.
        sent: bool,
    },
    /// What another one said in spare bits of a message of its host's.
    Recent {
        /// Who said it.
        sender: VehicleId,
        /// The newest slot that it speaks of.
        newest: u32,
        /// Whether it heard what was sent in that slot, and in those before in which it could hear somebody.
        outcomes: Vec<bool>,
    },
    /// A frame that it heard.
    Heard {
        /// As they came.
        bytes: Vec<u8>,
    },
    /// A frame that it sent, for the first time or again.
    Sent {
        /// How many it had sent before.
        number: u64,
        /// The slot in which it went ([`Slots::next_turn`](crate::Slots::next_turn) of the time that
        /// [`Agent::next_packet`](crate::Agent::next_packet) was given), if it was one of its own: who reports what it heard
        /// then says whether it has this report. Other slots count as none.
        slot: Option<u32>,
        /// As they left.
        bytes: Vec<u8>,
    },
}

/// Refuses a number that no entry comes to.
pub(crate) fn check_number(number: u64) -> Result<(), AgentError> {
    if number < NUMBER_MAX { Ok(()) } else { Err(AgentError::NumberTooLarge { number }) }
}

/// Refuses an event at no time, and one that is nowhere.
pub(crate) fn check_event(event: &Event) -> Result<(), AgentError> {
    check_time(event.time_s)?;
    event.link.ends().iter().try_for_each(check_position)
}

pub(crate) fn check_time(time_s: f64) -> Result<(), AgentError> {
    if time_s.is_finite() { Ok(()) } else { Err(AgentError::NoTime { time_s }) }
}

pub(crate) fn check_position(at: &Position) -> Result<(), AgentError> {
    let mut places = [Some(at.east_m), Some(at.north_m), at.depth_m].into_iter().flatten();
    match places.find(|&value_m| COORDINATE_M.check(value_m).is_none()) {
        Some(value_m) => Err(AgentError::Nowhere { value_m }),
        None => Ok(()),
    }
}
