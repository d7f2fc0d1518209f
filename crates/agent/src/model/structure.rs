//! Structures: the terms of the kernel and the form of the prior mean, without their parameters.

use std::fmt;
use std::ops::Range;

use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};

use crate::model::link_model::InputSpec;

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
const CONSERVATIVE_LOSS: f64 = 4.0;

impl MeanStructure {
    /// Returns a prior mean with even odds at `range_m` metres. Log-odds decrease by `slope_per_m` per metre, by
    /// default by four over the range.
    pub fn conservative(range_m: f64, slope_per_m: Option<f64>) -> Self {
        Self::Conservative { range_m, slope_per_m: slope_per_m.unwrap_or(CONSERVATIVE_LOSS / range_m) }
    }
}

/// A term of the latent function that learning may add to the basic terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionalTerm {
    /// Loss over the range as a smooth curve. The prior mean has only a line.
    Range,
    /// Offset of every receiver, because sensitivities differ.
    Receivers,
    /// Offset of every transmitter, because source levels differ.
    Transmitters,
    /// Slow changes of the water with time, equal at all positions.
    Time,
    /// Offset of every message kind. For example, higher rates are harder to decode.
    Kinds,
    /// Noise at the position of the receiver.
    ReceiverPlace,
    /// Loss over the range as a rough curve with steps and peaks: Matérn 1/2 instead of the structure's shape.
    RoughRange,
    /// Second path term over raw positions, with separate length-scales east and north. It models walls and quays.
    Walls,
}

impl OptionalTerm {
    /// All optional terms, in the order in which learning tries them.
    pub const ALL: [OptionalTerm; 8] = [
        OptionalTerm::Range,
        OptionalTerm::ReceiverPlace,
        OptionalTerm::Kinds,
        OptionalTerm::Receivers,
        OptionalTerm::Transmitters,
        OptionalTerm::Time,
        OptionalTerm::RoughRange,
        OptionalTerm::Walls,
    ];

    /// Returns true if the term is common to links in all waters. Leave-one-out predictions alone then decide about it.
    pub const fn is_common(self) -> bool {
        matches!(self, OptionalTerm::Range | OptionalTerm::ReceiverPlace)
    }

    /// Returns the name of the term in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            OptionalTerm::Range => "range",
            OptionalTerm::Receivers => "receivers",
            OptionalTerm::Transmitters => "transmitters",
            OptionalTerm::Time => "time",
            OptionalTerm::Kinds => "kinds",
            OptionalTerm::ReceiverPlace => "receiver-place",
            OptionalTerm::RoughRange => "rough-range",
            OptionalTerm::Walls => "walls",
        }
    }
}

/// A set of optional terms, stored as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OptionalTerms(u8);

impl OptionalTerms {
    /// Empty set.
    pub const NONE: OptionalTerms = OptionalTerms(0);

    /// Returns true if the set contains this term.
    pub fn has(self, addition: OptionalTerm) -> bool {
        self.0 & (1 << addition as u8) != 0
    }

    /// Returns the set with this term added.
    #[must_use]
    pub fn with(self, addition: OptionalTerm) -> Self {
        Self(self.0 | 1 << addition as u8)
    }

    /// Returns the terms of the set, in the order of [`OptionalTerm::ALL`].
    pub fn iter(self) -> impl Iterator<Item = OptionalTerm> {
        OptionalTerm::ALL.into_iter().filter(move |&addition| self.has(addition))
    }
}

impl FromIterator<OptionalTerm> for OptionalTerms {
    fn from_iter<I: IntoIterator<Item = OptionalTerm>>(additions: I) -> Self {
        additions.into_iter().fold(Self::NONE, Self::with)
    }
}

/// The structure of a model: its kernel and prior mean without their parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Structure {
    /// Shape of the covariance as a function of distance, in every term over positions.
    pub shape: Shape,
    /// Columns of the path term.
    pub path_inputs: PathInputs,
    /// True if both directions of a path have equal path terms.
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

/// Length-scale of the time term before learning, in seconds.
const MEMORY_S: f64 = 1800.0;

/// Log-odds at range zero before learning.
const LOG_ODDS_NEAR: f64 = 3.0;

/// Decrease of the log-odds over the scale of the chart before learning.
const LOSS_OVER_SCALE: f64 = 4.0;

/// A term of the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// Path between the ends.
    Path,
    /// Another term. A rough range is no term of its own: it changes the range term.
    Other(OptionalTerm),
}

impl Part {
    /// Returns the kernel term of an optional term. Returns `None` for an optional term that only changes another term.
    fn from_addition(addition: OptionalTerm) -> Option<Self> {
        (addition != OptionalTerm::RoughRange).then_some(Part::Other(addition))
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
    /// The structure must not contain the term yet. A rough range also needs a range term.
    pub fn can_have(&self, addition: OptionalTerm) -> bool {
        match Part::from_addition(addition) {
            Some(part) => self.kernel_parts().all(|own| own != part),
            None => {
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
        let tied = |shape, columns: Range<usize>| Correlation::isotropic(shape, &Vec::from_iter(columns), scale_m);
        let untied = |shape, columns: Range<usize>| {
            Correlation::new(shape, &Vec::from_iter(columns.clone()), &vec![scale_m; columns.len()])
        };
        let rough = if self.additions.has(OptionalTerm::RoughRange) { Shape::Matern12 } else { self.shape };
        let label = |column| Term::of(OTHER_VARIANCE, Correlation::of_labels(&[column])?);
        let Part::Other(other) = part else {
            let correlation = match self.path_inputs {
                PathInputs::Raw => tied(self.shape, inputs.ends())?,
                PathInputs::Link => untied(self.shape, inputs.link_coordinates())?,
            };
            let path = Term::of(PATH_VARIANCE, correlation)?;
            return if self.reciprocal { path.reciprocal(inputs.swap_ends()?) } else { Ok(path) };
        };
        match other {
            OptionalTerm::ReceiverPlace => Term::of(OTHER_VARIANCE, tied(self.shape, inputs.receiver())?),
            OptionalTerm::Range | OptionalTerm::RoughRange => {
                Term::of(OTHER_VARIANCE, tied(rough, inputs.range()..inputs.range() + 1)?)
            }
            OptionalTerm::Receivers => label(inputs.receiving_vehicle()),
            OptionalTerm::Transmitters => label(inputs.transmitting_vehicle()),
            OptionalTerm::Kinds => label(inputs.kind()),
            OptionalTerm::Time => {
                let memory = Correlation::new(Shape::Matern12, &[inputs.time()], &[MEMORY_S])?;
                Term::of(OTHER_VARIANCE, memory)?.times(Correlation::of_labels(&[inputs.water()])?)
            }
            OptionalTerm::Walls => {
                Term::of(OTHER_VARIANCE, untied(self.shape, inputs.ends())?)?.reciprocal(inputs.swap_ends()?)
            }
        }
    }
}

/// The parts of a structure that the user fixes. A part that is `None` may differ among candidates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StructureConstraints {
    /// Shape of the covariance as a function of distance.
    pub shape: Option<Shape>,
    /// Columns of the path term.
    pub path_inputs: Option<PathInputs>,
    /// True if both directions of a path have equal path terms.
    pub reciprocal: Option<bool>,
    /// Basic terms of the latent function.
    pub terms: Option<Terms>,
    /// Form of the prior mean.
    pub mean: Option<MeanStructure>,
}

impl StructureConstraints {
    /// Returns the structure with which learning starts.
    ///
    /// Unless fixed otherwise, it has a reciprocal path term over link coordinates and odds that decrease with range.
    /// Learning adds further terms as [`OptionalTerm`]s.
    pub fn default_candidates(&self) -> Vec<Structure> {
        let structure = |terms| Structure {
            shape: self.shape.unwrap_or(Shape::Matern32),
            path_inputs: self.path_inputs.unwrap_or(PathInputs::Link),
            reciprocal: self.reciprocal.unwrap_or(true),
            terms,
            mean: self.mean.unwrap_or(MeanStructure::Range),
            additions: OptionalTerms::NONE,
        };
        vec![structure(self.terms.unwrap_or(Terms::Path))]
    }

    /// Returns [`StructureConstraints::default_candidates`], followed by all structures that differ from them in one
    /// part of the kernel.
    pub fn all_candidates(&self) -> Vec<Structure> {
        let default = self.default_candidates();
        let mut all = default.clone();
        let mut changed = |change: &dyn Fn(Structure) -> Structure| all.extend(default.iter().copied().map(change));
        if self.shape.is_none() {
            changed(&|structure| Structure { shape: Shape::Matern52, ..structure });
            changed(&|structure| Structure { shape: Shape::SquaredExponential, ..structure });
        }
        if self.path_inputs.is_none() {
            changed(&|structure| Structure { path_inputs: PathInputs::Raw, ..structure });
        }
        if self.reciprocal.is_none() {
            changed(&|structure| Structure { reciprocal: false, ..structure });
        }
        all
    }
}

impl Structure {
    /// Describes the structure in words: shape, path inputs, direction, terms and prior mean.
    pub fn parts(&self) -> [String; 5] {
        let inputs = match self.path_inputs {
            PathInputs::Raw => "raw positions",
            PathInputs::Link => "link coordinates",
        };
        let direction = if self.reciprocal { "reciprocal" } else { "one-way" };
        let terms: Vec<String> = self.kernel_parts().map(|part| self.part_name(part)).collect();
        let mean = match self.mean {
            MeanStructure::Zero => "zero",
            MeanStructure::Constant => "constant",
            MeanStructure::Range => "range",
            MeanStructure::Conservative { .. } => "conservative range",
        };
        let mean = format!("{mean} mean");
        [self.shape.title().to_owned(), inputs.to_owned(), direction.to_owned(), terms.join(" + "), mean]
    }
}

impl fmt::Display for Structure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.parts().join(", "))
    }
}
