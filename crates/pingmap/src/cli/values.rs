//! Values of options: names to choose from, and numbers within bounds.

use clap::ValueEnum;
use dgpc::Shape;
use pingmap_agent::{Criterion, MeanStructure, PathInputs, Terms, bounds};
use pingmap_trial::paper::Policy;

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ShapeName {
    SquaredExponential,
    Matern32,
    Matern52,
}

impl ShapeName {
    pub(super) fn shape(self) -> Shape {
        match self {
            ShapeName::SquaredExponential => Shape::SquaredExponential,
            ShapeName::Matern32 => Shape::Matern32,
            ShapeName::Matern52 => Shape::Matern52,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputsName {
    /// The positions of both ends, one length-scale for all
    Raw,
    /// Where the link lies, and which way and how far it reaches; a length-scale for each coordinate
    Link,
}

impl InputsName {
    pub(super) fn inputs(self) -> PathInputs {
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
    pub(super) fn terms(self) -> Terms {
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
    pub(super) fn mean(self) -> MeanStructure {
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
    pub(super) fn criterion(self) -> Criterion {
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

/// A table or figure of the paper's experiment.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Exhibit {
    /// Everything, and a page that holds it
    All,
    /// Table: events of every agent
    Events,
    /// Tables: what one or two points of its region tell an agent about its own held-out events
    Local,
    /// Tables: what everybody's points tell the team
    Team,
    /// Table: bounds on the KL divergence, and whether they order the policies as NLL does
    Certificate,
    /// Tables: radius and number of points beyond the paper's
    Sweep,
    /// Figure: tracks, and the local events of one region
    Tracks,
    /// Figure: good, random and bad points of that region
    Points,
    /// Figure: what the team predicts right and wrong
    Predictions,
}

impl Exhibit {
    /// Whether it is a figure, or holds some.
    pub fn has_pictures(self) -> bool {
        matches!(self, Exhibit::All | Exhibit::Tracks | Exhibit::Points | Exhibit::Predictions)
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

pub(super) fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&number| number >= 1).ok_or_else(|| "expected a whole number of at least 1".to_owned())
}

/// What bounds it has is for others to say.
pub(super) fn whole_number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "expected a whole number, not negative".to_owned())
}

pub(super) fn sea_state(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (0.0..=6.0).contains(number));
    number.ok_or_else(|| "expected a number from 0 to 6".to_owned())
}

pub(super) fn permutations(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| (1..=10_000).contains(number));
    number.ok_or_else(|| "expected a whole number from 1 to 10000".to_owned())
}

/// Lengths and variances beyond these bounds mean a slip of the pen, and would overflow when squared.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (1e-6..=1e9).contains(number));
    number.ok_or_else(|| "expected a number above 0, from 1e-6 to 1e9".to_owned())
}

pub(super) fn threads(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&number| number <= 256).ok_or_else(|| "expected a whole number from 0 to 256".to_owned())
}

pub(super) fn frame_bytes(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|number| (32..=65536).contains(number));
    number.ok_or_else(|| "expected a whole number from 32 to 65536: no packet fits into less".to_owned())
}

pub(super) fn share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| (0.0..=1.0).contains(number));
    number.ok_or_else(|| "expected a number from 0 to 1".to_owned())
}

pub(super) fn open_share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|number| *number > 0.0 && *number < 1.0);
    number.ok_or_else(|| "expected a number above 0 and below 1".to_owned())
}

pub(super) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse::<f64>().ok().and_then(|x| bounds::COORDINATE_M.check(x)))
        .collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.ok_or_else(|| format!("expected {N} numbers, at most 1e9 from zero, with commas between them"))
}

pub(super) fn pair(text: &str) -> Result<(f64, f64), String> {
    numbers::<2>(text).map(|[a, b]| (a, b))
}

pub(super) fn quadruple(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}
