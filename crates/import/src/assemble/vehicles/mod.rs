//! The vehicles of a mission: their tracks, the messages that they received, and their transmissions.

pub(crate) mod message;
pub(crate) mod track;
pub(crate) mod fleet;
pub(crate) mod transmission;
