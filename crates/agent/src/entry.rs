//! What can happen to a memory.

use crate::event::{Event, Position, VehicleId};

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
