//! Field trials: event logs in, many vehicles on one mission, scores out. Returns data and draws nothing.
//!
//! The only crate with threads: splits and vehicles run in parallel on the current rayon pool. Everything random comes from
//! one seed through streams of their own, so that results do not depend on the number of threads.

mod alternatives;
mod baseline;
mod event_log;
mod learning;
mod mission;
mod online;
pub mod paper;
mod replay;
mod score;
pub mod simulate;
mod split;
mod water;

pub use alternatives::Alternative;
pub use baseline::{DistanceOnly, base_rate};
pub use event_log::{COORDINATE_MAX_M, EventLog, FileError, Problem, REQUIRED_COLUMNS, read_links};
pub use learning::{learn_all, learn_best};
pub use mission::{Agreed, Learners, Mission, Plan};
pub use online::{Online, Step, online};
pub use replay::{Replay, ReplayError, Sharing, SplitSummary, replay};
pub use score::{Estimate, MeanScore, Score};
pub use split::{Split, draw_splits, read_splits, thin};
pub use water::Water;
