//! Formats numbers for the cells of tables.

use pingmap_trial::{Estimate, MeanScore};

/// Content of a cell without a value.
pub const NONE: &str = "–";

/// Marks of estimates: above zero by more than two standard errors, below zero by as much, or neither.
pub const HOLDS: &str = "✓";
pub const FAILS: &str = "✗";
pub const UNCLEAR: &str = "≈";

pub fn accuracy(score: Option<MeanScore>) -> String {
    score.map_or(NONE.into(), |score| estimate(score.accuracy))
}

pub fn nll(score: Option<MeanScore>) -> String {
    score.map_or(NONE.into(), |score| estimate(score.nll))
}

pub fn plain(value: Option<Estimate>) -> String {
    value.map_or(NONE.into(), estimate)
}

/// Formats a bound. Bounds span orders of magnitude.
pub fn bound(value: Option<Estimate>) -> String {
    value.map_or(NONE.into(), |value| match value.mean {
        mean if mean < 10.0 => format!("{mean:.3}"),
        mean if mean < 1e5 => format!("{mean:.1}"),
        mean => format!("{mean:.1e}"),
    })
}

/// Formats an estimate over permutations with its mark.
pub fn verdict(value: Option<Estimate>) -> String {
    value.map_or(NONE.into(), |value| format!("{} {}", mark(value), estimate(value)))
}

/// Formats an estimate over few data sets, with a mark by Student's t test.
pub fn verdict_by_t(value: Option<Estimate>) -> String {
    value.map_or(NONE.into(), |value| format!("{} {}", mark_if(value.is_clear(), value), estimate(value)))
}

/// Returns the mark of an estimate over permutations.
pub fn mark(value: Estimate) -> &'static str {
    mark_if(value.se.is_some_and(|se| value.mean.abs() > 2.0 * se), value)
}

fn mark_if(is_clear: bool, value: Estimate) -> &'static str {
    match (is_clear, value.mean > 0.0) {
        (false, _) => UNCLEAR,
        (true, true) => HOLDS,
        (true, false) => FAILS,
    }
}

/// Formats an estimate such as ".1234 ± .0012".
pub fn estimate(value: Estimate) -> String {
    let mean = decimal(value.mean);
    value.se.map_or(mean.clone(), |se| format!("{mean} ± {}", decimal(se)))
}

/// Formats a number with four decimals, without the zero before the point.
pub fn decimal(value: f64) -> String {
    let text = format!("{:.4}", value.abs());
    let text = text.strip_prefix('0').unwrap_or(&text);
    let negative = value < 0.0 && text.bytes().any(|byte| (b'1'..=b'9').contains(&byte));
    if negative { format!("−{text}") } else { text.to_owned() }
}
