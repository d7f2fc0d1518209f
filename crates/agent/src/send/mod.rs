//! The choice of the next frame.

pub(crate) mod delivery;
pub(crate) mod report_planner;
pub(crate) mod summary_planner;
