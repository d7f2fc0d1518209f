//! The model that a command uses, from a file or learned, and its description as text and JSON.

use std::path::Path;

use dgpc::{Calibration, Correlation, PriorMean, Stop, Term};
use pingmap_agent::{Chart, InputSpec, LearnedModel, Learning, LengthUnit, Limits, Link, Model, ModelFile};
use pingmap_trial::{EventLog, Preshared, learn};
use schemars::JsonSchema;
use serde::Serialize;

use crate::log::WholeLog;
use crate::output::{BadInput, count, read_text, spinner, warn};

/// Digests of the inputs of a result.
#[derive(Serialize, JsonSchema)]
pub struct InputDigests {
    /// Digest of the events. It does not depend on the file or the order of lines.
    pub log_digest: String,
    /// Digest of the model, if one model was used throughout.
    pub model_digest: Option<String>,
}

impl InputDigests {
    /// Returns the digests of a whole log and of the shared model.
    pub fn given(log: &WholeLog, preshared: &Preshared) -> Self {
        Self { log_digest: log.digest.clone(), model_digest: preshared_model(preshared).map(Model::digest) }
    }
}

/// Returns the model that all members of a team share, if there is one.
pub fn preshared_model(preshared: &Preshared) -> Option<&Model> {
    match preshared {
        Preshared::Nothing => None,
        Preshared::Model(model) => Some(model),
        Preshared::Team(team) => Some(&team.model),
    }
}

/// A model, and the result of learning if it was learned.
pub struct ModelAndFit {
    pub model: Model,
    pub fit: Option<LearnedModel>,
}

impl ModelAndFit {
    /// Opens the model file, or learns a model from the whole log if there is none.
    pub fn new(path: Option<&Path>, log: &EventLog, limits: Limits) -> anyhow::Result<Self> {
        if let Some(path) = path {
            return Ok(Self { model: open_model(path, log)?.model, fit: None });
        }
        let bar = spinner("learning");
        let learning = Learning { limits, ..Learning::default() };
        let fit = learn(&learning, log.chart(), log.inputs(), &log.events.iter().collect::<Vec<_>>())?.best;
        bar.finish_and_clear();
        warn_of_search(&fit);
        Ok(Self { model: fit.model.clone(), fit: Some(fit) })
    }

    /// Describes the model in one line.
    pub fn describe(&self, events: usize, dense: bool) -> String {
        let inference = if dense { "dense mean field" } else { "sparse mean field" };
        let source = match &self.fit {
            Some(fit) => format!(
                "{}; learned from {}, E {:.1} nats, leave-one-out {:.4} nats an event",
                fit.structure,
                of_events(fit.events_used, fit.events, "event"),
                fit.evidence(),
                fit.leave_one_out()
            ),
            None => "model as given".to_owned(),
        };
        let (length_scale_m, variance) = (self.model.length_scale_m(), path_variance(&self.model));
        let events = count(events, "event");
        format!("{events}, {inference}; {source}; path: length-scale {length_scale_m:.0} m, variance {variance:.2}")
    }
}

/// Returns the variance of the path term.
pub fn path_variance(model: &Model) -> f64 {
    model.prior.kernel().terms().first().map_or(0.0, dgpc::Term::variance)
}

/// Formats counts such as "698 events" or "10000 of 12972 events".
pub fn of_events(used: usize, all: usize, noun: &str) -> String {
    if used == all { count(all, noun) } else { format!("{used} of {}", count(all, noun)) }
}

/// Returns the effective number of events from which a model was learned.
pub fn counted(fit: &LearnedModel) -> f64 {
    fit.learned.fit.weights().iter().sum()
}

/// Warns if the search stopped early, or if the calibration of variances failed or reached its bound.
pub fn warn_of_search(fit: &LearnedModel) {
    match &fit.learned.calibration {
        Calibration::AtBound(factor) => warn(format_args!(
            "{}: its variances were multiplied by {factor:.2}, close to the limit of the search",
            fit.structure
        )),
        Calibration::Failed(why) => {
            warn(format_args!("{}: its variances could not be calibrated: {why}", fit.structure));
        }
        _ => {}
    }
    if fit.learned.stop == Stop::IterationsMax {
        warn(format_args!("{}: the search for its parameters stopped before it converged", fit.structure));
    }
}

/// Largest distance between a log and the origin of a chart, as a multiple of the chart's scale.
const FRAME_SCALES: f64 = 10.0;

/// Opens a model file, and checks that its chart suits the log.
pub fn open_model(path: &Path, log: &EventLog) -> anyhow::Result<ModelFile> {
    let file = read_model(path)?;
    Ok(ModelFile { model: fitting(file.model, path, log)?, ..file })
}

/// Reads a model file.
pub fn read_model(path: &Path) -> anyhow::Result<ModelFile> {
    let bad = |message: &dyn std::fmt::Display| BadInput(format!("{}: {message}", path.display()));
    Ok(ModelFile::parse(&read_text(path)?).map_err(|error| bad(&error))?)
}

/// Warning that no event is held out from this model.
pub const HAS_SEEN_LOG: &str =
    "THE MODEL WAS LEARNED FROM THIS LOG, including the held-out events: scores are too good";

/// Returns the digest of the log from which a model was learned, if its file contains it.
pub fn log_digest(file: &ModelFile) -> Option<&str> {
    file.learned.as_ref()?.log_digest.as_deref()
}

/// Returns the digests of all logs behind a model and its site prior, if its file contains them.
pub fn log_digests(file: &ModelFile) -> impl Iterator<Item = &str> {
    log_digest(file).into_iter().chain(file.site_log_digests.iter().map(String::as_str))
}

/// Checks that a model's chart, reference system and inputs suit the log, and returns the model.
pub fn fitting(model: Model, path: &Path, log: &EventLog) -> anyhow::Result<Model> {
    let bad = |message: &dyn std::fmt::Display| BadInput(format!("{}: {message}", path.display()));
    let (of_model, of_log) = (model.chart.reference, log.reference);
    if !of_model.agrees_with(&of_log) {
        let message = format!(
            "the model uses {of_model}, but the log uses {of_log}; expected one reference system (pingmap import --origin, --crs)"
        );
        return Err(bad(&message).into());
    }
    let Chart { origin, scale_m, .. } = model.chart;
    let distance_m = Link { transmitter: origin, receiver: log.chart().origin }.range_m();
    // Origins are rounded to 100 m.
    if distance_m > FRAME_SCALES * scale_m + 100.0 {
        let message = format!(
            "the model is for a chart about ({:.0}, {:.0}) with a scale of {scale_m} m, but the events lie {:.1} km from there; \
             expected at most {FRAME_SCALES} scales (if it is meant for these events, change [chart])",
            origin.east_m,
            origin.north_m,
            distance_m / 1000.0
        );
        return Err(bad(&message).into());
    }
    match (model.inputs, log.inputs()) {
        (InputSpec::PositionsAndDepths, InputSpec::Positions) => {
            Err(bad(&"the model uses depths, but the events have none; expected columns tx_depth_m and rx_depth_m")
                .into())
        }
        (InputSpec::Positions, InputSpec::PositionsAndDepths) => {
            warn(format_args!("{}: the model does not use depths; those of the log are ignored", path.display()));
            Ok(model)
        }
        _ => Ok(model),
    }
}

/// Describes why a search ended.
pub fn stop_words(stop: &Stop) -> String {
    match stop {
        Stop::Converged => "converged".to_owned(),
        Stop::IterationsMax => "iterations used up".to_owned(),
        Stop::NoProgress(why) => format!("no progress: {why}"),
        other => format!("{other:?}"),
    }
}

/// A kernel in JSON: shape, typical length-scale and variance of the path term, and all terms.
#[derive(Debug, Serialize, JsonSchema)]
pub struct KernelJson {
    /// Shape of the path term's covariance over distance.
    pub shape: Option<String>,
    /// Correlation of the path term's values for both directions of a link: 1 if they are equal.
    pub reciprocity: Option<f64>,
    /// Typical length-scale of the path term.
    pub length_scale_m: f64,
    /// Variance of the path term.
    pub variance: Option<f64>,
    /// All terms. The kernel is their sum.
    terms: Vec<TermJson>,
    /// The meaning of the columns, where no other field contains it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inputs: Option<&'static str>,
}

#[derive(Debug, Serialize, JsonSchema)]
pub struct TermJson {
    /// Variance of the term.
    variance: f64,
    /// Correlation of the term's values for both directions of a link: 1 if they are equal.
    reciprocity: f64,
    #[serde(flatten)]
    first: CorrelationJson,
    /// Further correlations, by which the first is multiplied.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    times: Vec<CorrelationJson>,
}

#[derive(Debug, Serialize, JsonSchema)]
pub struct CorrelationJson {
    /// Shape of the covariance over distance.
    shape: String,
    /// Columns of an event that the correlation compares.
    columns: Vec<String>,
    /// One length-scale in metres for each spatial column; correlations over labels have none.
    length_scales_m: Vec<f64>,
    /// Length-scale in seconds of the time column.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    length_scales_s: Vec<f64>,
    /// Length-scales of aspect columns, as chords of the unit circle.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    length_scales_chord: Vec<f64>,
}

impl KernelJson {
    pub fn of(model: &Model) -> Self {
        let names = model.inputs.column_names();
        let correlation = |correlation: &Correlation| {
            let length_scales = correlation.length_scales().to_vec();
            let [mut length_scales_m, mut length_scales_s, mut length_scales_chord] = [const { Vec::new() }; 3];
            match model.inputs.length_unit(correlation.columns()) {
                _ if correlation.shape().is_of_labels() => {}
                LengthUnit::Metres => length_scales_m = length_scales,
                LengthUnit::Seconds => length_scales_s = length_scales,
                LengthUnit::Chords => length_scales_chord = length_scales,
            }
            let columns = correlation.columns().iter().map(|&column| names[column].clone()).collect();
            let shape = correlation.shape().to_string();
            CorrelationJson { shape, columns, length_scales_m, length_scales_s, length_scales_chord }
        };
        let term = |term: &Term| TermJson {
            variance: term.variance(),
            reciprocity: term.reciprocity(),
            first: correlation(&term.correlations()[0]),
            times: term.correlations()[1..].iter().map(correlation).collect(),
        };
        let terms = model.prior.kernel().terms();
        Self {
            shape: terms.first().map(|path| path.correlations()[0].shape().to_string()),
            reciprocity: terms.first().map(Term::reciprocity),
            length_scale_m: model.length_scale_m(),
            variance: terms.first().map(Term::variance),
            terms: terms.iter().map(term).collect(),
            inputs: None,
        }
    }
}

/// A prior mean and its parameters in JSON.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum PriorMeanJson {
    /// Even odds.
    Zero,
    /// Constant odds.
    Constant {
        /// Log-odds that a message is received.
        log_odds: f64,
    },
    /// Odds that fall linearly with range.
    Range {
        /// Log-odds at range 0.
        intercept: f64,
        /// Decrease of the log-odds per metre.
        slope_per_m: f64,
    },
}

impl PriorMeanJson {
    pub fn of(mean: &PriorMean) -> Self {
        match mean {
            PriorMean::Constant(log_odds) => Self::Constant { log_odds: *log_odds },
            PriorMean::Range(range) => Self::Range { intercept: range.intercept(), slope_per_m: range.slope() },
            _ => Self::Zero,
        }
    }
}
