//! A model as a TOML text that a person can read and edit. Unknown keys are refused: a slip of the pen must not pass
//! for a default.

use std::sync::Arc;

use dgpc::{Kernel, Prior, PriorMean, Term};
use serde::{Deserialize, Serialize};

use crate::bounds::{self, Bounds};
use crate::chart::Chart;
use crate::event::Position;
use crate::fading::Fading;
use crate::model::{InputSpec, MODEL_SCHEMA, Model};
use crate::model_file_error::ModelFileError;
use crate::place_layout::PlaceLayout;
use crate::reference::{Geographic, ReferenceSystem};
use crate::term_layout::TermLayout;

/// What a model was learned from, and how well it did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// The event log.
    pub from: String,
    /// A digest of its events, in hexadecimal digits, by which it is known again under any name. Files of before have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_digest: Option<String>,
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
/// let file = ModelFile { model: Model::new(Chart::about([]), InputSpec::Positions, prior), learned: None, place_log_digests: Vec::new() };
/// assert_eq!(ModelFile::parse(&file.write()?)?, file);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// The model.
    pub model: Model,
    /// What it was learned from; nothing for a model that a person wrote.
    pub learned: Option<Provenance>,
    /// Digests of the logs that its place was learned from, as [`Provenance::log_digest`].
    pub place_log_digests: Vec<String>,
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
        let Layout { schema, depths, chart, prior_mean, fading, kernel, learned, place } = read(text)?;
        let inputs = if depths { InputSpec::PositionsAndDepths } else { InputSpec::Positions };
        let terms =
            kernel.into_iter().enumerate().map(|(n, term)| term.read(n + 1, inputs)).collect::<Result<_, _>>()?;
        let prior = Prior::new(Kernel::new(terms)?, prior_mean.read(inputs)?)?;
        let fading = fading.unwrap_or_default();
        for (key, value, bounds) in fading.entries() {
            checked(key, bounds, value)?;
        }
        let mut model = Model { schema, chart: chart.read()?, inputs, prior, place: None, fading };
        model.place = place.as_ref().map(|place| place.read(&model)).transpose()?.map(Arc::new);
        let place_log_digests = place.map(|place| place.log_digests).unwrap_or_default();
        Ok(Self { model, learned, place_log_digests })
    }

    /// The text, which [`ModelFile::parse`] reads back to the same model.
    ///
    /// # Errors
    /// [`ModelFileError::Unwritable`] for a model that no file can say.
    pub fn write(&self) -> Result<String, ModelFileError> {
        let Model { schema, chart, inputs, prior, place, fading } = &self.model;
        let layout = Layout {
            schema: *schema,
            depths: inputs.has_depths(),
            chart: ChartLayout::write(chart),
            prior_mean: MeanLayout::write(prior.mean()),
            fading: Some(*fading),
            kernel: prior.kernel().terms().iter().map(|term| TermLayout::write(term, *inputs)).collect(),
            learned: self.learned.clone(),
            place: place.as_deref().map(|place| PlaceLayout::write(place, &self.place_log_digests)),
        };
        let unwritable = |problem: &dyn std::fmt::Display| ModelFileError::Unwritable(problem.to_string());
        let text = HEAD.to_owned() + &toml::to_string(&layout).map_err(|error| unwritable(&error))?;
        let again = Self::parse(&text).map_err(|error| unwritable(&error))?;
        let ties = |file: &Self| file.model.prior.kernel().terms().iter().map(ties).collect::<Vec<_>>();
        if again != *self || ties(&again) != ties(self) {
            return Err(unwritable(&"something is lost in it"));
        }
        Ok(text)
    }
}

/// Which length-scales of a term are one when they are learned, which its equality does not look at.
fn ties(term: &Term) -> Vec<Vec<usize>> {
    term.correlations().iter().map(|correlation| correlation.ties().to_vec()).collect()
}

const HEAD: &str = "\
# A model of how links behave: what pingmap reads links with. Lengths are in metres, which are counted from latitude_deg, longitude_deg
# or are those of the system with the number epsg, if [chart] says so.
# Columns of a link: tx_east, tx_north, rx_east, rx_north (both ends about the chart's origin, and ..._depth with depths = true),
# u_... = (tx + rx)/sqrt(2), v_... = (tx - rx)/sqrt(2), range. One length-scale is for all columns of a term, a list has one for each;
# ties numbers those of a list that stay equal when they are learned. The column time has length_scale_s; tx_vehicle, rx_vehicle, kind
# and water are labels (shape = \"label\", no length-scale): every vehicle (and kind of message) has an offset of its own, a typical one none.
# prior_mean: kind = \"zero\", \"constant\" (log_odds) or \"range\" (log-odds = intercept - slope_per_m * range).
# fading: outcomes of one pair of vehicles that lie still (slower than drift_m_per_s) are alike by correlation * exp(-t/memory_s) after
# t seconds, beyond what the place explains, and count the less for it; correlation = 0: all count in full.
# place, if there: what earlier missions learned of it. links: tx east, north, rx east, north (depth after each north), in the
# metres of the log; of these the whitened precision (lower triangle) and shift.

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
    /// Files of before schema 4 have none.
    fading: Option<Fading>,
    kernel: Vec<TermLayout>,
    learned: Option<Provenance>,
    place: Option<PlaceLayout>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ChartLayout {
    origin_east_m: f64,
    origin_north_m: f64,
    scale_m: f64,
    latitude_deg: Option<f64>,
    longitude_deg: Option<f64>,
    epsg: Option<u32>,
}

impl ChartLayout {
    fn write(chart: &Chart) -> Self {
        let (place, epsg) = match chart.reference {
            ReferenceSystem::Unknown => (None, None),
            ReferenceSystem::About(place) => (Some(place), None),
            ReferenceSystem::Epsg(code) => (None, Some(code)),
        };
        Self {
            origin_east_m: chart.origin.east_m,
            origin_north_m: chart.origin.north_m,
            scale_m: chart.scale_m,
            latitude_deg: place.map(|place| place.latitude_deg),
            longitude_deg: place.map(|place| place.longitude_deg),
            epsg,
        }
    }

    fn read(&self) -> Result<Chart, ModelFileError> {
        let origin = Position::new(
            checked("origin_east_m", bounds::COORDINATE_M, self.origin_east_m)?,
            checked("origin_north_m", bounds::COORDINATE_M, self.origin_north_m)?,
        );
        let scale_m = checked("scale_m", bounds::LENGTH_M, self.scale_m)?;
        let reference = match (self.latitude_deg, self.longitude_deg, self.epsg) {
            (Some(latitude_deg), Some(longitude_deg), None) => ReferenceSystem::About(Geographic {
                latitude_deg: checked("latitude_deg", bounds::LATITUDE_DEG, latitude_deg)?,
                longitude_deg: checked("longitude_deg", bounds::LONGITUDE_DEG, longitude_deg)?,
            }),
            (None, None, Some(code)) => ReferenceSystem::Epsg(code),
            (None, None, None) => ReferenceSystem::Unknown,
            (Some(_), Some(_), Some(_)) => return Err(ModelFileError::TwoPlaces),
            _ => return Err(ModelFileError::HalfAPlace),
        };
        Ok(Chart { origin, scale_m, reference })
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
