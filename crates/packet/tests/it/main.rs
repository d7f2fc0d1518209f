//! Tests of the public interface of the crate, in one binary.
//!
//! Each file tests one subject. `PINGMAP_WRITE_GOLDEN=1` rewrites the golden files instead of comparing with them.

#![allow(clippy::unwrap_used)]

mod generators;
mod golden;

mod dccl_vectors;
mod keys;
mod map_messages;
mod outcome_bitmap;
mod proto;
mod reports;
mod schema_check;
mod schema_codec;
