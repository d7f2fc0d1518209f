//! Fits and posteriors, and the detection of faulty members.

pub(crate) mod fitting;
pub(crate) mod accepted;
pub(crate) mod event_fit;
pub(crate) mod alternative;
pub(crate) mod posterior_pair;
pub(crate) mod posteriors;
pub(crate) mod fault_detection;
pub(crate) mod refit;
