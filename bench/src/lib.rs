//! The works that are timed: each is made ready once, and run as often as it takes.
//!
//! `benches/works.rs` gives them to criterion, which compares them with an earlier run of themselves; `src/main.rs` runs
//! one of them line by line, as `compare` asks for it, beside the same work of other software.

mod data;
mod growth;
mod works;

pub use data::{SIZES, synthetic, write_all};
pub use growth::{growth, growth_at};
pub use works::WORKS;

/// Something to time.
pub struct Work {
    /// What it is called, here and in `peers`.
    pub name: &'static str,
    /// How often one run does it.
    pub repeats: usize,
    /// Whether it belongs to the short list, which takes a minute.
    pub short: bool,
    /// Makes it ready. What comes back does it once for every call, and says how well: a score, a trace, a mean; NaN
    /// where there is nothing to say.
    pub start: fn() -> Box<dyn FnMut() -> f64>,
}

impl Work {
    /// One that belongs to the short list.
    const fn short(name: &'static str, repeats: usize, start: fn() -> Box<dyn FnMut() -> f64>) -> Self {
        Self { name, repeats, short: true, start }
    }

    /// One that takes longer.
    const fn long(name: &'static str, repeats: usize, start: fn() -> Box<dyn FnMut() -> f64>) -> Self {
        Self { name, repeats, short: false, start }
    }
}
