//! The vocabulary of pingmap, and one vehicle as a state machine without input or output.
//!
//! [`Event`]s, [`Link`]s and the [`Chart`] say what happened where; a [`Model`] turns links into the inputs of the method; an
//! [`Agent`] owns one vehicle's events, learns from them, sums them up in packets, and fuses what it receives. What a team agrees on
//! beforehand is its [`Team`].

mod agent;
mod chart;
mod event;
mod exchange;
mod grid;
mod knowledge;
mod learning;
mod limits;
mod live;
mod model;
mod model_file;
mod receipt;
mod snapshot;
mod structure;
mod team;
mod team_file;
mod telling;
mod wire;

pub use agent::{Agent, AgentError};
pub use chart::{Chart, Geographic, SCALE_FALLBACK_M};
pub use event::{Event, Link, Position, VehicleId};
pub use grid::Grid;
pub use knowledge::FitQuality;
pub use learning::{Criterion, Fit, Learning};
pub use limits::Limits;
pub use model::{InputSpec, MODEL_SCHEMA, Model};
pub use model_file::{ModelFile, ModelFileError, Provenance};
pub use pingmap_packet::Key;
pub use receipt::{Counts, Receipt, Refusal};
pub use structure::{Expectation, Given, PathInputs, Structure, Terms};
pub use team::{Slots, TEAM_SCHEMA, Team, TeamError};
pub use team_file::TeamFile;
pub use wire::Wire;
