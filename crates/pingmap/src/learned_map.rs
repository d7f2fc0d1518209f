//! The model and posterior that are learned from all events of a log.

use std::ops::Deref;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentOptions, Event, FitQuality, Limits, Model, Team, VehicleId, Which};
use pingmap_trial::EventLog;

use crate::data_extent::DataExtent;
use crate::log::{only, thinned};
use crate::model::{InputDigests, ModelAndFit, read_model};
use crate::options::{QueryOptions, Source};
use crate::output::{note, spinner, warn};

/// An event log that was read for a command.
pub struct OpenedLog {
    log: EventLog,
    /// Names of its files.
    name: String,
    /// Digest of the whole log, including events that are not used.
    digest: String,
}

impl Deref for OpenedLog {
    type Target = EventLog;

    fn deref(&self) -> &EventLog {
        &self.log
    }
}

/// An event log, and the model and posterior learned from it.
pub struct LearnedMap {
    pub log: EventLog,
    /// Names of the files of the log.
    pub name: String,
    digest: String,
    pub known: ModelAndFit,
    /// Where the data end.
    pub extent: DataExtent,
    /// An agent that recorded all events.
    pub agent: Agent,
}

impl LearnedMap {
    /// Reads a log, and keeps only one vehicle's events if requested.
    pub fn open(source: &Source) -> anyhow::Result<OpenedLog> {
        let Source { logs, vehicle, work, .. } = source;
        let mut log = logs.open()?;
        source.reference.apply(&mut log)?;
        let digest = log.digest();
        if let Some(path) = source.model.path() {
            let file = read_model(path)?;
            if file.site_log_digests.contains(&digest) {
                warn(format_args!("{}: its site prior contains this log, which counts twice now", path.display()));
            }
            if !log.reference.is_known() {
                log.reference = file.model.chart.reference;
            }
        }
        if let Some(vehicle) = vehicle {
            log = only(&log, vehicle)?;
        }
        let name = logs.file_names();
        Ok(OpenedLog { log: thinned(log, Vec::new(), work.events_max, work.seed).0, name, digest })
    }

    /// Learns from a log that [`LearnedMap::open`] returned.
    pub fn learn(OpenedLog { log, name, digest }: OpenedLog, source: &Source) -> anyhow::Result<Self> {
        let Source { model, work, .. } = source;
        let known = ModelAndFit::new(model.path(), &log, work.limits())?;
        let bar = spinner("fitting");
        let mut agent = all_in_one(&known.model, log.events.iter().cloned(), work.limits())?;
        agent.posterior(Which::Fused)?;
        bar.finish_and_clear();
        let status = agent.status();
        status.fit.iter().for_each(warn_of_quality);
        note(known.describe(log.events.len(), status.is_dense));
        let extent = DataExtent::of(&log.events, known.model.site.iter().flat_map(|site| site.links()));
        Ok(Self { log, name, digest, known, extent, agent })
    }

    /// Sets whether predictions beyond the longest observed link are capped.
    pub fn capped(mut self, query: &QueryOptions) -> Self {
        self.agent.options.allow_extrapolated_increase = query.no_range_cap;
        self
    }

    /// Returns the digests of the log and the model.
    pub fn digests(&self) -> InputDigests {
        InputDigests { log_digest: self.digest.clone(), model_digest: Some(self.model().digest()) }
    }

    /// Returns the model.
    pub fn model(&self) -> &Model {
        &self.known.model
    }
}

/// Returns an agent that recorded all events and learned from them.
pub fn all_in_one(
    model: &Model,
    events: impl IntoIterator<Item = Event>,
    limits: Limits,
) -> Result<Agent, pingmap_agent::AgentError> {
    let id = VehicleId::new("survey");
    let team = Team { limits, ..Team::new([id.clone()], model.clone(), [])? };
    let mut agent =
        Agent::new(id, Arc::new(team), AgentOptions { record_all_receivers: true, ..AgentOptions::default() });
    agent.record(events)?;
    agent.rebuild().map(|()| agent)
}

/// Warns if the fit did not converge.
fn warn_of_quality(quality: &FitQuality) {
    if !quality.converged {
        warn(format_args!("the fit stopped before its fixed point: tilts still change by {:.1e}", quality.change));
    }
}
