//! Reading a log for use: warnings about what is odd in it, thinning, and a model learned from all of it.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use dgpc::Posterior;
use pingmap_agent::{Agent, FitQuality, Fusion, Link, Model, VehicleId};
use pingmap_trial::{EventLog, GridFit, KernelChoice, Split, search, thin};

use crate::cli;
use crate::output::{BadInput, count, note, spinner, warn};

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

/// A log and what was learned from all of it.
pub struct Survey {
    pub log: EventLog,
    pub fit: GridFit,
    pub posterior: Posterior,
}

impl Survey {
    /// Reads a log, keeps one vehicle's events if asked to, and learns.
    pub fn learn(source: &cli::Source) -> anyhow::Result<Self> {
        let cli::Source { events, vehicle, kernel, work } = source;
        let mut log = open_log(events)?;
        if let Some(vehicle) = vehicle {
            log = only(&log, vehicle)?;
        }
        let (log, _) = thinned(log, Vec::new(), work.events_max, work.seed);
        let bar = spinner("learning");
        let fit = fit(&log, &kernel.choice(), work.seed)?;
        let mut agent = Agent::new(VehicleId::new("survey"), Arc::new(fit.model.clone()), work.limits());
        agent.observe_all(log.events.iter().cloned());
        agent.learn()?;
        let posterior = agent.posterior(Fusion::Sites)?;
        bar.finish_and_clear();
        warn_of_quality(&agent.fit_quality()?);
        note(describe(&fit, log.events.len(), agent.learns_densely()));
        Ok(Self { log, fit, posterior })
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.fit.model
    }
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

/// Searches the kernel on all events of a log.
pub fn fit(log: &EventLog, choice: &KernelChoice, seed: u64) -> dgpc::Result<GridFit> {
    search(choice, log.chart(), log.inputs(), &log.events.iter().collect::<Vec<_>>(), seed)
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

/// The model in one line.
pub fn describe(fit: &GridFit, events: usize, dense: bool) -> String {
    let source = match fit.evidence {
        Some(evidence) => {
            let edge = if fit.at_grid_edge { ", at the edge of the grid" } else { "" };
            format!("found by grid search on {} events{edge}, evidence {evidence:.1} nats", fit.events_used)
        }
        None => "as given".to_owned(),
    };
    let inference = if dense { "dense mean field" } else { "sparse mean field" };
    let (length_scale_m, variance) = (fit.length_scale_m, fit.variance);
    let events = count(events, "event");
    format!("{events}, {inference}; length-scale {length_scale_m:.0} m, variance {variance} ({source})")
}
