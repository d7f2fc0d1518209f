//! Errors of simulations.

/// A number that is impossible for a trial.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{what} is {value}; expected {expected}")]
pub struct SimulationError {
    /// Name of the number.
    pub what: &'static str,
    /// The given value.
    pub value: f64,
    /// The possible values.
    pub expected: String,
}

/// Refuses values outside an interval, and NaN.
pub(super) fn within(what: &'static str, value: f64, low: f64, high: f64) -> Result<(), SimulationError> {
    let expected = format!("a number from {low} to {high}");
    if (low..=high).contains(&value) { Ok(()) } else { Err(SimulationError { what, value, expected }) }
}
