//! Tests of the public interface of the crate, in one binary. Each file tests one subject.

#![allow(clippy::unwrap_used)]

mod alternatives;
mod fading;
mod fleet;
mod interrupts;
mod log_checks;
mod online;
mod optional_terms;
mod paper;
mod swapped_areas;
mod fault_detection;
mod map_quality;
