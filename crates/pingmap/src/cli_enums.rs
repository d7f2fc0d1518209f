//! Option values that are chosen from a list of names.

use std::ffi::OsStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, Command, ValueEnum};
use dgpc::Shape;
use pingmap_agent::{MeanStructure, OptionalTerm, PathInputs, Sharing, Terms};
use pingmap_trial::DivideBy;
use pingmap_trial::paper::Policy;

/// Parses the names of kernel shapes. A shape's parameter follows its name after a colon.
#[derive(Clone)]
pub struct ShapeParser;

impl TypedValueParser for ShapeParser {
    type Value = Shape;

    fn parse_ref(&self, command: &Command, option: Option<&Arg>, value: &OsStr) -> Result<Shape, clap::Error> {
        let name = value.to_string_lossy();
        // A value without a colon must be a known name; the error lists all names.
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

/// Returns the shapes of terms over positions.
fn shapes() -> impl Iterator<Item = &'static str> {
    Shape::ALL.iter().filter(|shape| !shape.is_of_labels()).map(|shape| shape.name())
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum InputsName {
    /// The positions of both ends, with one common length-scale
    Raw,
    /// Midpoint, direction and length of the link, with one length-scale per coordinate
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

/// How held-out events are chosen.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DivideByName {
    /// A random share of every vehicle's own events, so that held-out events have neighbours among the training events
    Random,
    /// A share of 20 blocks of time
    Time,
    /// The farthest links
    Range,
    /// Each vehicle's own events, one vehicle after the other
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
    /// No term
    None,
    /// Loss over the range as a smooth curve
    Range,
    /// Noise at the position of the receiver
    ReceiverPlace,
    /// Layers of the water: mean depth, difference of the depths, and range, if the log has depths
    Vertical,
    /// The direction of the receiver as seen from the transmitter's bow
    TransmitterAspect,
    /// The direction of the transmitter as seen from the receiver's bow
    ReceiverAspect,
    /// A difference between the two directions of a path
    OneWay,
    /// An offset of every receiver, since receivers differ
    Receivers,
    /// An offset of every transmitter
    Transmitters,
    /// A slow change with time that is common to all links
    Time,
    /// An offset of every message kind, if the log has kinds
    Kinds,
    /// Loss over the range with steps and notches instead of a smooth curve
    RoughRange,
    /// Obstacles such as walls and quays: a second path term over the positions of both ends
    Walls,
}

impl AdditionName {
    pub fn addition(self) -> Option<OptionalTerm> {
        match self {
            AdditionName::None => None,
            AdditionName::Range => Some(OptionalTerm::Range),
            AdditionName::ReceiverPlace => Some(OptionalTerm::ReceiverPlace),
            AdditionName::Vertical => Some(OptionalTerm::Vertical),
            AdditionName::TransmitterAspect => Some(OptionalTerm::TransmitterAspect),
            AdditionName::ReceiverAspect => Some(OptionalTerm::ReceiverAspect),
            AdditionName::OneWay => Some(OptionalTerm::OneWay),
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
    /// Constant odds
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
pub enum LearnName {
    /// One model, learned offline from every vehicle's training events
    Pooled,
    /// Every vehicle learns its own model, from its own events and the received data
    Own,
    /// Both models, reported side by side
    Both,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ShareName {
    /// Summaries of all events at inducing points
    Summaries,
    /// Reports of single outcomes
    Reports,
    /// Reports, and summaries of events that reports cannot carry
    Both,
}

impl ShareName {
    /// Returns the sharing options of every vehicle.
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
    /// Points that leave the least prior variance unexplained
    Good,
    /// Points that leave the most prior variance unexplained
    Bad,
    /// Points drawn uniformly
    Random,
}

impl PolicyName {
    /// Returns the policy.
    pub fn policy(self) -> Policy {
        match self {
            PolicyName::Good => Policy::Good,
            PolicyName::Bad => Policy::Bad,
            PolicyName::Random => Policy::Random,
        }
    }
}

/// Role of the position that a map is seen from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Seen {
    /// Transmits
    Tx,
    /// Receives
    Rx,
    /// Both roles, one map each
    Both,
    /// Both roles, with the less probable direction in each cell
    Worst,
}

/// Role of a position where one map is expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SeenOnce {
    /// Transmits
    Tx,
    /// Receives
    Rx,
    /// Both roles, with the less probable direction
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

/// Quantity that the colours of a map show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Layer {
    /// The probability
    Probability,
    /// The lower end of the 90 % interval of the probability
    Lower,
    /// The upper end of that interval
    Upper,
    /// The width of that interval
    Width,
}

/// How several positions are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Join {
    /// All links succeed
    All,
    /// At least one link succeeds
    Any,
}

/// Returns the name of an enumeration's value on the command line.
pub fn name_of(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}
