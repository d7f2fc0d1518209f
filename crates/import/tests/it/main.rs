//! Tests of the public interface of the crate, in one binary.
//!
//! Each file tests one subject.

#![allow(clippy::unwrap_used)]

mod bags;
mod damaged_logs;
mod modem_cases;
mod modem_data;
mod modem_replies;
mod modems;
mod mutated_files;
mod outcomes;
mod properties;
mod random;
mod simulated_missions;
mod sqlite_bags;
