//! The model file: a model as a TOML text that users can read and edit.
//!
//! Unknown keys are refused, so that a mistyped key does not silently yield a default.

use std::cmp::Ordering;
use std::sync::Arc;

use dgpc::{Kernel, Prior, PriorMean, Term};
use serde::{Deserialize, Serialize};

use crate::model::fading::Fading;
use crate::model::file::error::{ModelFileError, check_bounds};
use crate::model::file::site_prior::SitePriorLayout;
use crate::model::file::terms::TermLayout;
use crate::model::inputs::InputSpec;
use crate::model::link_model::{MODEL_SCHEMA, Model};
use crate::types::bounds;
use crate::types::chart::Chart;
use crate::types::event::Position;
use crate::types::reference_system::{Geographic, ReferenceSystem};

/// The data that a model was learned from, and the result of learning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Provenance {
    /// Name of the event log.
    pub from: String,
    /// Digest of the log's events, in hexadecimal digits. It identifies the log under any name. Older files have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log_digest: Option<String>,
    /// Structure, in words.
    pub structure: String,
    /// Number of events in the log.
    pub events: usize,
    /// Number of events that were used.
    pub events_used: usize,
    /// Lower bound E of the evidence at the optimum, in nats.
    pub evidence: f64,
    /// Mean leave-one-out log predictive probability of an event, in nats.
    pub leave_one_out: f64,
    /// Factor by which all variances were multiplied after E was maximized.
    pub variance_factor: f64,
    /// Reason for the end of the search.
    pub stop: String,
}

/// The content of a model file: a model and its provenance.
///
/// ```
/// use pingmap_agent::{Chart, InputSpec, Learning, Model, ModelFile};
///
/// let learning = Learning::default();
/// let prior = learning.template(&learning.structure, InputSpec::Positions, 490.0)?;
/// let model = Model::new(Chart::about([]), InputSpec::Positions, prior);
/// let file = ModelFile { model, learned: None, site_log_digests: Vec::new() };
/// assert_eq!(ModelFile::parse(&file.write()?)?, file);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFile {
    /// Model.
    pub model: Model,
    /// Provenance of a learned model. `None` for a model that a user wrote.
    pub learned: Option<Provenance>,
    /// Digests of the logs that the site prior was learned from, as in [`Provenance::log_digest`].
    pub site_log_digests: Vec<String>,
}

impl ModelFile {
    /// Parses the text of a model file.
    ///
    /// # Errors
    /// [`ModelFileError`] with the value that was found and the values that are valid.
    pub fn parse(text: &str) -> Result<Self, ModelFileError> {
        use ModelFileError::{Newer, Older, Syntax};
        let ModelLayout { schema, depths, chart, prior_mean, fading, kernel, learned, site_prior: site } =
            parse_versioned(text, MODEL_SCHEMA, Syntax, Newer, Older)?;
        let inputs = if depths { InputSpec::PositionsAndDepths } else { InputSpec::Positions };
        let terms =
            kernel.into_iter().enumerate().map(|(n, term)| term.read(n + 1, inputs)).collect::<Result<_, _>>()?;
        let prior = Prior::new(Kernel::new(terms)?, prior_mean.read(inputs)?)?;
        let fading = fading.unwrap_or_default();
        for (key, value, bounds) in fading.entries() {
            check_bounds(key, bounds, value)?;
        }
        let mut model = Model { schema, chart: chart.read()?, inputs, prior, site: None, fading };
        model.site = site.as_ref().map(|site| site.read(&model)).transpose()?.map(Arc::new);
        let site_log_digests = site.map(|site| site.log_digests).unwrap_or_default();
        Ok(Self { model, learned, site_log_digests })
    }

    /// Returns the text of the model file. [`ModelFile::parse`] returns an equal model from it.
    ///
    /// # Errors
    /// [`ModelFileError::Unwritable`] for a model that cannot be represented in a file.
    pub fn write(&self) -> Result<String, ModelFileError> {
        let Model { schema, chart, inputs, prior, site, fading } = &self.model;
        let layout = ModelLayout {
            schema: *schema,
            depths: inputs.has_depths(),
            chart: ChartLayout::write(chart),
            prior_mean: MeanLayout::write(prior.mean()),
            fading: Some(*fading),
            kernel: prior.kernel().terms().iter().map(|term| TermLayout::write(term, *inputs)).collect(),
            learned: self.learned.clone(),
            site_prior: site.as_deref().map(|site| SitePriorLayout::write(site, &self.site_log_digests)),
        };
        let unwritable = |problem: &dyn std::fmt::Display| ModelFileError::Unwritable(problem.to_string());
        let text = HEAD.to_owned() + &toml::to_string(&layout).map_err(|error| unwritable(&error))?;
        let parsed = Self::parse(&text).map_err(|error| unwritable(&error))?;
        let ties = |file: &Self| file.model.prior.kernel().terms().iter().map(term_ties).collect::<Vec<_>>();
        if parsed != *self || ties(&parsed) != ties(self) {
            return Err(unwritable(&"the text would represent another model"));
        }
        Ok(text)
    }
}

/// Returns the ties of a term's length-scales: columns with equal numbers share one learned length-scale.
///
/// Equality of terms ignores ties.
fn term_ties(term: &Term) -> Vec<Vec<usize>> {
    term.correlations().iter().map(|correlation| correlation.ties().to_vec()).collect()
}

/// Comment at the head of every model file, which explains its keys.
const HEAD: &str = "\
# A model of how links behave: the kernel and prior mean that pingmap uses. Lengths are in metres, which are counted from latitude_deg, longitude_deg
# or are those of the system with the number epsg, if [chart] says so.
# Columns of a link: tx_east, tx_north, rx_east, rx_north (both ends about the chart's origin, and ..._depth with depths = true),
# u_... = (tx + rx)/sqrt(2), v_... = (tx - rx)/sqrt(2), range. One length-scale is for all columns of a term, a list has one for each;
# ties numbers those of a list that stay equal when they are learned. The column time has length_scale_s; tx_vehicle, rx_vehicle, kind
# and water are labels (shape = \"label\", no length-scale): every vehicle (and kind of message) has an offset of its own, a typical one none.
# tx_ahead, tx_starboard (rx_...): cos and sin of the bearing of the other end from the bow, with length_scale (no unit), where the label
# tx_heading (rx_...) is not negative. reciprocity: correlation of both directions of a path, 1 if they are equal.
# prior_mean: kind = \"zero\", \"constant\" (log_odds) or \"range\" (log-odds = intercept - slope_per_m * range).
# fading: outcomes of one pair of vehicles that lie still (slower than drift_m_per_s) are alike by correlation * exp(-t/memory_s) after
# t seconds, beyond what the positions explain, and count less for it; correlation = 0: all count in full.
# site_prior (optional): a posterior of earlier missions in this area. links: tx east, north, rx east, north (depth after each north),
# in the metres of the log, with the whitened precision (lower triangle) and shift at these links.

";

/// Parses a TOML text of this schema. The schema is read first, so that a text of another version yields the error
/// `newer` or `older` and not an unknown key.
pub(crate) fn parse_versioned<'a, T: Deserialize<'a>, E>(
    text: &'a str,
    schema: u32,
    syntax: fn(String) -> E,
    newer: fn(u32) -> E,
    older: fn(u32) -> E,
) -> Result<T, E> {
    #[derive(Deserialize)]
    struct SchemaVersion {
        schema: u32,
    }
    let syntax = |error: toml::de::Error| syntax(error.to_string().trim_end().to_owned());
    let version: SchemaVersion = toml::from_str(text).map_err(syntax)?;
    match version.schema.cmp(&schema) {
        Ordering::Greater => Err(newer(version.schema)),
        Ordering::Less => Err(older(version.schema)),
        Ordering::Equal => toml::from_str(text).map_err(syntax),
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelLayout {
    schema: u32,
    #[serde(default)]
    depths: bool,
    chart: ChartLayout,
    prior_mean: MeanLayout,
    /// Fading; the default if not given.
    fading: Option<Fading>,
    kernel: Vec<TermLayout>,
    learned: Option<Provenance>,
    site_prior: Option<SitePriorLayout>,
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
        let (origin, epsg) = match chart.reference {
            ReferenceSystem::Unknown => (None, None),
            ReferenceSystem::About(origin) => (Some(origin), None),
            ReferenceSystem::Epsg(code) => (None, Some(code)),
        };
        Self {
            origin_east_m: chart.origin.east_m,
            origin_north_m: chart.origin.north_m,
            scale_m: chart.scale_m,
            latitude_deg: origin.map(|origin| origin.latitude_deg),
            longitude_deg: origin.map(|origin| origin.longitude_deg),
            epsg,
        }
    }

    fn read(&self) -> Result<Chart, ModelFileError> {
        let origin = Position::new(
            check_bounds("origin_east_m", bounds::COORDINATE_M, self.origin_east_m)?,
            check_bounds("origin_north_m", bounds::COORDINATE_M, self.origin_north_m)?,
        );
        let scale_m = check_bounds("scale_m", bounds::LENGTH_M, self.scale_m)?;
        let reference = match (self.latitude_deg, self.longitude_deg, self.epsg) {
            (Some(latitude_deg), Some(longitude_deg), None) => ReferenceSystem::About(Geographic {
                latitude_deg: check_bounds("latitude_deg", bounds::LATITUDE_DEG, latitude_deg)?,
                longitude_deg: check_bounds("longitude_deg", bounds::LONGITUDE_DEG, longitude_deg)?,
            }),
            (None, None, Some(code)) => ReferenceSystem::Epsg(code),
            (None, None, None) => ReferenceSystem::Unknown,
            (Some(_), Some(_), Some(_)) => return Err(ModelFileError::AmbiguousReference),
            _ => return Err(ModelFileError::IncompleteOrigin),
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
                check_bounds("prior_mean.log_odds", bounds::LOG_ODDS, log_odds).map(PriorMean::Constant)
            }
            Self::Range { intercept, slope_per_m } => {
                let intercept = check_bounds("prior_mean.intercept", bounds::LOG_ODDS, intercept)?;
                let slope_per_m = check_bounds("prior_mean.slope_per_m", bounds::LOG_ODDS, slope_per_m)?;
                Ok(inputs.range_mean(intercept, slope_per_m)?)
            }
        }
    }
}
