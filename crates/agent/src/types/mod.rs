//! Basic types: events, links, queries, charts, and the bounds and limits of numbers.

pub mod bounds;
pub(crate) mod event;
pub(crate) mod query;
pub(crate) mod reference_system;
pub(crate) mod chart;
pub(crate) mod interrupt;
pub(crate) mod limits;
pub(crate) mod sharing;
