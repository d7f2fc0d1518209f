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

/// A kernel and prior mean without their numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Structure {
    /// How covariance falls with distance, in every term.
    pub shape: Shape,
    /// Columns of the path term.
    pub path_inputs: PathInputs,
    /// Whether both directions of a path behave alike.
    pub reciprocal: bool,
    /// What the latent function is a sum of.
    pub terms: Terms,
    /// The prior mean: what is expected before the first event.
    pub mean: MeanStructure,
}

/// Variance of the path term before anything is learned: log-odds of ±2 are ordinary.
const PATH_VARIANCE: f64 = 4.0;

/// The same of the receiver and range terms.
const OTHER_VARIANCE: f64 = 1.0;

/// Log-odds that a link loses over the chart's scale, before anything is learned.
const LOSS_OVER_SCALE: f64 = 2.0;

impl Structure {
    /// The prior before anything is learned, for a chart of this scale: what length-scales and slopes are measured
    /// against.
    ///
    /// # Errors
    /// [`dgpc::Error::OutOfRange`] for a scale that is not finite and positive, or a conservative range that is not
    /// finite.
    pub fn template(&self, inputs: InputSpec, scale_m: f64) -> dgpc::Result<Prior> {
        let term = |variance: f64, columns: Range<usize>, tied: bool| {
            let columns: Vec<usize> = columns.collect();
            let correlation = match tied {
                true => Correlation::isotropic(self.shape, &columns, scale_m),
                false => Correlation::new(self.shape, &columns, &vec![scale_m; columns.len()]),
            };
            Term::of(variance, correlation?)
        };
        let mut path = match self.path_inputs {
            PathInputs::Raw => term(PATH_VARIANCE, inputs.ends(), true)?,
            PathInputs::Link => term(PATH_VARIANCE, inputs.link_coordinates(), false)?,
        };
        if self.reciprocal {
            path = path.reciprocal(inputs.swap_ends()?)?;
        }
        let mut terms = vec![path];
        if self.terms == Terms::PathReceiverRange {
            terms.push(term(OTHER_VARIANCE, inputs.receiver(), true)?);
            terms.push(term(OTHER_VARIANCE, inputs.range()..inputs.range() + 1, true)?);
        }
        let range = |intercept, slope| inputs.range_mean(intercept, slope);
        let mean = match self.mean {
            MeanStructure::Zero => PriorMean::Zero,
            MeanStructure::Constant => PriorMean::Constant(0.0),
            MeanStructure::Range => range(LOSS_OVER_SCALE, LOSS_OVER_SCALE / scale_m)?,
            MeanStructure::Conservative { range_m, slope_per_m } => range(range_m * slope_per_m, slope_per_m)?,
        };
        Prior::new(Kernel::new(terms)?, mean)
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
    /// The structures that were best on field trials: with and without receiver and range terms.
    pub fn few(&self) -> Vec<Structure> {
        let structure = |terms| Structure {
            shape: self.shape.unwrap_or(Shape::Matern32),
            path_inputs: self.path_inputs.unwrap_or(PathInputs::Link),
            reciprocal: self.reciprocal.unwrap_or(true),
            terms,
            mean: self.mean.unwrap_or(MeanStructure::Zero),
        };
        match self.terms {
            Some(terms) => vec![structure(terms)],
            None => vec![structure(Terms::PathReceiverRange), structure(Terms::Path)],
        }
    }

    /// [`Given::few`] with every prior mean, then what differs from them in one part of the kernel, with a zero or a
    /// range mean.
    pub fn many(&self) -> Vec<Structure> {
        let means = |all: &[MeanStructure]| match self.mean {
            Some(given) => vec![given],
            None => all.to_vec(),
        };
        let with = |means: Vec<MeanStructure>, change: &dyn Fn(Structure) -> Structure| {
            let changed = self.few().into_iter().map(change);
            let all = changed.flat_map(|structure| {
                means.iter().map(move |&mean| Structure { mean, ..structure }).collect::<Vec<_>>()
            });
            all.collect::<Vec<_>>()
        };
        let mut all = with(means(&[MeanStructure::Zero, MeanStructure::Constant, MeanStructure::Range]), &|s| s);
        let two = || means(&[MeanStructure::Zero, MeanStructure::Range]);
        if self.shape.is_none() {
            all.extend(with(two(), &|s| Structure { shape: Shape::Matern52, ..s }));
            all.extend(with(two(), &|s| Structure { shape: Shape::SquaredExponential, ..s }));
        }
        if self.path_inputs.is_none() {
            all.extend(with(two(), &|s| Structure { path_inputs: PathInputs::Raw, ..s }));
        }
        if self.reciprocal.is_none() {
            all.extend(with(two(), &|s| Structure { reciprocal: false, ..s }));
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
        let terms = match self.terms {
            Terms::Path => "path",
            Terms::PathReceiverRange => "path + receiver + range",
        };
        let mean = match self.mean {
            MeanStructure::Zero => "zero",
            MeanStructure::Constant => "constant",
            MeanStructure::Range => "range",
            MeanStructure::Conservative { .. } => "conservative range",
        };
        let mean = format!("{mean} mean");
        [self.shape.title().to_owned(), inputs.to_owned(), direction.to_owned(), terms.to_owned(), mean]
    }
}

impl fmt::Display for Structure {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.parts().join(", "))
    }
}
