//! The host protocol: one JSON object a line in each direction.
//!
//! `docs/guides/vehicle.md` describes the messages for authors of hosts. Lines are read by [`read_line`], which names
//! the field that is wrong.

// In the order of the flow: each file uses only those above it.
pub(crate) mod place;
pub(crate) mod hex;
pub(crate) mod input;
pub(crate) mod fault;
pub(crate) mod output;
pub(crate) mod unique_keys;
pub(crate) mod line;
