//! The memory of a vehicle: a set of entries, and the remote events that follow from it. The content of every store
//! depends on the set of its data, not on their order or number.

pub(crate) mod entry;
pub(crate) mod entry_bytes;
pub(crate) mod clock;
pub(crate) mod events;
pub(crate) mod packets;
pub(crate) mod reports;
pub(crate) mod own_outcomes;
pub(crate) mod peer_positions;
pub(crate) mod slot_conformance;
pub(crate) mod claim_check;
pub(crate) mod slot_evidence;
pub(crate) mod position_check;
pub(crate) mod event_location;
pub(crate) mod memory;
pub(crate) mod memory_entries;
