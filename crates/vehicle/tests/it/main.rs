//! Tests of the public interface of the crate, in one binary.
//!
//! Each file tests one subject.

#![allow(clippy::unwrap_used)]

mod common;
mod host;
mod sim_disk;

mod clock;
mod damage;
mod handling;
mod identity;
mod persistence;
mod power_loss;
mod recovery;
mod refusals;
mod round_trip;
mod simulation;
mod snapshots;
