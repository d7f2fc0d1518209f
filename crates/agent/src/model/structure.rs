//! Structures: the terms of the kernel and the form of the prior mean, without their parameters.

use std::fmt;
use std::ops::Range;

use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};

use crate::model::inputs::{End, InputSpec};
use crate::model::optional_terms::{OptionalTerm, OptionalTerms};

/// The columns over which the path term measures distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathInputs {
    /// Raw positions of both ends, with one length-scale for all columns.
    Raw,
    /// Link coordinates, with one length-scale for each: location, direction and length of the link.
    Link,
}

/// The basic terms of the latent function, which is their sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Terms {
    /// Path between the ends.
    Path,
    /// Path, noise at the receiver, and loss over the range.
    PathReceiverRange,
}

/// The form of the prior mean, which is the expected log-odds before the first event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeanStructure {
    /// Even odds.
    Zero,
    /// Constant odds.
    Constant,
    /// Odds that decrease with range.
    Range,
    /// Even odds at a range that the user gives, and log-odds that decrease linearly with range.
    Conservative {
        /// Range with even odds, in metres.
        range_m: f64,
        /// Decrease of the log-odds per metre.
        slope_per_m: f64,
    },
}

/// Decrease of the log-odds of a conservative prior mean between range zero and its range.
pub const CONSERVATIVE_LOSS: f64 = 4.0;

impl MeanStructure {
    /// Returns a prior mean with even odds at `range_m` metres. Log-odds decrease by `slope_per_m` per metre, by
    /// default by four over the range.
    pub fn conservative(range_m: f64, slope_per_m: Option<f64>) -> Self {
        Self::Conservative { range_m, slope_per_m: slope_per_m.unwrap_or(CONSERVATIVE_LOSS / range_m) }
    }
}

/// The structure of a model: its kernel and prior mean without their parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Structure {
    /// Shape of the covariance as a function of distance, in every term over positions.
    pub shape: Shape,
    /// Columns of the path term.
    pub path_inputs: PathInputs,
    /// True if both directions of a path have equal path terms, unless [`OptionalTerm::OneWay`] is added.
    pub reciprocal: bool,
    /// Basic terms of the latent function.
    pub terms: Terms,
    /// Form of the prior mean.
    pub mean: MeanStructure,
    /// Optional terms that are added to the basic terms.
    pub additions: OptionalTerms,
}

/// Variance of the path term before learning. Its standard deviation is 2 log-odds.
const PATH_VARIANCE: f64 = 4.0;

/// Variance of all other terms before learning.
const OTHER_VARIANCE: f64 = 1.0;

/// Reciprocity of the path term before learning.
const RECIPROCITY: f64 = 0.9;

/// Length-scale of the time term before learning, in seconds.
const MEMORY_S: f64 = 1800.0;

/// Length-scale of depths before learning, in metres.
const DEPTH_LENGTH_M: f64 = 20.0;

/// Length-scale of the aspect terms before learning, as a chord of the unit circle: about 60 degrees.
const ASPECT_LENGTH: f64 = 1.0;

/// Log-odds at range zero before learning.
const LOG_ODDS_NEAR: f64 = 3.0;

/// Decrease of the log-odds over the scale of the chart before learning.
const LOSS_OVER_SCALE: f64 = 4.0;

/// A term of the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// Path between the ends.
    Path,
    /// Another term. A rough range and a one-way path are no terms of their own: they change another term.
    Other(OptionalTerm),
}

impl Part {
    /// Returns the kernel term of an optional term. Returns `None` for an optional term that only changes another term.
    fn from_addition(addition: OptionalTerm) -> Option<Self> {
        let changes_another = matches!(addition, OptionalTerm::RoughRange | OptionalTerm::OneWay);
        (!changes_another).then_some(Part::Other(addition))
    }
}

impl Structure {
    /// Returns the prior before learning. Its length-scales and slopes are proportional to `scale_m`, the scale of the
    /// chart in metres.
    ///
    /// # Errors
    /// [`dgpc::Error::OutOfRange`] for a scale that is not finite and positive, or a conservative range that is not
    /// finite.
    pub fn template(&self, inputs: InputSpec, scale_m: f64) -> dgpc::Result<Prior> {
        let terms = self.kernel_parts().map(|part| self.term(part, inputs, scale_m));
        let terms = terms.collect::<dgpc::Result<_>>()?;
        let range = |intercept, slope| inputs.range_mean(intercept, slope);
        let mean = match self.mean {
            MeanStructure::Zero => PriorMean::Zero,
            MeanStructure::Constant => PriorMean::Constant(0.0),
            MeanStructure::Range => range(LOG_ODDS_NEAR, LOSS_OVER_SCALE / scale_m)?,
            MeanStructure::Conservative { range_m, slope_per_m } => range(range_m * slope_per_m, slope_per_m)?,
        };
        Prior::new(Kernel::new(terms)?, mean)
    }

    /// Returns true if adding this term would change the structure.
    ///
    /// The structure must not contain the term yet. A rough range also needs a range term, and a one-way path a
    /// reciprocal one.
    pub fn can_have(&self, addition: OptionalTerm) -> bool {
        match (Part::from_addition(addition), addition) {
            (Some(part), _) => self.kernel_parts().all(|own| own != part),
            (None, OptionalTerm::OneWay) => !self.additions.has(addition) && self.reciprocal,
            (None, _) => {
                !self.additions.has(addition) && self.kernel_parts().any(|own| own == Part::Other(OptionalTerm::Range))
            }
        }
    }

    /// Returns the structure with this term added.
    #[must_use]
    pub fn with(&self, addition: OptionalTerm) -> Self {
        Self { additions: self.additions.with(addition), ..*self }
    }

    /// Returns the name of a kernel term in [`Structure::parts`].
    fn part_name(&self, part: Part) -> String {
        let term = match part {
            Part::Path => return "path".to_owned(),
            Part::Other(OptionalTerm::Range) if self.additions.has(OptionalTerm::RoughRange) => {
                OptionalTerm::RoughRange
            }
            Part::Other(term) => term,
        };
        term.name().replace('-', " ")
    }

    /// Returns the terms of the kernel, in order.
    pub(crate) fn kernel_parts(&self) -> impl Iterator<Item = Part> {
        let basic: &[Part] = match self.terms {
            Terms::Path => &[Part::Path],
            Terms::PathReceiverRange => {
                &[Part::Path, Part::Other(OptionalTerm::ReceiverPlace), Part::Other(OptionalTerm::Range)]
            }
        };
        basic.iter().copied().chain(self.additions.iter().filter_map(Part::from_addition))
    }

    /// Returns a kernel term before learning.
    fn term(&self, part: Part, inputs: InputSpec, scale_m: f64) -> dgpc::Result<Term> {
        let untied = |shape, columns: &[usize]| {
            let length_scale = |&column: &usize| if inputs.is_depth(column) { DEPTH_LENGTH_M } else { scale_m };
            Correlation::new(shape, columns, &columns.iter().map(length_scale).collect::<Vec<_>>())
        };
        let tied = |shape, columns: Range<usize>| {
            let columns = Vec::from_iter(columns);
            let ties: Vec<usize> = columns.iter().map(|&column| inputs.is_depth(column).into()).collect();
            untied(shape, &columns)?.tied(&ties)
        };
        let rough = if self.additions.has(OptionalTerm::RoughRange) { Shape::Matern12 } else { self.shape };
        let aspect = |end| {
            let direction = Correlation::isotropic(self.shape, &Vec::from_iter(inputs.aspect(end)), ASPECT_LENGTH)?;
            Term::of(OTHER_VARIANCE, direction)?.times(Correlation::of_labels(&[inputs.heading(end)])?)
        };
        let label = |column| Term::of(OTHER_VARIANCE, Correlation::of_labels(&[column])?);
        let path = || {
            let correlation = match self.path_inputs {
                PathInputs::Raw => tied(self.shape, inputs.ends())?,
                PathInputs::Link => untied(self.shape, &Vec::from_iter(inputs.link_coordinates()))?,
            };
            let path = Term::of(PATH_VARIANCE, correlation)?;
            let reciprocity = if self.additions.has(OptionalTerm::OneWay) { RECIPROCITY } else { 1.0 };
            if self.reciprocal { path.partly_reciprocal(inputs.swap_ends()?, reciprocity) } else { Ok(path) }
        };
        let Part::Other(other) = part else { return path() };
        match other {
            OptionalTerm::ReceiverPlace => Term::of(OTHER_VARIANCE, tied(self.shape, inputs.receiver())?),
            OptionalTerm::Range | OptionalTerm::RoughRange => {
                Term::of(OTHER_VARIANCE, tied(rough, inputs.range()..inputs.range() + 1)?)
            }
            OptionalTerm::Receivers => label(inputs.receiving_vehicle()),
            OptionalTerm::Transmitters => label(inputs.transmitting_vehicle()),
            OptionalTerm::Kinds => label(inputs.kind()),
            OptionalTerm::Vertical => {
                let columns = inputs.link_depths().chain([inputs.range()]);
                let layers = untied(self.shape, &Vec::from_iter(columns))?;
                Term::of(OTHER_VARIANCE, layers)?.reciprocal(inputs.swap_ends()?)
            }
            OptionalTerm::TransmitterAspect => aspect(End::Transmitter),
            OptionalTerm::ReceiverAspect => aspect(End::Receiver),
            OptionalTerm::Time => {
                let memory = Correlation::new(Shape::Matern12, &[inputs.time()], &[MEMORY_S])?;
                Term::of(OTHER_VARIANCE, memory)?.times(Correlation::of_labels(&[inputs.water()])?)
            }
            OptionalTerm::OneWay => path(),
            OptionalTerm::Walls => {
                let ends = untied(self.shape, &Vec::from_iter(inputs.ends()))?;
                Term::of(OTHER_VARIANCE, ends)?.reciprocal(inputs.swap_ends()?)
            }
        }
    }
}

impl Default for Structure {
    /// Returns the structure with which learning starts: a reciprocal path term over link coordinates, and odds that
    /// decrease with range. Learning adds further terms as [`OptionalTerm`]s.
    fn default() -> Self {
        Self {
            shape: Shape::Matern32,
            path_inputs: PathInputs::Link,
            reciprocal: true,
            terms: Terms::Path,
            mean: MeanStructure::Range,
            additions: OptionalTerms::NONE,
        }
    }
}

impl Structure {
    /// Describes the structure in words: shape, path inputs, direction, terms and prior mean.
    pub fn parts(&self) -> [String; 5] {
        let inputs = match self.path_inputs {
            PathInputs::Raw => "raw positions",
            PathInputs::Link => "link coordinates",
        };
        let directions = match self.reciprocal {
            true if self.additions.has(OptionalTerm::OneWay) => "partly reciprocal",
            true => "reciprocal",
            false => "one-way",
        };
        let terms: Vec<String> = self.kernel_parts().map(|part| self.part_name(part)).collect();
        let mean = match self.mean {
            MeanStructure::Zero => "zero",
            MeanStructure::Constant => "constant",
            MeanStructure::Range => "range",
            MeanStructure::Conservative { .. } => "conservative range",
        };
        let mean = format!("{mean} mean");
        [self.shape.title().to_owned(), inputs.to_owned(), directions.to_owned(), terms.join(" + "), mean]
    }
}

impl fmt::Display for Structure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.parts().join(", "))
    }
}
