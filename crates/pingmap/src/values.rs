//! Values of options: names to choose from, and numbers within bounds.

use std::str::FromStr;

use clap::ValueEnum;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use dgpc::Shape;
use pingmap_agent::{Bounds, Criterion, MeanStructure, PathInputs, Terms, bounds};
use pingmap_trial::paper::Policy;

/// The shapes of kernels, by their names.
pub fn shape() -> impl TypedValueParser<Value = Shape> {
    PossibleValuesParser::new(Shape::ALL.map(Shape::name)).try_map(|name| Shape::from_str(&name))
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputsName {
    /// The positions of both ends, one length-scale for all
    Raw,
    /// Where the link lies, and which way and how far it reaches; a length-scale for each coordinate
    Link,
}

impl InputsName {
    pub fn inputs(self) -> PathInputs {
        match self {
            InputsName::Raw => PathInputs::Raw,
            InputsName::Link => PathInputs::Link,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum YesNo {
    Yes,
    No,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TermsName {
    /// The path between the ends
    Path,
    /// The path, noise at the receiver, and loss over the range
    PathReceiverRange,
}

impl TermsName {
    pub fn terms(self) -> Terms {
        match self {
            TermsName::Path => Terms::Path,
            TermsName::PathReceiverRange => Terms::PathReceiverRange,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MeanName {
    /// Even odds
    Zero,
    /// The same odds everywhere
    Constant,
    /// Odds that fall with range
    Range,
}

impl MeanName {
    pub fn mean(self) -> MeanStructure {
        match self {
            MeanName::Zero => MeanStructure::Zero,
            MeanName::Constant => MeanStructure::Constant,
            MeanName::Range => MeanStructure::Range,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CriterionName {
    /// The leave-one-out log predictive probability
    LeaveOneOut,
    /// The evidence bound
    Evidence,
}

impl CriterionName {
    pub fn criterion(self) -> Criterion {
        match self {
            CriterionName::LeaveOneOut => Criterion::LeaveOneOut,
            CriterionName::Evidence => Criterion::Evidence,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LearnName {
    /// Somebody who saw the training events of all, beforehand
    Pooled,
    /// Every vehicle by itself, from its own events and what it received
    Own,
    /// Both, side by side
    Both,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolicyName {
    /// Leave as little prior variance unexplained as possible
    Good,
    /// Leave as much as possible
    Bad,
    /// Draw the points uniformly
    Random,
}

impl PolicyName {
    /// The policy.
    pub fn policy(self) -> Policy {
        match self {
            PolicyName::Good => Policy::Good,
            PolicyName::Bad => Policy::Bad,
            PolicyName::Random => Policy::Random,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum End {
    /// Transmits
    Tx,
    /// Receives
    Rx,
}

/// What the user calls a value of one of the enumerations above.
pub fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// A whole number within bounds.
fn count(text: &str, bounds: Bounds) -> Result<usize, String> {
    text.parse().ok().and_then(|number| bounds.check_count(number)).ok_or_else(|| format!("expected {bounds}"))
}

pub fn packets(text: &str) -> Result<usize, String> {
    count(text, bounds::PACKETS)
}

pub fn repeats(text: &str) -> Result<usize, String> {
    count(text, bounds::REPEATS)
}

pub fn events(text: &str) -> Result<usize, String> {
    count(text, bounds::EVENTS)
}

pub fn dense_events(text: &str) -> Result<usize, String> {
    count(text, bounds::DENSE_EVENTS)
}

pub fn inducing_points(text: &str) -> Result<usize, String> {
    count(text, bounds::INDUCING_POINTS)
}

pub fn frame_bytes(text: &str) -> Result<usize, String> {
    count(text, bounds::FRAME_BYTES)
}

/// What bounds it has is for others to say.
pub fn whole_number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "expected a whole number, not negative".to_owned())
}

pub fn sea_state(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (0.0..=6.0).contains(number));
    number.ok_or_else(|| "expected a number from 0 to 6".to_owned())
}

pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().and_then(|number| bounds::POSITIVE.check(number));
    number.ok_or_else(|| format!("expected {}", bounds::POSITIVE))
}

pub fn threads(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&number| number <= 256).ok_or_else(|| "expected a whole number from 0 to 256".to_owned())
}

pub fn share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (0.0..=1.0).contains(number));
    number.ok_or_else(|| "expected a number from 0 to 1".to_owned())
}

pub fn open_share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 1.0);
    number.ok_or_else(|| "expected a number above 0 and below 1".to_owned())
}

pub fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().ok().and_then(|x| bounds::COORDINATE_M.check(x)))
        .collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.ok_or_else(|| format!("expected {N} numbers, at most 1e9 from zero, with commas between them"))
}

pub fn pair(text: &str) -> Result<(f64, f64), String> {
    numbers::<2>(text).map(|[a, b]| (a, b))
}

pub fn quadruple(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}
