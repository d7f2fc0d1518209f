//! The vocabulary of pingmap, and one vehicle as a state machine without input or output.
//!
//! [`Event`]s, [`Link`]s and the [`Chart`] say what happened where; a [`Model`] turns links into the inputs of the method; an
//! [`Agent`] owns one vehicle's events, learns from them, sums them up in [`Packet`]s, and fuses what it receives.

mod agent;
mod chart;
mod event;
mod learning;
mod limits;
mod model;
mod model_file;
mod structure;

pub use agent::{Agent, AgentError, FitQuality, Fusion, Packet, PacketPlan, SummaryKind};
pub use chart::{Chart, Geographic, SCALE_FALLBACK_M};
pub use event::{Event, Link, Position, VehicleId};
pub use learning::{Criterion, Fit, Learning};
pub use limits::Limits;
pub use model::{InputSpec, MODEL_SCHEMA, Model};
pub use model_file::{ModelFile, ModelFileError, Provenance};
pub use structure::{Expectation, Given, PathInputs, Structure, Terms};
