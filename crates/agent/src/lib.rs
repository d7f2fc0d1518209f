//! The vocabulary of pingmap, and one vehicle as a state machine without input or output.
//!
//! [`Event`]s, [`Link`]s and the [`Chart`] say what happened where; a [`Model`] turns links into the inputs of the method; an
//! [`Agent`] owns one vehicle's events, learns from them, sums them up in [`Packet`]s, and fuses what it receives.

mod agent;
mod chart;
mod event;
mod model;
mod structure;

pub use agent::{Agent, AgentError, FitQuality, Fusion, Limits, Packet, PacketPlan, SummaryKind};
pub use chart::{Chart, Geographic};
pub use event::{Event, Link, Position, VehicleId};
pub use model::{InputSpec, MODEL_SCHEMA, Model};
pub use structure::{Expectation, PathInputs, Structure, Terms};
