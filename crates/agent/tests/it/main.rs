//! Tests of the public interface of the crate, in one binary.
//!
//! Each file tests one subject. `CASES_TIMES=10` multiplies the number of random cases.

#![allow(clippy::unwrap_used)]

mod common;

mod adaptation;
mod agent;
mod authentication;
mod averaging;
mod chart;
mod clock;
mod contradictions;
mod cost;
mod delivery;
mod directions;
mod entries;
mod fading;
mod fault_detection;
mod golden;
mod grid;
mod interrupt;
mod journal;
mod malformed_packets;
mod malformed_reports;
mod memory;
mod model_files;
mod models;
mod muting;
mod own_outcomes;
mod piggyback;
mod predictions;
mod quantizer;
mod receiver_offsets;
mod report_choice;
mod reports;
mod site_prior;
mod slot_conformance;
mod slots;
mod snapshots;
mod summaries;
mod summary_planner;
mod team_file;
mod unused_slots;
