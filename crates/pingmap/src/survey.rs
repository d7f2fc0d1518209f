//! Reading a log for use: warnings about what is odd in it, thinning, and a model learned from all of it.

use std::collections::HashSet;
use std::path::Path;
use std::sync::Arc;

use dgpc::Posterior;
use pingmap_agent::{Agent, Fusion, Link, Model, VehicleId};
use pingmap_trial::{EventLog, GridFit, KernelChoice, Split, search, thin};

use crate::cli;
use crate::output::{BadInput, note, spinner, warn};

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
        warn(format_args!(
            "every one of the {} events was {class}: the map can only say so with growing certainty",
            log.events.len()
        ));
    }
    if let [vehicle] = log.vehicles().as_slice() {
        warn(format_args!("{vehicle} is the only receiver: there is nobody to share with"));
    }
    let bits = |link: &Link| {
        let ends = [link.transmitter, link.receiver];
        ends.map(|end| [end.east_m, end.north_m, end.depth_m.unwrap_or(0.0)].map(f64::to_bits))
    };
    let distinct: HashSet<_> = log.events.iter().map(|event| bits(&event.link)).collect();
    if log.events.len() >= 100 && distinct.len() * 20 < log.events.len() {
        warn(format_args!(
            "only {} distinct links among {} events: the map says little between them",
            distinct.len(),
            log.events.len()
        ));
    }
}

/// Keeps at most `events_max` events of every vehicle, and says so.
pub fn thinned(log: EventLog, splits: Vec<Split>, events_max: usize, seed: u64) -> (EventLog, Vec<Split>) {
    let kept = thin(&log, events_max, seed);
    if kept.len() == log.events.len() {
        return (log, splits);
    }
    warn(format_args!(
        "using {} of {} events: at most {events_max} of each vehicle, drawn with seed {seed} (--events-max, --seed)",
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
        log.events.iter().for_each(|event| agent.observe(event.clone()));
        agent.learn()?;
        let posterior = agent.posterior(Fusion::Sites)?;
        bar.finish_and_clear();
        note(describe(&fit, log.events.len(), agent.learns_densely()));
        Ok(Self { log, fit, posterior })
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.fit.model
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
        Some(evidence) => format!("found by grid search on {} events, evidence {evidence:.1} nats", fit.events_used),
        None => "as given".to_owned(),
    };
    let inference = if dense { "dense mean field" } else { "sparse mean field" };
    let (length_scale_m, variance) = (fit.length_scale_m, fit.variance);
    format!("{events} events, {inference}; length-scale {length_scale_m:.0} m, variance {variance} ({source})")
}
