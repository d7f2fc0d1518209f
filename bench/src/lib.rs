//! The benchmarks. Each is prepared once and run repeatedly.
//!
//! `benches/works.rs` passes them to criterion, which compares them with an earlier run. `src/main.rs` runs one benchmark line by line
//! for `compare`, which compares it with other software.

mod data;
mod growth;
mod works;

pub use data::{SIZES, synthetic, write_all};
pub use growth::{growth, growth_at};
pub use works::WORKS;

/// A benchmark.
pub struct Work {
    /// The name, here and in `peers`.
    pub name: &'static str,
    /// Number of repetitions in one run.
    pub repeats: usize,
    /// Whether it belongs to the short list, which takes a minute.
    pub short: bool,
    /// Prepares the benchmark. Each call of the returned function runs it once, and returns a measure of the result: a score, a trace or
    /// a mean. Without such a measure it returns NaN.
    pub start: fn() -> Box<dyn FnMut() -> f64>,
}

impl Work {
    /// Returns a benchmark of the short list.
    const fn short(name: &'static str, repeats: usize, start: fn() -> Box<dyn FnMut() -> f64>) -> Self {
        Self { name, repeats, short: true, start }
    }

    /// Returns a benchmark that takes longer.
    const fn long(name: &'static str, repeats: usize, start: fn() -> Box<dyn FnMut() -> f64>) -> Self {
        Self { name, repeats, short: false, start }
    }
}
