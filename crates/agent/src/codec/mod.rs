//! Encodes and decodes the packets of a team.

pub(crate) mod quantizer;
pub(crate) mod receipt;
pub(crate) mod decoded;
pub(crate) mod team_codec;
