//! Tests of the public interface of the crate, in one binary.
//!
//! Each file or folder tests one subject. Some subjects need a feature of the crate.

#![allow(clippy::unwrap_used)]

mod common;

#[cfg(feature = "learn")]
mod classification;
mod examples;
mod gibbs;
mod labels;
#[cfg(feature = "learn")]
mod learning;
mod monitor;
mod polya_gamma;
mod properties;
mod reference;
#[cfg(feature = "serde")]
mod serialisation;
mod shards;
#[cfg(feature = "parallel")]
mod threads;
