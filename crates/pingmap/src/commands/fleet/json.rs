//! The result of a fleet in JSON.

use pingmap_trial::{EventLog, Online, Step};
use schemars::JsonSchema;
use serde::Serialize;

use super::mission::Outcome;

/// The result of `pingmap fleet`.
#[derive(Serialize, JsonSchema)]
pub struct FleetJson {
    /// Version of this object.
    schema: u32,
    /// Digest of the log.
    log_digest: String,
    /// State of every vehicle at the quarters of the mission.
    known: Vec<KnownJson>,
    /// The vehicle that was killed, if one was.
    killed: Option<KilledJson>,
    /// Number of frames that were sent.
    frames: usize,
    /// Mean NLL of all events that the processes predicted before they learned them.
    nll: f64,
    /// Number of these events.
    events: usize,
    /// Mean NLL of the same mission by `replay --online`: of the team, of own events alone, and of range alone.
    replayed: Option<ReplayedJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct KnownJson {
    /// Share of the mission that has passed.
    share: f64,
    /// Time in seconds.
    time_s: f64,
    /// The vehicle.
    vehicle: String,
    /// Its own events.
    own_events: usize,
    /// Located events of other members.
    other_events: usize,
    /// Mean NLL of its own events so far.
    nll: Option<f64>,
    /// Number of events in that mean.
    scored: usize,
    /// Weight of the map next to range alone.
    map_weight: f64,
}

#[derive(Serialize, JsonSchema)]
pub struct KilledJson {
    /// The vehicle.
    vehicle: String,
    /// Time in seconds.
    time_s: f64,
    /// Its own events before.
    events_before: usize,
    /// Its own events after.
    events_after: usize,
}

#[derive(Serialize, JsonSchema)]
pub struct ReplayedJson {
    /// NLL of the team.
    team: f64,
    /// NLL of own events alone.
    own: f64,
    /// NLL of range alone.
    range_only: f64,
}

impl FleetJson {
    pub fn of(log: &EventLog, outcome: &Outcome, replayed: &Online) -> Self {
        let known = outcome.known.iter().map(|known| KnownJson {
            share: known.share,
            time_s: known.time_s,
            vehicle: known.vehicle.to_string(),
            own_events: known.own_events,
            other_events: known.other_events,
            nll: known.nll,
            scored: known.scored,
            map_weight: known.trust.map_weight,
        });
        let killed = outcome.killed.as_ref().map(|killed| KilledJson {
            vehicle: killed.vehicle.to_string(),
            time_s: killed.time_s,
            events_before: killed.events[0],
            events_after: killed.events[1],
        });
        let mean = Step::mean(&replayed.steps);
        Self {
            schema: 1,
            log_digest: log.digest(),
            known: known.collect(),
            killed,
            frames: outcome.frames,
            nll: outcome.nll,
            events: outcome.scored,
            replayed: mean.map(|Step { team, own, range_only, .. }| ReplayedJson { team, own, range_only }),
        }
    }
}
