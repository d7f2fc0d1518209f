//! Positions over time, and the few waypoints that represent them.

pub(crate) mod position_track;
pub(crate) mod simplification;
pub(crate) mod received;
