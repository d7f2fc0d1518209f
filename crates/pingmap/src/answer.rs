//! Answers about a probability: yes, no or not known.

use schemars::JsonSchema;
use serde::Serialize;

/// Answer to the question whether a probability reaches a required one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Answer {
    /// The lower end of the interval reaches the required probability.
    Yes,
    /// The upper end of the interval is below the required probability.
    No,
    /// The required probability lies within the interval.
    NotKnown,
}

impl Answer {
    /// Returns the answer for the ends of a 90 % interval.
    pub fn of((lower, upper): (f64, f64), required: f64) -> Self {
        match (lower >= required, upper < required) {
            (true, _) => Answer::Yes,
            (false, true) => Answer::No,
            (false, false) => Answer::NotKnown,
        }
    }

    /// Returns the answer as in JSON and tables.
    pub fn name(self) -> &'static str {
        match self {
            Answer::Yes => "yes",
            Answer::No => "no",
            Answer::NotKnown => "not_known",
        }
    }

    /// Returns the answer in words.
    pub fn words(self) -> &'static str {
        match self {
            Answer::Yes => "yes",
            Answer::No => "no",
            Answer::NotKnown => "not known",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_answer_is_known_only_if_the_interval_lies_on_one_side() {
        assert_eq!(Answer::of((0.9, 0.99), 0.9), Answer::Yes);
        assert_eq!(Answer::of((0.1, 0.89), 0.9), Answer::No);
        assert_eq!(Answer::of((0.1, 0.9), 0.9), Answer::NotKnown);
        assert_eq!(Answer::of((0.0, 1.0), 0.9).words(), "not known");
    }
}
