//! A model as a TOML text that a person can read and edit. Unknown keys are refused: a slip of the pen must not pass
//! for a default.

use dgpc::{Correlation, Kernel, Prior, PriorMean, Shape, Term};
use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};
use crate::chart::{Chart, Geographic};
use crate::event::Position;
use crate::model::{InputSpec, MODEL_SCHEMA, Model};

/// Why a text is not a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelFileError {
    /// Not TOML, or a key that is unknown, missing or of the wrong kind.
    #[error("{0}")]
    Syntax(String),
    /// Written by a newer version of this software.
    #[error("schema {found}, but this version reads schema {MODEL_SCHEMA}; it was written by a newer version")]
    Newer {
        /// The schema of the text.
        found: u32,
    },
    /// A term names a column that links do not have.
    #[error("kernel term {term}: unknown column {column:?}; expected one of {known}")]
    UnknownColumn {
        /// The number of the term, from 1.
        term: usize,
        /// The name.
        column: String,
        /// The names that there are.
        known: String,
    },
    /// A term has another number of length-scales than columns.
    #[error("kernel term {term}: {found} length-scales for {expected} columns; expected one for all or one for each")]
    LengthScales {
        /// The number of the term, from 1.
        term: usize,
        /// How many columns there are.
        expected: usize,
        /// How many length-scales.
        found: usize,
    },
    /// A reciprocal term that would not be the same after swapping the ends.
    #[error(
        "kernel term {term}: reciprocal, but swapping the ends exchanges {column} ({length_scale} m) with {partner} ({})",
        partner_length_scale.map_or_else(|| "not among its columns".to_owned(), |length_scale| format!("{length_scale} m"))
    )]
    NotReciprocal {
        /// The number of the term, from 1.
        term: usize,
        /// A column of the term.
        column: String,
        /// The column it is exchanged with.
        partner: String,
        /// The length-scale of the one, in metres.
        length_scale: f64,
        /// That of the other; `None` where it is not among the term's columns.
        partner_length_scale: Option<f64>,
    },
    /// The numbers of a term make no kernel.
    #[error("kernel term {term}: {source}")]
    Term {
        /// The number of the term, from 1.
        term: usize,
        /// Why.
        source: dgpc::Error,
    },
    /// There is no kernel term, or the prior mean makes no sense.
    #[error(transparent)]
    Prior(#[from] dgpc::Error),
    /// A number outside its domain.
    #[error("{key} must be {expected}, found {value}")]
    OutOfRange {
        /// The key.
        key: &'static str,
        /// The domain.
        expected: Bounds,
        /// The number.
        value: f64,
    },
    /// Latitude without longitude, or the other way round.
    #[error("chart: latitude_deg and longitude_deg go together")]
    HalfAPlace,
}

/// What a model was learned from, and how well it did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The event log.
    pub from: String,
    /// The structure, in words.
    pub structure: String,
    /// How many events the log has.
    pub events: usize,
    /// How many of them were used.
    pub events_used: usize,
    /// E at the optimum, in nats.
    pub evidence: f64,
    /// Mean leave-one-out log predictive probability of an event, in nats.
    pub leave_one_out: f64,
    /// What all variances were multiplied by after E was maximised.
    pub variance_factor: f64,
    /// Why the search ended.
    pub stop: String,
}

/// A model and what it was learned from, as it stands in a file.
///
/// ```
/// use pingmap_agent::{Chart, InputSpec, Learning, Model, ModelFile};
///
/// let learning = Learning::default();
/// let prior = learning.template(&learning.structures[0], InputSpec::Positions, 490.0)?;
/// let file = ModelFile { model: Model::new(Chart::about([]), InputSpec::Positions, prior), learned: None };
/// assert_eq!(ModelFile::parse(&file.to_toml()).expect("its own text"), file);
/// # Ok::<(), dgpc::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// The model.
    pub model: Model,
    /// What it was learned from; nothing for a model that a person wrote.
    pub learned: Option<Provenance>,
}

impl ModelFile {
    /// Reads a model.
    ///
    /// # Errors
    /// [`ModelFileError`] with what was found and what was expected.
    pub fn parse(text: &str) -> Result<Self, ModelFileError> {
        let version: Version = read(text)?;
        if version.schema > MODEL_SCHEMA {
            return Err(ModelFileError::Newer { found: version.schema });
        }
        let Layout { schema, depths, chart, prior_mean, kernel, learned } = read(text)?;
        let inputs = if depths { InputSpec::PositionsAndDepths } else { InputSpec::Positions };
        let terms =
            kernel.into_iter().enumerate().map(|(n, term)| term.read(n + 1, inputs)).collect::<Result<_, _>>()?;
        let prior = Prior::new(Kernel::new(terms)?, prior_mean.read(inputs)?)?;
        Ok(Self { model: Model { schema, chart: chart.read()?, inputs, prior }, learned })
    }

    /// The text, which [`ModelFile::parse`] reads back to the same model.
    pub fn to_toml(&self) -> String {
        let Model { schema, chart, inputs, prior } = &self.model;
        let layout = Layout {
            schema: *schema,
            depths: inputs.has_depths(),
            chart: ChartLayout::write(chart),
            prior_mean: MeanLayout::write(prior.mean()),
            kernel: prior.kernel().terms().iter().map(|term| TermLayout::write(term, *inputs)).collect(),
            learned: self.learned.clone(),
        };
        // Nothing in the layout can fail to be written: tables of numbers, texts and lists of them.
        HEAD.to_owned() + &toml::to_string(&layout).unwrap_or_default()
    }
}

const HEAD: &str = "\
# A model of how links behave: what pingmap reads links with. Lengths are in metres.
# Columns of a link: tx_east, tx_north, rx_east, rx_north (both ends about the chart's origin, and ..._depth with depths = true),
# u_... = (tx + rx)/sqrt(2), v_... = (tx - rx)/sqrt(2), range. One length-scale is for all columns of a term, a list has one for each.
# prior_mean: kind = \"zero\", \"constant\" (log_odds) or \"range\" (log-odds = intercept - slope_per_m * range).

";

fn read<'a, T: Deserialize<'a>>(text: &'a str) -> Result<T, ModelFileError> {
    toml::from_str(text).map_err(|error| ModelFileError::Syntax(error.to_string().trim_end().to_owned()))
}

/// What is read first, so that a newer file is called newer and not misspelt.
#[derive(Deserialize)]
struct Version {
    schema: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Layout {
    schema: u32,
    #[serde(default)]
    depths: bool,
    chart: ChartLayout,
    prior_mean: MeanLayout,
    kernel: Vec<TermLayout>,
    learned: Option<Provenance>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChartLayout {
    origin_east_m: f64,
    origin_north_m: f64,
    scale_m: f64,
    latitude_deg: Option<f64>,
    longitude_deg: Option<f64>,
}

impl ChartLayout {
    fn write(chart: &Chart) -> Self {
        Self {
            origin_east_m: chart.origin.east_m,
            origin_north_m: chart.origin.north_m,
            scale_m: chart.scale_m,
            latitude_deg: chart.geographic.map(|place| place.latitude_deg),
            longitude_deg: chart.geographic.map(|place| place.longitude_deg),
        }
    }

    fn read(&self) -> Result<Chart, ModelFileError> {
        let origin = Position::new(
            checked("origin_east_m", bounds::COORDINATE_M, self.origin_east_m)?,
            checked("origin_north_m", bounds::COORDINATE_M, self.origin_north_m)?,
        );
        let scale_m = checked("scale_m", bounds::LENGTH_M, self.scale_m)?;
        let geographic = match (self.latitude_deg, self.longitude_deg) {
            (Some(latitude_deg), Some(longitude_deg)) => Some(Geographic {
                latitude_deg: checked("latitude_deg", bounds::LATITUDE_DEG, latitude_deg)?,
                longitude_deg: checked("longitude_deg", bounds::LONGITUDE_DEG, longitude_deg)?,
            }),
            (None, None) => None,
            _ => return Err(ModelFileError::HalfAPlace),
        };
        Ok(Chart { origin, scale_m, geographic })
    }
}

#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
enum MeanLayout {
    Zero {},
    Constant { log_odds: f64 },
    Range { intercept: f64, slope_per_m: f64 },
}

impl MeanLayout {
    fn write(mean: &PriorMean) -> Self {
        match mean {
            PriorMean::Constant(log_odds) => Self::Constant { log_odds: *log_odds },
            PriorMean::Range(range) => Self::Range { intercept: range.intercept(), slope_per_m: range.slope() },
            _ => Self::Zero {},
        }
    }

    fn read(&self, inputs: InputSpec) -> Result<PriorMean, ModelFileError> {
        match *self {
            Self::Zero {} => Ok(PriorMean::Zero),
            Self::Constant { log_odds } => {
                checked("prior_mean.log_odds", bounds::LOG_ODDS, log_odds).map(PriorMean::Constant)
            }
            Self::Range { intercept, slope_per_m } => {
                let intercept = checked("prior_mean.intercept", bounds::LOG_ODDS, intercept)?;
                let slope_per_m = checked("prior_mean.slope_per_m", bounds::LOG_ODDS, slope_per_m)?;
                Ok(inputs.range_mean(intercept, slope_per_m)?)
            }
        }
    }
}

fn checked(key: &'static str, bounds: Bounds, value: f64) -> Result<f64, ModelFileError> {
    bounds.check(value).ok_or(ModelFileError::OutOfRange { key, expected: bounds, value })
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TermLayout {
    #[serde(with = "shape_name")]
    shape: Shape,
    variance: f64,
    columns: Vec<String>,
    length_scale_m: LengthScales,
    #[serde(default)]
    reciprocal: bool,
    /// Further correlations that the first one is multiplied by.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    times: Vec<CorrelationLayout>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CorrelationLayout {
    #[serde(with = "shape_name")]
    shape: Shape,
    columns: Vec<String>,
    length_scale_m: LengthScales,
}

/// A shape as its name.
mod shape_name {
    use dgpc::Shape;
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    pub(super) fn serialize<S: Serializer>(shape: &Shape, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(shape)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Shape, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

/// One for all columns, or one for each.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum LengthScales {
    Tied(f64),
    Each(Vec<f64>),
}

impl CorrelationLayout {
    fn write(correlation: &Correlation, names: &[String]) -> Self {
        let length_scale_m = match correlation.length_scales() {
            [first, ..] if correlation.ties().iter().all(|&tie| tie == 0) => LengthScales::Tied(*first),
            each => LengthScales::Each(each.to_vec()),
        };
        // A column that links do not have is named all the same, so that reading refuses it.
        let name = |&column: &usize| names.get(column).cloned().unwrap_or_else(|| format!("column {column}"));
        let columns = correlation.columns().iter().map(name).collect();
        Self { shape: correlation.shape(), columns, length_scale_m }
    }

    fn read(&self, term: usize, names: &[String]) -> Result<Correlation, ModelFileError> {
        let column = |name: &String| {
            names.iter().position(|known| known == name).ok_or_else(|| ModelFileError::UnknownColumn {
                term,
                column: name.clone(),
                known: names.join(", "),
            })
        };
        let columns = self.columns.iter().map(column).collect::<Result<Vec<_>, _>>()?;
        let correlation = match &self.length_scale_m {
            LengthScales::Tied(length_scale) => {
                in_term(term, "length-scale", *length_scale)?;
                Correlation::isotropic(self.shape, &columns, *length_scale)
            }
            LengthScales::Each(each) if each.len() != columns.len() => {
                let (expected, found) = (columns.len(), each.len());
                return Err(ModelFileError::LengthScales { term, expected, found });
            }
            LengthScales::Each(each) => {
                each.iter().try_for_each(|&length_scale| in_term(term, "length-scale", length_scale))?;
                Correlation::new(self.shape, &columns, each)
            }
        };
        correlation.map_err(|source| ModelFileError::Term { term, source })
    }
}

/// Checks a variance or length-scale.
fn in_term(term: usize, what: &'static str, value: f64) -> Result<(), ModelFileError> {
    let Bounds { words, .. } = bounds::KERNEL_NUMBER;
    match bounds::KERNEL_NUMBER.check(value) {
        Some(_) => Ok(()),
        None => Err(ModelFileError::Term { term, source: dgpc::Error::OutOfRange { what, expected: words, value } }),
    }
}

impl TermLayout {
    fn write(term: &Term, inputs: InputSpec) -> Self {
        let names = inputs.column_names();
        let mut layouts = term.correlations().iter().map(|correlation| CorrelationLayout::write(correlation, &names));
        // A term has at least one.
        let first = layouts.next();
        let times = layouts.collect();
        let (shape, columns, length_scale_m) = match first {
            Some(CorrelationLayout { shape, columns, length_scale_m }) => (shape, columns, length_scale_m),
            None => (Shape::Matern32, Vec::new(), LengthScales::Each(Vec::new())),
        };
        let (variance, reciprocal) = (term.variance(), term.is_reciprocal());
        Self { shape, variance, columns, length_scale_m, reciprocal, times }
    }

    fn read(self, number: usize, inputs: InputSpec) -> Result<Term, ModelFileError> {
        let names = inputs.column_names();
        let Self { shape, variance, columns, length_scale_m, reciprocal, times } = self;
        in_term(number, "kernel variance", variance)?;
        let failed = |source| ModelFileError::Term { term: number, source };
        let first = CorrelationLayout { shape, columns, length_scale_m }.read(number, &names)?;
        let mut term = Term::of(variance, first).map_err(failed)?;
        for layout in times {
            term = term.times(layout.read(number, &names)?).map_err(failed)?;
        }
        if !reciprocal {
            return Ok(term);
        }
        inputs.swap_ends().and_then(|swap| term.reciprocal(swap)).map_err(|error| match error {
            dgpc::Error::NotReciprocal { column, partner, length_scale, partner_length_scale } => {
                let (column, partner) = (names[column].clone(), names[partner].clone());
                ModelFileError::NotReciprocal { term: number, column, partner, length_scale, partner_length_scale }
            }
            other => failed(other),
        })
    }
}
