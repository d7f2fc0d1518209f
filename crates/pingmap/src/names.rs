//! Values of options that have names to choose from.

use std::ffi::OsStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, Command, ValueEnum};
use dgpc::Shape;
use pingmap_agent::{Criterion, MeanStructure, OptionalTerm, PathInputs, Sharing, Terms};
use pingmap_trial::DivideBy;
use pingmap_trial::paper::Policy;

/// The shapes of kernels, by their names; one with a parameter takes it after a colon.
#[derive(Clone)]
pub struct ShapeParser;

impl TypedValueParser for ShapeParser {
    type Value = Shape;

    fn parse_ref(&self, command: &Command, option: Option<&Arg>, value: &OsStr) -> Result<Shape, clap::Error> {
        let name = value.to_string_lossy();
        // What is no name at all is refused with a list of all names.
        let name = if name.contains(':') { name } else { names().parse_ref(command, option, value)?.into() };
        name.parse()
            .map_err(|error| clap::Error::raw(ErrorKind::ValueValidation, format!("{error}\n")).with_cmd(command))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(shapes().map(PossibleValue::new)))
    }
}

fn names() -> PossibleValuesParser {
    PossibleValuesParser::new(shapes())
}

/// The shapes of terms over places.
fn shapes() -> impl Iterator<Item = &'static str> {
    Shape::ALL.iter().filter(|shape| !shape.is_of_labels()).map(|shape| shape.name())
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

/// What decides which events are held out.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DivideByName {
    /// Of every vehicle a share of its own events: neighbours of what is learned from
    Random,
    /// A share of 20 blocks of time
    Time,
    /// The farthest links
    Range,
    /// Every vehicle's own events in turn
    Vehicle,
}

impl DivideByName {
    pub fn divide_by(self) -> DivideBy {
        match self {
            DivideByName::Random => DivideBy::Random,
            DivideByName::Time => DivideBy::Time,
            DivideByName::Range => DivideBy::Range,
            DivideByName::Vehicle => DivideBy::Vehicle,
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AdditionName {
    /// Nothing
    None,
    /// Loss over the range as a curve
    Range,
    /// Noise at the place of the receiver
    ReceiverPlace,
    /// An offset of every receiver: ears differ
    Receivers,
    /// An offset of every transmitter
    Transmitters,
    /// Water that changes slowly, everywhere alike
    Time,
    /// An offset of every kind of message, where the log tells kinds apart
    Kinds,
    /// Loss over the range with steps and teeth, instead of a smooth curve
    RoughRange,
    /// Walls and quays: a second path term over the raw ends
    Walls,
}

impl AdditionName {
    pub fn addition(self) -> Option<OptionalTerm> {
        match self {
            AdditionName::None => None,
            AdditionName::Range => Some(OptionalTerm::Range),
            AdditionName::ReceiverPlace => Some(OptionalTerm::ReceiverPlace),
            AdditionName::Receivers => Some(OptionalTerm::Receivers),
            AdditionName::Transmitters => Some(OptionalTerm::Transmitters),
            AdditionName::Time => Some(OptionalTerm::Time),
            AdditionName::Kinds => Some(OptionalTerm::Kinds),
            AdditionName::RoughRange => Some(OptionalTerm::RoughRange),
            AdditionName::Walls => Some(OptionalTerm::Walls),
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
pub enum ShareName {
    /// Summaries of all events, at inducing points
    Summaries,
    /// Reports of single outcomes
    Reports,
    /// Reports, and summaries of events that no report can carry
    Both,
}

impl ShareName {
    /// The options of every vehicle.
    pub fn sharing(self) -> Sharing {
        match self {
            ShareName::Summaries => Sharing::summaries(),
            ShareName::Reports => Sharing::reports(),
            ShareName::Both => Sharing::default(),
        }
    }
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

/// What the place does that a map is seen from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Seen {
    /// Transmits
    Tx,
    /// Receives
    Rx,
    /// Both, one map each
    Both,
    /// Both, where the less probable direction counts
    Worst,
}

/// The same where there is one answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SeenOnce {
    /// Transmits
    Tx,
    /// Receives
    Rx,
    /// Both, where the less probable direction counts
    Worst,
}

impl SeenOnce {
    pub fn seen(self) -> Seen {
        match self {
            SeenOnce::Tx => Seen::Tx,
            SeenOnce::Rx => Seen::Rx,
            SeenOnce::Worst => Seen::Worst,
        }
    }
}

/// What the colours of a map say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Layer {
    /// The probability, hatched where little is known of it
    Probability,
    /// The lower end of the interval that holds it, nine in ten times
    Lower,
    /// The upper end
    Upper,
    /// How wide that interval is
    Width,
}

/// Which of several places count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Join {
    /// All at once
    All,
    /// Any of them
    Any,
}

/// What the user calls a value of one of the enumerations above.
pub fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}
