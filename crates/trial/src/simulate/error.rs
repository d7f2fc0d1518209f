//! Numbers that no trial can have.

/// Numbers that no trial can have.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{what} is {value}; expected {expected}")]
pub struct SimulationError {
    /// Which number.
    pub what: &'static str,
    /// What it is.
    pub value: f64,
    /// What it can be.
    pub expected: String,
}

/// Refuses what lies outside, and NaN.
pub(super) fn within(what: &'static str, value: f64, low: f64, high: f64) -> Result<(), SimulationError> {
    let expected = format!("a number from {low} to {high}");
    if (low..=high).contains(&value) { Ok(()) } else { Err(SimulationError { what, value, expected }) }
}
