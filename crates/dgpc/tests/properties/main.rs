//! Properties that hold for every problem: random small problems against dense formulas, brute force, and each other.

#![allow(clippy::unwrap_used)]

#[path = "../common/mod.rs"]
mod common;

mod certificate;
mod contradictions;
mod evidence;
mod fits;
mod increments;
mod kernels;
mod mean_field;
mod nearness;
mod nothing;
mod posteriors;
mod probabilities;
mod problems;
mod propagation;
mod refusals;
mod selection;
mod summaries;
