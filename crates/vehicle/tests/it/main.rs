//! Tests of the public interface of the crate, in one binary.
//!
//! Each file tests one subject. Tests that are too slow for every change are ignored; `.ci/full` runs them.

#![allow(clippy::unwrap_used)]

mod common;
mod sim_disk;

mod damage;
mod identity;
mod power_loss;
mod recovery;
mod refusals;
mod round_trip;
mod snapshots;
