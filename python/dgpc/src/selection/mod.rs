//! Choice of inducing points, and the certificate of a choice.

mod candidates;
mod certificate;
mod region;

pub use candidates::{Candidates, Selection, greedy, greedy_by_variance, greedy_judged};
pub use certificate::{Certificate, log_evidence};
pub use region::{LocalityRegion, busiest_region, region_around};
