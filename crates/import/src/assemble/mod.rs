//! Assembles the recordings of all vehicles into one event log.

// Each file uses only those above it.
pub(crate) mod rules;
pub(crate) mod median;
pub(crate) mod resolve_ids;
pub(crate) mod isolated_fixes;
pub(crate) mod vehicles;
pub(crate) mod clocks;
pub(crate) mod matching;
pub(crate) mod listening;
pub(crate) mod evidence;
pub(crate) mod pair_counts;
pub(crate) mod clock_estimate;
pub(crate) mod verdict;
pub(crate) mod result;
pub(crate) mod validation;
pub(crate) mod events;
pub(crate) mod recorded_events;
pub(crate) mod join;
