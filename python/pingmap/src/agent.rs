//! One vehicle of a team.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use pingmap_agent::{AgentError, AgentOptions, Learning, Link, LinkQuery, Position, Receipt, Team, VehicleId, Which};
use pingmap_trial::{EventLog, FileError, read_attempts};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::errors::{agent_failed, failed};
use crate::work::{work, work_and_warn};

/// One vehicle of a team, without input or output, clock, or threads. The class `pingmap.Agent` converts its tables.
#[pyclass(frozen, module = "pingmap._pingmap")]
pub struct Agent {
    team: Arc<Team>,
    id: VehicleId,
    /// The lock is taken without the interpreter's lock, so that two threads cannot wait for each other.
    agent: Mutex<pingmap_agent::Agent>,
}

/// State of one member, as a dictionary.
#[derive(IntoPyObject)]
struct Member {
    last_heard_s: Option<f64>,
    ignored: BTreeMap<&'static str, f64>,
    conflicts: usize,
    waiting_frames: usize,
    clock_offset_slots: Option<i32>,
}

/// State of a vehicle, as a dictionary.
#[derive(IntoPyObject)]
struct Status {
    members: BTreeMap<String, Member>,
    own_clock_offset_slots: Option<i32>,
    own_events: usize,
    located_events: usize,
    unlocated_events: usize,
    longest_link_m: Option<f64>,
    live_packets: usize,
    accepted_frames: u64,
    is_dense: bool,
    has_converged: Option<bool>,
}

/// Columns of predictions, as a dictionary.
#[derive(IntoPyObject, Default)]
struct Predictions {
    probability: Vec<f64>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    log_odds_mean: Vec<f64>,
    log_odds_variance: Vec<f64>,
}

/// Largest number of links that are predicted between two checks for signals.
const LINKS_AT_ONCE: usize = 1024;

/// Returns the exception for a refused table.
fn refused(error: FileError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

fn options(record_all_receivers: bool) -> AgentOptions {
    AgentOptions { record_all_receivers, ..AgentOptions::default() }
}

impl Agent {
    /// Computes with the agent on another thread.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        compute: impl FnOnce(&mut pingmap_agent::Agent) -> Result<T, AgentError> + Send,
    ) -> PyResult<T> {
        let compute = |_: &_| compute(&mut self.agent.lock().unwrap_or_else(PoisonError::into_inner));
        work(py, compute)?.map_err(agent_failed)
    }
}

#[pymethods]
impl Agent {
    /// Creates a vehicle without any data, or restores that of a snapshot. Calls `warn` with each warning.
    #[new]
    #[pyo3(signature = (name, team, warn, /, *, record_all_receivers, snapshot))]
    fn new(
        py: Python<'_>,
        name: String,
        team: PathBuf,
        warn: &Bound<'_, PyAny>,
        record_all_receivers: bool,
        snapshot: Option<Vec<u8>>,
    ) -> PyResult<Self> {
        let team = Arc::new(work_and_warn(py, warn, |_| pingmap::read_team(&team))?.map_err(failed)?);
        let (id, options) = (VehicleId::new(name), options(record_all_receivers));
        let agent = match snapshot {
            None => pingmap_agent::Agent::new(id.clone(), team.clone(), options),
            Some(bytes) => {
                let restore = |_: &_| pingmap_agent::Agent::restore(id.clone(), team.clone(), options, &bytes);
                work(py, restore)?.map_err(agent_failed)?
            }
        };
        Ok(Self { team, id, agent: Mutex::new(agent) })
    }

    /// The name of the vehicle.
    #[getter]
    fn name(&self) -> &str {
        self.id.as_str()
    }

    /// The largest length of a frame in bytes.
    #[getter]
    fn frame_bytes(&self) -> usize {
        self.team.frame_bytes
    }

    /// Records the events of a log in CSV.
    fn record(&self, py: Python<'_>, csv: &str) -> PyResult<()> {
        let log = EventLog::read(csv.as_bytes(), Path::new("events")).map_err(refused)?;
        self.with(py, |agent| agent.record(log.events).map(drop))
    }

    /// Records positions: time in seconds, easting and northing in metres, and perhaps a depth in metres.
    fn record_positions(&self, py: Python<'_>, fixes: Vec<(f64, f64, f64, Option<f64>)>) -> PyResult<()> {
        let fix = |(time_s, east_m, north_m, depth_m)| (time_s, Position { depth_m, ..Position::new(east_m, north_m) });
        self.with(py, |agent| agent.record_positions(fixes.into_iter().map(fix)).map(drop))
    }

    /// Records that the vehicle did not transmit in its own slots at these times.
    fn record_unused_slots(&self, py: Python<'_>, times_s: Vec<f64>) -> PyResult<()> {
        self.with(py, |agent| agent.record_unused_slots(times_s).map(drop))
    }

    /// Receives a frame. Returns the reason why its content does not count; `None` if it counts.
    #[pyo3(signature = (frame, time_s))]
    fn receive(&self, py: Python<'_>, frame: &[u8], time_s: Option<f64>) -> PyResult<Option<String>> {
        self.with(py, |agent| {
            Ok(match agent.receive(frame, time_s).receipt {
                Receipt::Accepted => None,
                Receipt::Refused(refusal) => Some(refusal.to_string()),
            })
        })
    }

    /// Returns the next frame; `None` if nothing is worth a frame.
    #[pyo3(signature = (time_s, frame_bytes))]
    fn next_frame<'py>(
        &self,
        py: Python<'py>,
        time_s: Option<f64>,
        frame_bytes: usize,
    ) -> PyResult<Option<Bound<'py, PyBytes>>> {
        let frame = self.with(py, |agent| agent.next_frame(time_s, frame_bytes))?;
        Ok(frame.map(|frame| PyBytes::new(py, &frame.bytes)))
    }

    /// Predicts links in CSV.
    fn predict(&self, py: Python<'_>, csv: &str, own_events_only: bool) -> PyResult<Predictions> {
        let nowhere = Position::new(0.0, 0.0);
        let typical = LinkQuery::from(Link { transmitter: nowhere, receiver: nowhere });
        let links = read_attempts((csv.as_bytes(), Path::new("links")), &typical, &|_| None).map_err(refused)?;
        let predictions = self.with(py, |agent| match own_events_only {
            true => agent.predict(links.attempts, Which::Own),
            false => {
                let predict = |links: &[LinkQuery]| agent.predict_intervals(links);
                links.attempts.chunks(LINKS_AT_ONCE).map(predict).collect::<Result<Vec<_>, _>>().map(|all| all.concat())
            }
        })?;
        let mut columns = Predictions::default();
        for prediction in predictions {
            columns.probability.push(prediction.probability);
            columns.log_odds_mean.push(prediction.mean);
            columns.log_odds_variance.push(prediction.variance);
            columns.lower.extend(prediction.interval.map(|interval| interval.low));
            columns.upper.extend(prediction.interval.map(|interval| interval.high));
        }
        Ok(columns)
    }

    /// Whether enough events are new for another fit.
    #[getter]
    fn refit_due(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |agent| Ok(agent.refit_due()))
    }

    /// Fits own and remote events again, and detects faulty members.
    fn refit(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, pingmap_agent::Agent::refit)
    }

    /// Learns the vehicle's own model.
    fn adapt(&self, py: Python<'_>) -> PyResult<()> {
        let learning = Learning { limits: self.team.limits, ..Learning::default() };
        self.with(py, |agent| agent.adapt(&learning).map(drop))
    }

    /// Mutes a member, or uses its data again.
    fn set_muted(&self, py: Python<'_>, member: &str, is_muted: bool) -> PyResult<()> {
        let member = VehicleId::new(member);
        if self.team.number(&member).is_none() {
            return Err(PyValueError::new_err(format!("{member} is not a member of the team")));
        }
        self.with(py, |agent| {
            agent.set_muted(&member, is_muted);
            Ok(())
        })
    }

    /// Returns the state of the vehicle and of every other member.
    fn status(&self, py: Python<'_>) -> PyResult<Status> {
        let status = self.with(py, |agent| Ok(agent.status()))?;
        let member = |(id, member): (VehicleId, pingmap_agent::MemberStatus)| {
            let ignored = member.ignored.into_iter().map(|(reason, since_s)| (reason.name(), since_s)).collect();
            let state = Member {
                last_heard_s: member.last_heard_s,
                ignored,
                conflicts: member.conflicts,
                waiting_frames: member.waiting_frames,
                clock_offset_slots: member.clock_offset_slots,
            };
            (id.to_string(), state)
        };
        Ok(Status {
            members: status.members.into_iter().map(member).collect(),
            own_clock_offset_slots: status.own_clock_offset_slots,
            own_events: status.own_events,
            located_events: status.located_events,
            unlocated_events: status.unlocated_events,
            longest_link_m: status.longest_link_m,
            live_packets: status.live_packets,
            accepted_frames: status.counts.get("accepted").copied().unwrap_or_default(),
            is_dense: status.is_dense,
            has_converged: status.fit.map(|fit| fit.converged),
        })
    }

    /// Returns everything that the vehicle must not lose.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.with(py, |agent| Ok(agent.snapshot()))?))
    }
}
