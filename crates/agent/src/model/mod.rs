//! The model: the inputs of a link, the prior over them, and the learning of its parameters.

pub(crate) mod fading;
pub(crate) mod inputs;
pub(crate) mod site_prior;
pub(crate) mod link_model;
pub(crate) mod optional_terms;
pub(crate) mod structure;
#[cfg(feature = "learn")]
pub(crate) mod starts;
#[cfg(feature = "learn")]
pub(crate) mod learning;
#[cfg(feature = "learn")]
pub(crate) mod screening;
pub(crate) mod file;
