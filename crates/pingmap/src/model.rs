//! The model that links are read with: from a file, or learned; in words, and for programs.

use std::path::Path;

use dgpc::{Calibration, Correlation, PriorMean, Stop, Term};
use pingmap_agent::{Chart, InputSpec, LearnedModel, Limits, Link, Model, ModelFile};
use pingmap_trial::{Agreed, EventLog, learn_best};
use schemars::JsonSchema;
use serde::Serialize;

use crate::log::WholeLog;
use crate::options::ModelSource;
use crate::output::{BadInput, count, read_text, spinner, warn};

/// What a result was made of, for programs.
#[derive(Serialize, JsonSchema)]
pub struct MadeOf {
    /// By which the events are known again, whatever the file and the order of its lines.
    pub log_digest: String,
    /// Of the model that all was read with, if there is one.
    pub model_digest: Option<String>,
}

impl MadeOf {
    /// A whole log, and what a team agreed on beforehand.
    pub fn given(log: &WholeLog, agreed: &Agreed) -> Self {
        Self { log_digest: log.digest.clone(), model_digest: agreed_model(agreed).map(Model::digest) }
    }
}

/// The model that a team agreed on beforehand.
pub fn agreed_model(agreed: &Agreed) -> Option<&Model> {
    match agreed {
        Agreed::Nothing => None,
        Agreed::Model(model) => Some(model),
        Agreed::Team(team) => Some(&team.model),
    }
}

/// What links are read with, and how it was learned if it was.
pub struct Known {
    pub model: Model,
    pub fit: Option<LearnedModel>,
}

impl Known {
    /// The model file that the user names, or the best of a few structures learned from all of a log.
    pub fn new(source: &ModelSource, log: &EventLog, limits: Limits) -> anyhow::Result<Self> {
        if let Some(path) = &source.model {
            return Ok(Self { model: open_model(path, log)?.model, fit: None });
        }
        let bar = spinner("learning");
        let learning = source.kernel.learning(source.kernel.given().default_candidates(), limits);
        let fit = learn_best(&learning, log.chart(), log.inputs(), &log.events.iter().collect::<Vec<_>>())?;
        bar.finish_and_clear();
        warn_of_search(&fit);
        Ok(Self { model: fit.model.clone(), fit: Some(fit) })
    }

    /// The model in one line.
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

/// Variance of the path term.
pub fn path_variance(model: &Model) -> f64 {
    model.prior.kernel().terms().first().map_or(0.0, dgpc::Term::variance)
}

/// "698 events", "10000 of 12972 events"; `noun` is what one is called.
pub fn of_events(used: usize, all: usize, noun: &str) -> String {
    if used == all { count(all, noun) } else { format!("{used} of {}", count(all, noun)) }
}

/// As how many independent events those count that a model was learned from.
pub fn counted(fit: &LearnedModel) -> f64 {
    fit.learned.fit.weights().iter().sum()
}

/// Warns of a search that is not what it should be.
pub fn warn_of_search(fit: &LearnedModel) {
    match &fit.learned.calibration {
        Calibration::AtBound(factor) => warn(format_args!(
            "{}: its variances were multiplied by {factor:.2}, nearly the end of what is tried",
            fit.structure
        )),
        Calibration::Failed(why) => {
            warn(format_args!("{}: its variances could not be calibrated: {why}", fit.structure));
        }
        _ => {}
    }
    if fit.learned.stop == Stop::IterationsMax {
        warn(format_args!("{}: the search for its numbers stopped before its end", fit.structure));
    }
}

/// How many of a chart's scales a log may lie from its origin.
const FRAME_SCALES: f64 = 10.0;

/// Reads a model file, and checks that it is for a chart such as this log's.
pub fn open_model(path: &Path, log: &EventLog) -> anyhow::Result<ModelFile> {
    let file = read_model(path)?;
    Ok(ModelFile { model: fitting(file.model, path, log)?, ..file })
}

/// Reads a model file.
pub fn read_model(path: &Path) -> anyhow::Result<ModelFile> {
    let bad = |message: &dyn std::fmt::Display| BadInput(format!("{}: {message}", path.display()));
    Ok(ModelFile::parse(&read_text(path)?).map_err(|error| bad(&error))?)
}

/// What is said where nothing is really held out.
pub const HAS_SEEN_LOG: &str =
    "THE MODEL WAS LEARNED FROM THIS VERY LOG, its held-out events included: scores flatter it";

/// What a model was learned from, if its file says so.
pub fn log_digest(file: &ModelFile) -> Option<&str> {
    file.learned.as_ref()?.log_digest.as_deref()
}

/// All logs that a model and its place were learned from, as far as its file says.
pub fn log_digests(file: &ModelFile) -> impl Iterator<Item = &str> {
    log_digest(file).into_iter().chain(file.site_log_digests.iter().map(String::as_str))
}

/// A model from a file, if it is for a chart such as this log's.
pub fn fitting(model: Model, path: &Path, log: &EventLog) -> anyhow::Result<Model> {
    let bad = |message: &dyn std::fmt::Display| BadInput(format!("{}: {message}", path.display()));
    let (of_model, of_log) = (model.chart.reference, log.reference);
    if !of_model.agrees_with(&of_log) {
        let message = format!(
            "the model's metres are those of {of_model}, the log's those of {of_log}; expected one system for both (pingmap import --origin, --crs)"
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
            Err(bad(&"the model reads depths, but the events have none; expected columns tx_depth_m and rx_depth_m")
                .into())
        }
        (InputSpec::Positions, InputSpec::PositionsAndDepths) => {
            warn(format_args!("{}: the model does not read depths; those of the log are ignored", path.display()));
            Ok(model)
        }
        _ => Ok(model),
    }
}

/// Why a search ended, in words.
pub fn stop_words(stop: &Stop) -> String {
    match stop {
        Stop::Converged => "converged".to_owned(),
        Stop::IterationsMax => "iterations used up".to_owned(),
        Stop::NoProgress(why) => format!("no progress: {why}"),
        other => format!("{other:?}"),
    }
}

/// A kernel for programs: the path term's shape, typical length-scale and variance, and all terms.
#[derive(Debug, Serialize, JsonSchema)]
pub struct KernelJson {
    /// How the path term falls with distance.
    pub shape: Option<String>,
    /// Whether it takes both directions of a link for the same.
    pub reciprocal: Option<bool>,
    /// Typical length-scale of the path term.
    pub length_scale_m: f64,
    /// Its variance.
    pub variance: Option<f64>,
    /// All terms, which are added.
    terms: Vec<TermJson>,
    /// What the columns are about; where that is not said elsewhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inputs: Option<&'static str>,
}

#[derive(Debug, Serialize, JsonSchema)]
pub struct TermJson {
    /// Its variance.
    variance: f64,
    /// Whether it takes both directions of a link for the same.
    reciprocal: bool,
    #[serde(flatten)]
    first: CorrelationJson,
    /// Further correlations that the first one is multiplied by.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    times: Vec<CorrelationJson>,
}

#[derive(Debug, Serialize, JsonSchema)]
pub struct CorrelationJson {
    /// How it falls with distance.
    shape: String,
    /// Which columns of an event it compares.
    columns: Vec<String>,
    /// One for each column that is a place; labels have none.
    length_scales_m: Vec<f64>,
    /// Of the time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    length_scales_s: Vec<f64>,
}

impl KernelJson {
    pub fn of(model: &Model) -> Self {
        let names = model.inputs.column_names();
        let correlation = |correlation: &Correlation| {
            let length_scales = correlation.length_scales().to_vec();
            let (length_scales_m, length_scales_s) = match correlation.columns() {
                _ if correlation.shape().is_of_labels() => (Vec::new(), Vec::new()),
                [column] if *column == model.inputs.time() => (Vec::new(), length_scales),
                _ => (length_scales, Vec::new()),
            };
            let columns = correlation.columns().iter().map(|&column| names[column].clone()).collect();
            CorrelationJson { shape: correlation.shape().to_string(), columns, length_scales_m, length_scales_s }
        };
        let term = |term: &Term| TermJson {
            variance: term.variance(),
            reciprocal: term.is_reciprocal(),
            first: correlation(&term.correlations()[0]),
            times: term.correlations()[1..].iter().map(correlation).collect(),
        };
        let terms = model.prior.kernel().terms();
        Self {
            shape: terms.first().map(|path| path.correlations()[0].shape().to_string()),
            reciprocal: terms.first().map(Term::is_reciprocal),
            length_scale_m: model.length_scale_m(),
            variance: terms.first().map(Term::variance),
            terms: terms.iter().map(term).collect(),
            inputs: None,
        }
    }
}

/// A prior mean and its numbers, for programs.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum PriorMeanJson {
    /// Even odds.
    Zero,
    /// The same everywhere.
    Constant {
        /// The log-odds that a message gets through.
        log_odds: f64,
    },
    /// Falling with range on a straight line.
    Range {
        /// The log-odds at range 0.
        intercept: f64,
        /// By how much they fall with every metre.
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
