//! One split of a log as a mission: vehicles that learned from their training events, their packets, and the held-out
//! events.

use std::sync::Arc;

use dgpc::Latent;
use pingmap_agent::{
    Agent, AgentError, AgentOptions, Event, LearnedModel, Link, LinkQuery, ScheduledTransmission, Slots, Team,
    VehicleId, Which,
};
use pingmap_packet::ReportLayout;
use rayon::prelude::*;

use crate::event_log::EventLog;
use crate::plan::{ModelSource, Plan};
use crate::split::Split;

/// A team after learning from its training events, and the packets that it sends.
#[derive(Debug, Clone)]
pub struct Mission {
    /// The team configuration.
    pub team: Arc<Team>,
    /// Fit of the model, if it was learned.
    pub fit: Option<LearnedModel>,
    /// Every vehicle in alphabetical order, before it received packets.
    pub vehicles: Vec<Agent>,
    /// A vehicle with all training events: the reference that sharing tries to reach.
    pub centralised: Agent,
    /// Packets of each vehicle, in order. There may be fewer than requested if no further data are worth a frame.
    pub packets: Vec<Vec<Vec<u8>>>,
    /// Queries of the held-out events.
    pub held_out: Vec<LinkQuery>,
    /// Outcomes of the held-out events.
    pub outcomes: Vec<bool>,
    /// Links of all training events, in log order.
    pub training: Vec<Link>,
    /// Outcomes of the training events.
    pub training_outcomes: Vec<bool>,
    /// Time at which frames are received: that of the last event of the log, in seconds.
    pub end_s: f64,
    plan: Plan,
}

/// Traffic of a vehicle, the mean over vehicles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Traffic {
    /// Number of packets. It is smaller than requested if no further data are worth a frame.
    pub packets: f64,
    /// Number of these packets that are reports.
    pub reports: f64,
    /// Bytes of all packets.
    pub bytes: f64,
    /// Share of the other vehicles' events that a vehicle received one by one.
    pub remote_event_share: f64,
}

impl Traffic {
    /// Returns the mean of several; `None` of none.
    pub fn mean(all: &[Self]) -> Option<Self> {
        let mean = |of: fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        (!all.is_empty()).then(|| Self {
            packets: mean(|traffic| traffic.packets),
            reports: mean(|traffic| traffic.reports),
            bytes: mean(|traffic| traffic.bytes),
            remote_event_share: mean(|traffic| traffic.remote_event_share),
        })
    }
}

impl Mission {
    /// Divides the log, learns the model, lets every vehicle learn from its own training events, and forms up to
    /// `frames_max` packets of each. Vehicles run in parallel on the current thread pool.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn prepare(log: &EventLog, split: &Split, plan: &Plan, frames_max: usize) -> Result<Self, AgentError> {
        let events = |held_out| split.indices(held_out).into_iter().map(|n| &log.events[n]).collect::<Vec<_>>();
        let (training, held_out) = (events(false), events(true));
        let (team, fit) = plan.team(log, Some(&training))?;
        let team = Arc::new(Team { slots: slots_of(training.iter().copied()), ..team });
        let options = AgentOptions { sharing: plan.sharing, record_all_receivers: true, ..AgentOptions::default() };
        let learn = |id: VehicleId, owns: &(dyn Fn(&Event) -> bool + Sync)| -> Result<Agent, AgentError> {
            let mut agent = Agent::new(id.clone(), team.clone(), options);
            agent.record_positions(log.track(&id))?;
            agent.record(training.iter().filter(|event| owns(event)).map(|event| (*event).clone()))?;
            agent.rebuild()?;
            if plan.model_source == ModelSource::Own {
                agent.adapt(&plan.learning)?;
            }
            Ok(agent)
        };
        let learn_vehicle = |id: VehicleId| {
            let agent = learn(id.clone(), &|event| event.receiver_id == id)?;
            let packets = send_frames(&mut agent.clone(), frames_max)?;
            Ok((agent, packets))
        };
        let (vehicles, centralised) = rayon::join(
            || log.vehicles().into_par_iter().map(learn_vehicle).collect::<Result<Vec<_>, AgentError>>(),
            || learn(VehicleId::new(CENTRALISED), &|_| true),
        );
        let (vehicles, packets) = vehicles?.into_iter().unzip();
        let links = |events: &[&Event]| events.iter().map(|event| event.link).collect();
        let attempts = held_out.iter().map(|event| event.query()).collect();
        let outcomes = |events: &[&Event]| events.iter().map(|event| event.success).collect();
        Ok(Self {
            team,
            fit,
            vehicles,
            centralised: centralised?,
            packets,
            held_out: attempts,
            outcomes: outcomes(&held_out),
            training: links(&training),
            training_outcomes: outcomes(&training),
            end_s: log.events.iter().map(|event| event.time_s).fold(f64::NEG_INFINITY, f64::max),
            plan: plan.clone(),
        })
    }

    /// Returns the seed of all random numbers.
    pub fn seed(&self) -> u64 {
        self.plan.seed
    }

    /// Returns the first `frames` packets of every vehicle.
    pub fn sent(&self, frames: usize) -> impl Iterator<Item = &[Vec<u8>]> {
        self.packets.iter().map(move |packets| &packets[..frames.min(packets.len())])
    }

    /// Returns the links in the first `frames` packets of the vehicle at `place`, as decoded by a listener.
    pub fn links_of_packets(&self, place: usize, frames: usize) -> Vec<(VehicleId, u16, Vec<Link>)> {
        let mut listener = Agent::new(VehicleId::new(CENTRALISED), self.team.clone(), AgentOptions::default());
        for packet in self.sent(frames).nth(place).unwrap_or_default() {
            listener.receive(packet, Some(self.end_s));
        }
        listener.links_of_packets()
    }

    /// Returns the traffic of the first `frames` packets. The share of received events is that of `team`, the result of
    /// [`Mission::after_sharing`].
    pub fn traffic(&self, frames: usize, team: &[Agent]) -> Traffic {
        let vehicles = self.packets.len().max(1) as f64;
        let reports = self.sent(frames).flatten().filter(|packet| ReportLayout::of(packet).is_some()).count();
        let others = team.iter().map(|agent| self.training.len() - agent.events().len()).sum::<usize>().max(1);
        let located = team.iter().map(|agent| agent.status().located_events).sum::<usize>();
        Traffic {
            packets: self.sent(frames).map(<[_]>::len).sum::<usize>() as f64 / vehicles,
            reports: reports as f64 / vehicles,
            bytes: self.sent(frames).flatten().map(Vec::len).sum::<usize>() as f64 / vehicles,
            remote_event_share: located as f64 / others as f64,
        }
    }

    /// Returns the team after every vehicle received the first `frames` packets of the others over the channel. If
    /// every vehicle learns by itself, it then learns from the received data.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn after_sharing(&self, frames: usize) -> Result<Vec<Agent>, AgentError> {
        let receive = |(receiver, agent): (usize, &Agent)| {
            let mut agent = agent.clone();
            for (sender, packets) in self.sent(frames).enumerate().filter(|&(sender, _)| sender != receiver) {
                for place in self.plan.impairments.arrivals(packets.len(), self.plan.seed, sender, receiver) {
                    agent.receive(&packets[place], Some(self.end_s));
                }
            }
            if agent.status().located_events > 0 {
                // The centralised vehicle rebuilds its posterior, too.
                agent.rebuild()?;
            }
            if self.plan.model_source == ModelSource::Own {
                agent.adapt(&self.plan.learning)?;
            }
            Ok(agent)
        };
        self.vehicles.par_iter().enumerate().map(receive).collect()
    }

    /// Returns the centralised vehicle's predictions for the held-out events.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn predict_centralised(&self) -> Result<Vec<f64>, AgentError> {
        probabilities(&mut self.centralised.clone(), &self.held_out)
    }

    /// Returns each vehicle's predictions for the held-out events from its own events.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn predict_alone(&self) -> Result<Vec<Vec<f64>>, AgentError> {
        self.predict(self.vehicles.clone())
    }

    /// Returns each vehicle's predictions for the held-out events, after all vehicles sent their first `frames`
    /// packets.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn predict_as_team(&self, frames: usize) -> Result<Vec<Vec<f64>>, AgentError> {
        self.predict(self.after_sharing(frames)?)
    }

    /// Returns an agent's posterior of the latent function at the held-out events.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn latent(&self, agent: &Agent) -> Result<Latent, AgentError> {
        let inputs = agent.team().model.inputs(&self.held_out)?;
        Ok(agent.clone().posterior(Which::Fused)?.latent(&inputs)?)
    }

    /// Returns the moments from which the agent's intervals at the held-out events follow.
    ///
    /// # Errors
    /// Returns [`AgentError`] for a numerical failure.
    pub fn interval_latent(&self, agent: &Agent) -> Result<Latent, AgentError> {
        let predictions = agent.clone().predict_intervals(&self.held_out)?;
        let moments = predictions.into_iter().filter_map(|prediction| prediction.interval);
        let (mean, variance) = moments.map(|interval| (interval.mean, interval.variance)).unzip();
        Ok(Latent { mean, variance })
    }

    pub(crate) fn predict(&self, mut team: Vec<Agent>) -> Result<Vec<Vec<f64>>, AgentError> {
        team.par_iter_mut().map(|agent| probabilities(agent, &self.held_out)).collect()
    }
}

/// Returns the probability of each query.
///
/// # Errors
/// Returns [`AgentError`] for a numerical failure.
pub fn probabilities(agent: &mut Agent, queries: &[LinkQuery]) -> Result<Vec<f64>, AgentError> {
    let predictions = agent.predict(queries, Which::Fused)?;
    Ok(predictions.into_iter().map(|prediction| prediction.probability).collect())
}

/// Returns the events of each transmission, in the order of time.
pub fn transmissions<'a>(events: impl IntoIterator<Item = &'a Event>) -> Vec<Vec<&'a Event>> {
    let mut events: Vec<&Event> = events.into_iter().collect();
    events.sort_by(|a, b| a.canonical_order(b));
    let is_same = |a: &&Event, b: &&Event| a.time_s == b.time_s && a.transmitter_id == b.transmitter_id;
    events.chunk_by(is_same).map(<[_]>::to_vec).collect()
}

/// Returns the transmissions of these events as slots with their listeners: a schedule for logs without one.
pub(crate) fn slots_of<'a>(events: impl IntoIterator<Item = &'a Event>) -> Slots {
    let opportunity = |events: &Vec<&Event>| ScheduledTransmission {
        time_s: events[0].time_s,
        sender: events[0].transmitter_id.clone(),
        listeners: events.iter().map(|event| event.receiver_id.clone()).collect(),
    };
    let listed: Vec<ScheduledTransmission> = transmissions(events).iter().map(opportunity).collect();
    Slots { explicit: Some(listed.into()), ..Slots::cycle(1.0, Vec::new()) }
}

/// A name that no vehicle of a log has.
pub(crate) const CENTRALISED: &str = "\u{0}all events";

/// Returns up to `frames` packets of a vehicle; none if the vehicle is not a member. There are fewer if no further data
/// are worth a frame.
///
/// # Errors
/// Returns [`AgentError`] for a numerical failure.
pub fn send_frames(agent: &mut Agent, frames: usize) -> Result<Vec<Vec<u8>>, AgentError> {
    let mut packets = Vec::new();
    if agent.team().is_member(agent.id()) {
        while packets.len() < frames
            && let Some(packet) = agent.next_frame(None, agent.team().frame_bytes)?
        {
            packets.push(packet.bytes);
        }
    }
    Ok(packets)
}
