//! One vehicle.

pub(crate) mod options;
pub(crate) mod ignore_reason;
pub(crate) mod state;
#[cfg(feature = "learn")]
pub(crate) mod adapt;
pub(crate) mod status;
pub(crate) mod receive;
pub(crate) mod outcomes;
pub(crate) mod sending;
pub(crate) mod piggyback;
pub(crate) mod prediction;
pub(crate) mod averaging;
pub(crate) mod intervals;
pub(crate) mod snapshot;
