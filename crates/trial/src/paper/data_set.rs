//! A trial in the form of the paper's experiment: standardised inputs, and the events of each agent.

use dgpc::{Error, Inputs, LocalityRegion, Observations};
use pingmap_agent::{Link, VehicleId};

use crate::event_log::EventLog;
use crate::split::events_by_vehicle;

/// Largest number of events in the regions of a data set together. Regions have equal shares and keep the events
/// nearest to their centres.
pub const REGION_EVENTS_MAX: usize = 1200;

/// One data set.
#[derive(Debug, Clone)]
pub struct DataSet {
    /// Name of the data set.
    pub name: String,
    log: EventLog,
    /// East and north of transmitter and receiver, N×4. Every column has mean 0 and variance 1.
    inputs: Inputs,
    agents: Vec<AgentEvents>,
}

/// The events of one agent, which it received or missed.
#[derive(Debug, Clone)]
pub struct AgentEvents {
    /// The agent.
    pub id: VehicleId,
    /// Indices of its events, in log order.
    pub events: Vec<usize>,
}

impl DataSet {
    /// Standardises the positions of a log by columns. Depths are ignored, as in the paper. A constant column becomes
    /// 0.
    ///
    /// # Errors
    /// None in practice, because positions are finite.
    pub fn new(name: impl Into<String>, log: EventLog) -> Result<Self, Error> {
        let raw: Vec<[f64; 4]> = log.events.iter().map(|event| horizontal(&event.link)).collect();
        let mut values = vec![0.0; 4 * raw.len()];
        for column in 0..4 {
            let count = raw.len() as f64;
            let mean = raw.iter().map(|row| row[column]).sum::<f64>() / count;
            let variance = raw.iter().map(|row| (row[column] - mean).powi(2)).sum::<f64>() / count;
            // Only rounding errors are left of a constant column.
            if raw.iter().all(|row| row[column] == raw[0][column]) {
                continue;
            }
            let scale = variance.sqrt();
            for (n, row) in raw.iter().enumerate() {
                values[4 * n + column] = (row[column] - mean) / scale;
            }
        }
        let agents =
            events_by_vehicle(&log).into_iter().map(|(id, events)| AgentEvents { id: id.clone(), events }).collect();
        Ok(Self { name: name.into(), inputs: Inputs::new(values, 4)?, agents, log })
    }

    /// Returns the event log.
    pub fn log(&self) -> &EventLog {
        &self.log
    }

    /// Returns the agents in alphabetical order.
    pub fn agents(&self) -> &[AgentEvents] {
        &self.agents
    }

    /// Returns the numbers of messages that an agent missed and heard.
    pub fn failures_and_successes(&self, agent: &AgentEvents) -> (usize, usize) {
        let successes = agent.events.iter().filter(|&&event| self.log.events[event].success).count();
        (agent.events.len() - successes, successes)
    }

    /// Returns the standardised input of an event, 4 numbers.
    pub fn standardised(&self, event: usize) -> &[f64] {
        self.inputs.row(event)
    }

    /// Returns the observations at `indices`.
    pub(super) fn observations(&self, indices: &[usize]) -> Result<Observations, Error> {
        let outcomes = indices.iter().map(|&n| self.log.events[n].success).collect();
        Observations::new(self.inputs.select(indices), outcomes)
    }

    /// Returns the fixed locality region of an agent. Its centre is the agent's event with the most own events within
    /// the radius; of more than a thousand events, a thousand are tried. Members are indices of the log, at most this
    /// agent's share of [`REGION_EVENTS_MAX`].
    ///
    /// # Errors
    /// [`Error::OutOfRange`] for a radius that is negative or not finite.
    pub(super) fn region(&self, agent: &AgentEvents, radius: f64) -> Result<LocalityRegion, Error> {
        let own = self.inputs.select(&agent.events);
        let empty = LocalityRegion { centre: Vec::new(), radius, members: Vec::new() };
        let mut region = LocalityRegion::busiest(&own, radius)?.unwrap_or(empty);
        region.keep_nearest(&own, REGION_EVENTS_MAX / self.agents.len());
        region.members.iter_mut().for_each(|member| *member = agent.events[*member]);
        Ok(region)
    }
}

/// Returns east and north of both ends in metres.
fn horizontal(link: &Link) -> [f64; 4] {
    let Link { transmitter, receiver } = link;
    [transmitter.east_m, transmitter.north_m, receiver.east_m, receiver.north_m]
}
