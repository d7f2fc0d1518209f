//! LCM logs and the definitions of their message types.

pub(crate) mod tokens;
pub(crate) mod types;
pub(crate) mod fingerprints;
pub(crate) mod decoder;
pub(crate) mod events;
pub(crate) mod log;
