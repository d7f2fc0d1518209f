//! LCM logs and the definitions of their message types.

pub(crate) mod tokens;
pub(crate) mod types;
pub(crate) mod log;
