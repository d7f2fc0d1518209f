//! Values of options: names to choose from, and numbers within bounds.

use std::ffi::OsStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Arg, Command, ValueEnum};
use dgpc::Shape;
use pingmap_agent::{Addition, Bounds, Criterion, Fading, Geographic, MeanStructure, PathInputs, Terms, bounds};
use pingmap_import::geographic;
use pingmap_trial::DivideBy;
use pingmap_trial::paper::Policy;

use crate::output::BadInput;

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
    pub fn addition(self) -> Option<Addition> {
        match self {
            AdditionName::None => None,
            AdditionName::Range => Some(Addition::Range),
            AdditionName::ReceiverPlace => Some(Addition::ReceiverPlace),
            AdditionName::Receivers => Some(Addition::Receivers),
            AdditionName::Transmitters => Some(Addition::Transmitters),
            AdditionName::Time => Some(Addition::Time),
            AdditionName::Kinds => Some(Addition::Kinds),
            AdditionName::RoughRange => Some(Addition::RoughRange),
            AdditionName::Walls => Some(Addition::Walls),
        }
    }
}

/// A time that is asked about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    End,
    Typical,
    AnotherDay,
    At(f64),
}

impl Moment {
    pub fn parse(text: &str) -> Result<Self, String> {
        match text {
            "end" => Ok(Moment::End),
            "typical" => Ok(Moment::Typical),
            "another-day" => Ok(Moment::AnotherDay),
            number => {
                let number = number.parse().ok().and_then(|number| bounds::TIME_S.check(number));
                let expected =
                    || format!("expected end, typical, another-day or a time in seconds, {}", bounds::TIME_S);
                number.map(Moment::At).ok_or_else(expected)
            }
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

/// Bytes that a message of a host's has left over.
pub fn spare_bytes(text: &str) -> Result<usize, String> {
    count(text, bounds::SPARE_BYTES)
}

/// What bounds it has is for others to say.
pub fn whole_number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "expected a whole number, not negative".to_owned())
}

/// A number within bounds.
fn number(text: &str, bounds: Bounds) -> Result<f64, String> {
    text.parse().ok().and_then(|number| bounds.check(number)).ok_or_else(|| format!("expected {bounds}"))
}

pub fn sea_state(text: &str) -> Result<f64, String> {
    number(text, bounds::SEA_STATE)
}

pub fn positive(text: &str) -> Result<f64, String> {
    number(text, bounds::POSITIVE)
}

pub fn not_negative(text: &str) -> Result<f64, String> {
    number(text, bounds::NOT_NEGATIVE)
}

pub fn time(text: &str) -> Result<f64, String> {
    number(text, bounds::TIME_S)
}

pub fn mission_s(text: &str) -> Result<f64, String> {
    number(text, bounds::MISSION_S)
}

pub fn place_points(text: &str) -> Result<usize, String> {
    count(text, bounds::PLACE_POINTS)
}

pub fn threads(text: &str) -> Result<usize, String> {
    count(text, bounds::THREADS)
}

pub fn share(text: &str) -> Result<f64, String> {
    number(text, bounds::SHARE)
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

/// The place that the option `--origin` names.
pub fn origin((latitude_deg, longitude_deg): (f64, f64)) -> Result<Geographic, BadInput> {
    let (latitude, longitude) = (bounds::LATITUDE_DEG, bounds::LONGITUDE_DEG);
    geographic(latitude_deg, longitude_deg).ok_or_else(|| {
        BadInput(format!(
            "--origin {latitude_deg},{longitude_deg}: expected a latitude ({latitude}) and a longitude ({longitude})"
        ))
    })
}

pub fn pair(text: &str) -> Result<(f64, f64), String> {
    numbers::<2>(text).map(|[a, b]| (a, b))
}

pub fn quadruple(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}

/// How outcomes at one place fade: correlation, seconds, metres a second, or `none`.
pub fn fading(text: &str) -> Result<Fading, String> {
    if text == "none" {
        return Ok(Fading::NONE);
    }
    let [correlation, memory_s, drift_m_per_s] = numbers(text).map_err(|error| format!("{error}, or none"))?;
    let fading = Fading { correlation, memory_s, drift_m_per_s };
    match fading.entries().into_iter().find(|(_, value, bounds)| bounds.check(*value).is_none()) {
        Some((_, value, bounds)) => Err(format!("{value}: expected {bounds}")),
        None => Ok(fading),
    }
}
