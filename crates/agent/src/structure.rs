//! Which kernel and prior mean a link is read with, before their numbers are learned.

use std::fmt;
use std::ops::Range;

use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};

use crate::model::InputSpec;

/// Over which columns the path term measures distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PathInputs {
    /// The raw positions of both ends, one length-scale for all.
    Raw,
    /// Link coordinates, one length-scale for each: where the link lies, and which way and how far it reaches.
    Link,
}

/// What the latent function is a sum of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Terms {
    /// The path between the ends.
    Path,
    /// The path, noise at the receiver, and loss over the range.
    PathReceiverRange,
}

/// The prior mean: what is expected before the first event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MeanStructure {
    /// Even odds.
    Zero,
    /// The same odds everywhere.
    Constant,
    /// Odds that fall with range.
    Range,
    /// Even odds at a range that people trust, and log-odds that fall so much per metre.
    Conservative {
        /// Where the odds are even, in metres.
        range_m: f64,
        /// Log-odds lost per metre.
        slope_per_m: f64,
    },
}

/// Log-odds that a conservative prior loses from range zero to its range.
const CONSERVATIVE_LOSS: f64 = 4.0;

impl MeanStructure {
    /// Even odds at a range that people trust, falling with range by so many log-odds a metre; four over the range if
    /// not given.
    pub fn conservative(range_m: f64, slope_per_m: Option<f64>) -> Self {
        Self::Conservative { range_m, slope_per_m: slope_per_m.unwrap_or(CONSERVATIVE_LOSS / range_m) }
    }
}

/// A part that the latent function may have beside what a structure begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Addition {
    /// Loss over the range as a curve, where the prior mean has a line.
    Range,
    /// An offset of every receiver: ears differ.
    Receivers,
    /// An offset of every transmitter: voices differ.
    Transmitters,
    /// Water that changes slowly, everywhere alike.
    Time,
    /// An offset of every kind of message: a faster one is harder to hear.
    Kinds,
    /// Noise at the place of the receiver.
    ReceiverPlace,
    /// Loss over the range as a curve with steps and teeth: Matérn 1/2.
    RoughRange,
    /// A second path term over the raw ends, with a length-scale east and one north: walls and quays.
    Walls,
}

impl Addition {
    /// All, in the order in which they are tried.
    pub const ALL: [Addition; 8] = [
        Addition::Range,
        Addition::ReceiverPlace,
        Addition::Kinds,
        Addition::Receivers,
        Addition::Transmitters,
        Addition::Time,
        Addition::RoughRange,
        Addition::Walls,
    ];

    /// Whether it is part of what links are like in any water, so that leave-one-out predictions alone decide about it.
    pub const fn is_ordinary(self) -> bool {
        matches!(self, Addition::Range | Addition::ReceiverPlace)
    }

    /// What it is called in files and on command lines.
    pub const fn name(self) -> &'static str {
        match self {
            Addition::Range => "range",
            Addition::Receivers => "receivers",
            Addition::Transmitters => "transmitters",
            Addition::Time => "time",
            Addition::Kinds => "kinds",
            Addition::ReceiverPlace => "receiver-place",
            Addition::RoughRange => "rough-range",
            Addition::Walls => "walls",
        }
    }
}

/// A set of additions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Additions(u8);

impl Additions {
    /// None.
    pub const NONE: Additions = Additions(0);

    /// Whether this one is in it.
    pub fn has(self, addition: Addition) -> bool {
        self.0 & (1 << addition as u8) != 0
    }

    /// The set with one more.
    #[must_use]
    pub fn with(self, addition: Addition) -> Self {
        Self(self.0 | 1 << addition as u8)
    }

    /// Its members, in the order of [`Addition::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Addition> {
        Addition::ALL.into_iter().filter(move |&addition| self.has(addition))
    }
}

impl FromIterator<Addition> for Additions {
    fn from_iter<I: IntoIterator<Item = Addition>>(additions: I) -> Self {
        additions.into_iter().fold(Self::NONE, Self::with)
    }
}

/// A kernel and prior mean without their numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Structure {
    /// How covariance falls with distance, in every term over places.
    pub shape: Shape,
    /// Columns of the path term.
    pub path_inputs: PathInputs,
    /// Whether both directions of a path behave alike.
    pub reciprocal: bool,
    /// What the latent function is a sum of.
    pub terms: Terms,
    /// The prior mean: what is expected before the first event.
    pub mean: MeanStructure,
    /// What there is beside.
    pub additions: Additions,
}

/// Variance of the path term before anything is learned: log-odds of ±2 are ordinary.
const PATH_VARIANCE: f64 = 4.0;

/// The same of all other terms.
const OTHER_VARIANCE: f64 = 1.0;

/// How long the water remembers before anything is learned, in seconds.
const MEMORY_S: f64 = 1800.0;

/// Log-odds at range zero, and what a link loses of them over the chart's scale, before anything is learned.
const LOG_ODDS_NEAR: f64 = 3.0;
const LOSS_OVER_SCALE: f64 = 4.0;

/// The terms of a kernel by what they are about, in their order in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    Path,
    ReceiverPlace,
    Range,
    Receivers,
    Transmitters,
    Time,
    Kinds,
    Walls,
}

impl Part {
    /// The term that an addition is; none for what only changes another term.
    fn of(addition: Addition) -> Option<Self> {
        match addition {
            Addition::Range => Some(Part::Range),
            Addition::ReceiverPlace => Some(Part::ReceiverPlace),
            Addition::Receivers => Some(Part::Receivers),
            Addition::Transmitters => Some(Part::Transmitters),
            Addition::Time => Some(Part::Time),
            Addition::Kinds => Some(Part::Kinds),
            Addition::RoughRange => None,
            Addition::Walls => Some(Part::Walls),
        }
    }
}

impl Structure {
    /// The prior before anything is learned, for a chart of this scale: what length-scales and slopes are measured
    /// against.
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

    /// Whether this addition would change it: it is not in it, and there is something that it is about.
    pub fn can_have(&self, addition: Addition) -> bool {
        match Part::of(addition) {
            Some(part) => self.kernel_parts().all(|own| own != part),
            None => !self.additions.has(addition) && self.kernel_parts().any(|own| own == Part::Range),
        }
    }

    /// The same with an addition.
    #[must_use]
    pub fn with(&self, addition: Addition) -> Self {
        Self { additions: self.additions.with(addition), ..*self }
    }

    fn name_of(&self, part: Part) -> &'static str {
        match part {
            Part::Path => "path",
            Part::ReceiverPlace => "receiver place",
            Part::Range if self.additions.has(Addition::RoughRange) => "rough range",
            Part::Range => "range",
            Part::Receivers => "receivers",
            Part::Transmitters => "transmitters",
            Part::Time => "time",
            Part::Kinds => "kinds",
            Part::Walls => "walls",
        }
    }

    /// The kernel's terms.
    pub(crate) fn kernel_parts(&self) -> impl Iterator<Item = Part> {
        let places: &[Part] = match self.terms {
            Terms::Path => &[Part::Path],
            Terms::PathReceiverRange => &[Part::Path, Part::ReceiverPlace, Part::Range],
        };
        places.iter().copied().chain(self.additions.iter().filter_map(Part::of))
    }

    fn term(&self, part: Part, inputs: InputSpec, scale_m: f64) -> dgpc::Result<Term> {
        let tied = |shape, columns: Range<usize>| Correlation::isotropic(shape, &Vec::from_iter(columns), scale_m);
        let untied = |shape, columns: Range<usize>| {
            Correlation::new(shape, &Vec::from_iter(columns.clone()), &vec![scale_m; columns.len()])
        };
        let rough = if self.additions.has(Addition::RoughRange) { Shape::Matern12 } else { self.shape };
        let label = |column| Term::of(OTHER_VARIANCE, Correlation::of_labels(&[column])?);
        match part {
            Part::Path => {
                let correlation = match self.path_inputs {
                    PathInputs::Raw => tied(self.shape, inputs.ends())?,
                    PathInputs::Link => untied(self.shape, inputs.link_coordinates())?,
                };
                let path = Term::of(PATH_VARIANCE, correlation)?;
                if self.reciprocal { path.reciprocal(inputs.swap_ends()?) } else { Ok(path) }
            }
            Part::ReceiverPlace => Term::of(OTHER_VARIANCE, tied(self.shape, inputs.receiver())?),
            Part::Range => Term::of(OTHER_VARIANCE, tied(rough, inputs.range()..inputs.range() + 1)?),
            Part::Receivers => label(inputs.receiving_vehicle()),
            Part::Transmitters => label(inputs.transmitting_vehicle()),
            Part::Kinds => label(inputs.kind()),
            Part::Time => {
                let memory = Correlation::new(Shape::Matern12, &[inputs.time()], &[MEMORY_S])?;
                Term::of(OTHER_VARIANCE, memory)?.times(Correlation::of_labels(&[inputs.water()])?)
            }
            Part::Walls => {
                Term::of(OTHER_VARIANCE, untied(self.shape, inputs.ends())?)?.reciprocal(inputs.swap_ends()?)
            }
        }
    }
}

/// The parts of a structure that are given; the others are up to the data.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Given {
    /// How covariance falls with distance.
    pub shape: Option<Shape>,
    /// Columns of the path term.
    pub path_inputs: Option<PathInputs>,
    /// Whether both directions of a path behave alike.
    pub reciprocal: Option<bool>,
    /// What the latent function is a sum of.
    pub terms: Option<Terms>,
    /// What is expected before the first event.
    pub mean: Option<MeanStructure>,
}

impl Given {
    /// The structure that a search begins with if nothing is given: a reciprocal path over link coordinates, under odds
    /// that fall with range. What else there is to a water comes by [`Addition`]s.
    pub fn few(&self) -> Vec<Structure> {
        let structure = |terms| Structure {
            shape: self.shape.unwrap_or(Shape::Matern32),
            path_inputs: self.path_inputs.unwrap_or(PathInputs::Link),
            reciprocal: self.reciprocal.unwrap_or(true),
            terms,
            mean: self.mean.unwrap_or(MeanStructure::Range),
            additions: Additions::NONE,
        };
        vec![structure(self.terms.unwrap_or(Terms::Path))]
    }

    /// [`Given::few`], then what differs from it in one part of the kernel.
    pub fn many(&self) -> Vec<Structure> {
        let few = self.few();
        let mut all = few.clone();
        let mut changed = |change: &dyn Fn(Structure) -> Structure| all.extend(few.iter().copied().map(change));
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
    /// What it consists of, in words: shape, path inputs, direction, terms and prior mean.
    pub fn parts(&self) -> [String; 5] {
        let inputs = match self.path_inputs {
            PathInputs::Raw => "raw positions",
            PathInputs::Link => "link coordinates",
        };
        let direction = if self.reciprocal { "reciprocal" } else { "one-way" };
        let terms: Vec<&str> = self.kernel_parts().map(|part| self.name_of(part)).collect();
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
