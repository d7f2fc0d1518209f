//! Field trials: event logs as input, many vehicles on one mission, scores as output. The crate returns data and draws
//! no figures.
//!
//! Only this crate uses threads: splits and vehicles run in parallel on the current rayon pool. Every use of random
//! numbers has its own stream of one seed, so that results do not depend on the number of threads.

#![forbid(unsafe_code)]

// In the order of the flow: each module uses only those above it.
mod streams;
mod delimited;
mod table;
mod event_log;
mod headings;
mod attempts;
mod built_in;
mod split;
mod division;
mod score;
mod decision;
mod calibration;
mod baseline;
mod check;
mod channel_impairments;
mod learning;
pub mod paper;
mod alternative;
mod plan;
mod mission;
mod schedule;
mod alternatives;
mod ignored;
mod replay;
mod online;
pub mod selection;
pub mod simulate;

pub use alternative::Alternative;
pub use alternatives::Package;
pub use attempts::{AttemptTable, ToMetres, read_attempts};
pub use baseline::{DistanceOnly, base_rate};
pub use built_in::{BUILT_IN, built_in};
pub use calibration::{Bin, Calibration, INTERVALS};
pub use channel_impairments::ChannelImpairments;
pub use check::{Finding, PairCount, RangeBin, is_everybody};
pub use decision::Decisions;
pub use division::{DivideBy, Division, DivisionError};
pub use event_log::{EventLog, REQUIRED_COLUMNS};
pub use ignored::Ignored;
pub use learning::{Added, learn};
pub use mission::{Mission, Traffic, probabilities, send_frames, transmissions};
pub use online::{Observer, Online, Step, TrafficPlan, Vehicles, online, online_observed, record_and_refit};
pub use plan::{ModelSource, Plan, Preshared};
pub use replay::{Calibrated, Replay, ReplayError, Sharing, SplitNll, SplitSummary, replay};
pub use schedule::schedule;
pub use score::{Estimate, MeanScore, Score};
pub use split::{Split, read_splits, splits_to_csv, thin};
pub use table::{FLAG, FileError, KIND_COLUMNS, Problem, Table, flag, open};
