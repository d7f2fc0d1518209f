//! Reading a log for use: warnings about what is odd in it, thinning, and a model learned from all of it.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use dgpc::{Posterior, Stop};
use pingmap_agent::{
    Agent, Chart, Event, FitQuality, InputSpec, LearnedModel, Limits, Link, Model, ModelFile, Team, VehicleId,
};
use pingmap_trial::{EventLog, Split, learn_best, thin};

use crate::cli;
use crate::output::{BadInput, count, note, read_text, spinner, warn};

/// Reads an event log and warns about what its reader should know.
pub fn open_log(path: &Path) -> anyhow::Result<EventLog> {
    let log = EventLog::open(path)?;
    if !log.unknown_columns.is_empty() {
        warn(format_args!("{}: ignoring the column {}", path.display(), log.unknown_columns.join(", ")));
    }
    warn_about(&log);
    Ok(log)
}

fn warn_about(log: &EventLog) {
    let successes = log.events.iter().filter(|event| event.success).count();
    if successes == 0 || successes == log.events.len() {
        let class = if successes == 0 { "missed" } else { "heard" };
        let events = count(log.events.len(), "event");
        warn(format_args!("all of {events} {class}: the map can only say so with growing certainty"));
    }
    if let [vehicle] = log.vehicles().as_slice() {
        warn(format_args!("{vehicle} is the only receiver: there is nobody to share with"));
    }
    let bits =
        |link: &Link| link.ends().map(|end| [end.east_m, end.north_m, end.depth_m.unwrap_or(0.0)].map(f64::to_bits));
    let distinct: HashSet<_> = log.events.iter().map(|event| bits(&event.link)).collect();
    if log.events.len() >= 100 && distinct.len() * 20 < log.events.len() {
        warn(format_args!(
            "only {} distinct links among {} events: the map says little between them",
            distinct.len(),
            log.events.len()
        ));
    }
}

/// Keeps at most `events_max` events, and says so.
pub fn thinned(log: EventLog, splits: Vec<Split>, events_max: usize, seed: u64) -> (EventLog, Vec<Split>) {
    let kept = thin(&log, events_max, seed);
    if kept.len() == log.events.len() {
        return (log, splits);
    }
    warn(format_args!(
        "using {} of {} events, drawn with seed {seed}; vehicles with few keep theirs (--events-max, --seed)",
        kept.len(),
        log.events.len()
    ));
    (log.select(&kept), splits.iter().map(|split| split.select(&kept)).collect())
}

/// What links are read with, and how it was learned if it was.
pub struct Known {
    pub model: Model,
    pub fit: Option<LearnedModel>,
}

impl Known {
    /// The model file that the user names, or the best of a few structures learned from all of a log.
    pub fn new(source: &cli::ModelSource, log: &EventLog, limits: Limits) -> anyhow::Result<Self> {
        if let Some(path) = &source.model {
            return Ok(Self { model: open_model(path, log)?, fit: None });
        }
        let bar = spinner("learning");
        let learning = source.kernel.learning(source.kernel.given().few(), limits);
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
                of_events(fit.events_used, fit.events),
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

/// "698 events", "10000 of 12972 events".
pub fn of_events(used: usize, all: usize) -> String {
    if used == all { count(all, "event") } else { format!("{used} of {}", count(all, "event")) }
}

/// Warns of a search that is not what it should be.
pub fn warn_of_search(fit: &LearnedModel) {
    if fit.learned.stop == Stop::IterationsMax {
        warn(format_args!("{}: the search for its numbers stopped before its end", fit.structure));
    }
}

/// How many of a chart's scales a log may lie from its origin.
const FRAME_SCALES: f64 = 10.0;

/// Reads a model file, and checks that it is for a chart such as this log's.
pub fn open_model(path: &Path, log: &EventLog) -> anyhow::Result<Model> {
    fitting(read_model(path)?, path, log)
}

/// Reads a model file.
pub fn read_model(path: &Path) -> anyhow::Result<Model> {
    let bad = |message: &dyn std::fmt::Display| BadInput(format!("{}: {message}", path.display()));
    Ok(ModelFile::parse(&read_text(path)?).map_err(|error| bad(&error))?.model)
}

/// A model from a file, if it is for a chart such as this log's.
pub fn fitting(model: Model, path: &Path, log: &EventLog) -> anyhow::Result<Model> {
    let bad = |message: &dyn std::fmt::Display| BadInput(format!("{}: {message}", path.display()));
    let Chart { origin, scale_m, .. } = model.chart;
    let distance_m = Link { transmitter: origin, receiver: log.chart().origin }.range_m();
    // Origins are rounded to 100 m.
    if distance_m > FRAME_SCALES * scale_m + 100.0 {
        let message = format!(
            "the model is for a chart about ({:.0}, {:.0}) with a scale of {scale_m} m, but the events lie {:.1} km from there;              expected at most {FRAME_SCALES} scales (if it is meant for these events, change [chart])",
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

/// A log and what was learned from all of it.
pub struct Survey {
    pub log: EventLog,
    pub known: Known,
    pub posterior: Posterior,
}

impl Survey {
    /// Reads a log, keeps one vehicle's events if asked to, and learns.
    pub fn learn(source: &cli::Source) -> anyhow::Result<Self> {
        let cli::Source { events, vehicle, model, work } = source;
        let mut log = open_log(events)?;
        if let Some(vehicle) = vehicle {
            log = only(&log, vehicle)?;
        }
        let (log, _) = thinned(log, Vec::new(), work.events_max, work.seed);
        let known = Known::new(model, &log, work.limits())?;
        let bar = spinner("fitting");
        let mut agent = all_in_one(&known.model, log.events.iter().cloned(), work.limits())?;
        let posterior = agent.posterior()?.clone();
        bar.finish_and_clear();
        agent.fit_quality().iter().for_each(warn_of_quality);
        note(known.describe(log.events.len(), agent.learns_densely()));
        Ok(Self { log, known, posterior })
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.known.model
    }
}

/// One vehicle that owns all of these events, after it learned from them.
pub fn all_in_one(
    model: &Model,
    events: impl IntoIterator<Item = Event>,
    limits: Limits,
) -> Result<Agent, pingmap_agent::AgentError> {
    let id = VehicleId::new("survey");
    let team = Team { limits, ..Team::new([id.clone()], model.clone(), [])? };
    let mut agent = Agent::new(id, Arc::new(team));
    agent.observe_all(events)?;
    agent.rebuild_posteriors().map(|()| agent)
}

/// Warns of a fit that is not what it should be.
fn warn_of_quality(quality: &FitQuality) {
    if !quality.converged {
        warn(format_args!("the fit stopped before its fixed point: tilts still change by {:.1e}", quality.change));
    }
}

/// Mean depth of all ends in a log; unknown without depths.
pub fn mean_depth_m(log: &EventLog) -> Option<f64> {
    let ends = log.events.iter().flat_map(|event| event.link.ends());
    let depths: Vec<f64> = ends.filter_map(|end| end.depth_m).collect();
    (!depths.is_empty()).then(|| depths.iter().sum::<f64>() / depths.len() as f64)
}

/// Gives ends without a depth the mean depth of a log that has depths, and says so.
pub fn fill_depths(links: &mut [Link], log: &EventLog) {
    let Some(depth_m) = mean_depth_m(log) else { return };
    let unknown = links.iter_mut().flat_map(|link| [&mut link.transmitter.depth_m, &mut link.receiver.depth_m]);
    let mut filled = false;
    for depth in unknown.filter(|depth| depth.is_none()) {
        *depth = Some(depth_m);
        filled = true;
    }
    if filled {
        warn(format_args!("places without a depth are taken to lie at {depth_m:.1} m, the mean depth of the log"));
    }
}

/// The part of a log that one vehicle owns.
pub fn only(log: &EventLog, vehicle: &str) -> anyhow::Result<EventLog> {
    let own = |n: &usize| log.events[*n].receiver_id.as_str() == vehicle;
    let own: Vec<usize> = (0..log.events.len()).filter(own).collect();
    if own.is_empty() {
        let known: Vec<String> = log.vehicles().iter().map(ToString::to_string).collect();
        let message = format!("no events received by vehicle {vehicle:?}; expected one of {}", known.join(", "));
        return Err(BadInput(message).into());
    }
    Ok(log.select(&own))
}
