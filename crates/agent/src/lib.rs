//! One vehicle of a team as a state machine without input or output, and the types that it shares with other crates.
//!
//! An [`Event`] records one transmission as its receiver observed it. A [`Model`] turns a [`LinkQuery`] into the inputs
//! of the method. A [`Team`] holds everything that its members fix before the mission. An [`Agent`] records the events
//! of one vehicle, exchanges frames, and predicts links.

#![forbid(unsafe_code)]

// In the order of the flow: each folder, and each file in a folder, uses only those above it.
mod types;
mod model;
mod team;
mod codec;
mod error;
mod track;
mod store;
mod inference;
mod send;
mod agent;

pub use agent::ignore_reason::IgnoreReason;
pub use agent::intervals::INTERVAL_WIDENING;
pub use agent::options::AgentOptions;
pub use agent::prediction::{Interval, Prediction};
pub use agent::receive::Reception;
pub use agent::sending::ProposedFrame;
pub use agent::state::{Agent, Which};
pub use agent::status::{MemberStatus, Status};
pub use codec::quantizer::SummaryQuantizer;
pub use codec::receipt::{Receipt, Refusal};
pub use codec::team_codec::TeamCodec;
pub use error::AgentError;
pub use inference::fitting::FitQuality;
pub use model::fading::Fading;
pub use model::file::error::ModelFileError;
pub use model::file::model_file::{ModelFile, Provenance};
pub use model::inputs::{End, InputSpec, LengthUnit};
#[cfg(feature = "learn")]
pub use model::learning::{LearnedModel, Learning};
pub use model::link_model::{MODEL_SCHEMA, Model};
pub use model::optional_terms::{OptionalTerm, OptionalTerms};
#[cfg(feature = "learn")]
pub use model::screening::Attempt;
pub use model::site_prior::SitePrior;
pub use model::structure::{CONSERVATIVE_LOSS, MeanStructure, PathInputs, Structure, Terms};
pub use pingmap_packet::Key;
pub use store::clock::COUNTER_LEAD;
pub use store::entry::{Entry, FrameState};
pub use team::config::{TEAM_SCHEMA, Team, TeamError};
pub use team::digest::PROTOCOL_VERSION;
pub use team::file::TeamFile;
pub use team::grid::Grid;
pub use team::members::Members;
pub use team::slots::{ScheduledTransmission, Slots};
pub use types::bounds;
pub use types::bounds::Bounds;
pub use types::chart::{Chart, MainArea, SCALE_FALLBACK_M};
pub use types::event::{Event, Link, MessageKind, Position, VehicleId};
pub use types::interrupt::Interrupt;
pub use types::limits::Limits;
pub use types::query::{Kind, Label, LinkQuery, Time, UnknownHeading, Vehicle};
pub use types::reference_system::{Geographic, NoReferenceSystem, ReferenceSystem};
pub use types::sharing::Sharing;
