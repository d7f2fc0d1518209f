//! The vocabulary of pingmap, and one vehicle as a state machine without input or output.
//!
//! [`Event`]s, [`Link`]s and the [`Chart`] say what happened where; a [`Model`] turns links into the inputs of the
//! method; an [`Agent`] owns one vehicle's events, learns from them, sums them up in packets, and fuses what it
//! receives. What a team agrees on beforehand is its [`Team`].

#![forbid(unsafe_code)]

// In the order of the flow: each module uses only those above it.
pub mod bounds;
mod canonical;
mod event;
mod attempt;
mod reference;
mod chart;
mod fading;
mod grid;
mod limits;
mod shifts;
mod slots;
mod told_track;
mod track;
mod knots;
mod place;
mod model;
mod structure;
#[cfg(feature = "learn")]
mod starts;
#[cfg(feature = "learn")]
mod learning;
mod model_file_error;
mod term_layout;
mod place_layout;
mod model_file;
mod wire;
mod team;
mod agreement;
mod team_file;
mod fitting;
mod planner;
mod receipt;
mod agent_error;
mod entry;
mod events;
mod packets;
mod passing;
mod reports;
mod frames;
mod clock;
mod turns;
mod placing;
mod memory;
mod tellings;
mod heard;
mod fitted;
mod beliefs;
mod judge;
mod refit;
mod reporter;
mod agent;
#[cfg(feature = "learn")]
mod adapt;
mod exchange;
mod sending;
mod spare;
mod prediction;
mod intervals;
mod snapshot;

pub use agent::{Agent, Telling};
pub use agent_error::AgentError;
pub use agreement::PROTOCOL_VERSION;
pub use attempt::{Attempt, Kind, Label, Party, When};
pub use bounds::Bounds;
pub use chart::{Chart, SCALE_FALLBACK_M};
pub use entry::Entry;
pub use event::{Event, Link, MessageKind, Position, VehicleId};
pub use fading::Fading;
pub use fitting::FitQuality;
pub use grid::Grid;
#[cfg(feature = "learn")]
pub use learning::{Criterion, LearnedModel, Learning};
pub use limits::Limits;
pub use model::{InputSpec, MODEL_SCHEMA, Model};
pub use model_file::{ModelFile, Provenance};
pub use model_file_error::ModelFileError;
pub use packets::COUNTER_LEAP_MAX;
pub use pingmap_packet::Key;
pub use place::Place;
pub use prediction::Prediction;
pub use receipt::{Counts, Receipt, Refusal};
pub use reference::{Geographic, NoReferenceSystem, ReferenceSystem};
pub use slots::{Opportunity, SlotChange, Slots};
pub use structure::{Addition, Additions, Given, MeanStructure, PathInputs, Structure, Terms};
pub use team::{TEAM_SCHEMA, Team, TeamError};
pub use team_file::TeamFile;
pub use wire::Wire;
