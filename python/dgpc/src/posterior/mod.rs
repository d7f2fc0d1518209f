//! Sites of events, summaries of events, and the posteriors that follow from both.

mod concatenation;
mod fused;
mod parts;
mod shift;
mod sites;
mod summary;

pub use concatenation::Concatenation;
pub use fused::{Posterior, pair};
pub use parts::Parts;
pub use shift::Shift;
pub use sites::{Sites, observations};
pub use summary::{Summary, copies, references};
