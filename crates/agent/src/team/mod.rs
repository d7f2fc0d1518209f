//! The configuration that a team fixes before the mission.

pub(crate) mod canonical;
pub(crate) mod slots;
pub(crate) mod grid;
pub(crate) mod members;
pub(crate) mod config;
pub(crate) mod digest;
pub(crate) mod file;
