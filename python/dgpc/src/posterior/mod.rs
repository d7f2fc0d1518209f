//! Sites of events, summaries of events, and the posteriors that follow from both.

mod concatenation;
mod fused;
mod shift;
mod sites;
mod summary;

pub use concatenation::Concatenation;
pub use fused::{Posterior, pair};
pub use shift::Shift;
pub use sites::{Sites, observations};
pub use summary::{Summary, references};
