//! A mission in the order of time. Every receiver predicts an event before any vehicle learns from the transmission.
//! Packets are sent with the transmissions of the log.

use std::collections::BTreeMap;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentError, AgentOptions, Event, Link, Model, Receipt, Team, VehicleId, Which};

use crate::baseline::DistanceOnly;
use crate::event_log::EventLog;
use crate::mission::{CENTRALISED, probabilities, slots_of, transmissions};
use crate::plan::{Plan, Preshared};
use crate::score::Score;

/// Scores of predictions that were made before the events.
#[derive(Debug, Clone)]
pub struct Online {
    /// The team configuration.
    pub team: Arc<Team>,
    /// One entry per event, in the order of time.
    pub steps: Vec<Step>,
    /// Number of packets sent by every vehicle.
    pub packets: BTreeMap<VehicleId, usize>,
    /// Bytes of all packets.
    pub bytes: usize,
    /// Number of receptions of packets that were accepted.
    pub received: usize,
    /// Bytes of piggybacked outcomes in all transmissions.
    pub piggyback_bytes: usize,
    /// Final weight of the given model in the predictions of every vehicle: its posterior probability, next to the
    /// prior of a team without data. Empty if no model was given.
    pub model_weights: BTreeMap<VehicleId, f64>,
}

/// Data that are sent with the transmissions of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TrafficPlan {
    /// A vehicle may send a packet with every n-th of its transmissions, if the packet is useful. `None`: never.
    pub slot_every: Option<usize>,
    /// Bytes in every transmission for the newest outcomes of its sender, at most eight.
    pub piggyback_bytes: usize,
}

/// Scores of one event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Time of the event in seconds.
    pub time_s: f64,
    /// Number of earlier events of the receiver.
    pub earlier: usize,
    /// NLL of the outcome by [`DistanceOnly`] of the receiver's own earlier events; before any, even odds.
    pub range_only: f64,
    /// NLL of the outcome by the receiver's own earlier events.
    pub own: f64,
    /// NLL of the outcome by these events and the received data.
    pub team: f64,
    /// NLL of the outcome by all earlier events of all vehicles, without delay.
    pub centralised: f64,
}

impl Online {
    /// Returns the mean NLL of all events so far, at up to `places` times spread over the mission.
    pub fn running(&self, places: usize) -> Vec<Step> {
        let (count, places) = (self.steps.len(), self.steps.len().min(places));
        (1..=places).filter_map(|n| Step::mean(&self.steps[..n * count / places])).collect()
    }
}

impl Step {
    /// Returns the mean of some steps, at the time of the last; `None` of none.
    pub fn mean<'a>(steps: impl IntoIterator<Item = &'a Step>) -> Option<Step> {
        let steps: Vec<&Step> = steps.into_iter().collect();
        let mean = |of: fn(&Step) -> f64| steps.iter().map(|step| of(step)).sum::<f64>() / steps.len() as f64;
        let last = steps.last()?;
        Some(Step {
            time_s: last.time_s,
            earlier: last.earlier,
            range_only: mean(|step| step.range_only),
            own: mean(|step| step.own),
            team: mean(|step| step.team),
            centralised: mean(|step| step.centralised),
        })
    }
}

/// Runs the mission. Every transmission of a vehicle is one of its slots. A vehicle that heard the transmission in the
/// log also receives its packet and piggybacked outcomes, unless the channel loses them.
///
/// Without a given model, the prior of the first structure is used, with the optional terms of
/// [`crate::Preshared::Nothing`]. No event is therefore predicted by a model that was learned from it. With a given
/// model, predictions are averages over that model and that prior ([`Agent::average_with`]), because the model may come
/// from other water. `step` is called after every event.
///
/// # Errors
/// Returns [`AgentError`] for a numerical failure.
pub fn online(log: &EventLog, plan: &Plan, traffic: TrafficPlan, step: &dyn Fn()) -> Result<Online, AgentError> {
    let nothing = Observer { times_s: &[], observe: &mut |_, _| Ok(()) };
    online_observed(log, plan, traffic, step, nothing)
}

/// Vehicles of a mission in progress.
pub type Vehicles = BTreeMap<VehicleId, Agent>;

/// An observer of a mission in progress. It cannot change the vehicles, so that scores do not depend on it.
pub struct Observer<'a, E> {
    /// Times of the observations in seconds, in ascending order.
    pub times_s: &'a [f64],
    /// Function that gets each time, and all receivers of the log after the transmissions up to that time.
    pub observe: &'a mut dyn FnMut(f64, &Vehicles) -> Result<(), E>,
}

/// Runs the mission as [`online`] does, and shows the vehicles to an observer at some times.
///
/// # Errors
/// Returns [`AgentError`] for a numerical failure, and the errors of the observer.
pub fn online_observed<E: From<AgentError>>(
    log: &EventLog,
    plan: &Plan,
    traffic: TrafficPlan,
    step: &dyn Fn(),
    observer: Observer<E>,
) -> Result<Online, E> {
    let (team, _) = plan.team(log, None)?;
    // Piggybacking is requested explicitly, so a key does not turn it off.
    let piggyback = if traffic.piggyback_bytes > 0 { Some(true) } else { team.piggyback };
    let team = Team { slots: slots_of(&log.events), piggyback, ..team };
    let alternative = match &plan.preshared {
        Preshared::Nothing => None,
        Preshared::Model(_) | Preshared::Team(_) => Some(plan.model_before_data(log, &team.model)?),
    };
    let mut mission = Run::new(log, Arc::new(team), plan, traffic, alternative)?;
    let Observer { times_s, observe } = observer;
    let mut times_s = times_s.iter().copied().peekable();
    for transmission in &transmissions(&log.events) {
        while let Some(time_s) = times_s.next_if(|&time_s| time_s < transmission[0].time_s) {
            observe(time_s, &mission.vehicles)?;
        }
        mission.transmit(transmission)?;
        transmission.iter().for_each(|_| step());
    }
    times_s.try_for_each(|time_s| observe(time_s, &mission.vehicles))?;
    Ok(mission.finish())
}

/// A mission in progress.
struct Run<'a> {
    plan: &'a Plan,
    traffic: TrafficPlan,
    vehicles: Vehicles,
    /// Copies of the vehicles without received data, if predictions are averages. Otherwise own posteriors are
    /// equivalent.
    alone: Vehicles,
    centralised: Agent,
    /// Links and outcomes of the earlier events of every receiver.
    earlier: BTreeMap<VehicleId, (Vec<Link>, Vec<bool>)>,
    /// Number of transmissions of every vehicle so far.
    slots: BTreeMap<VehicleId, usize>,
    online: Online,
}

impl<'a> Run<'a> {
    fn new(
        log: &EventLog,
        team: Arc<Team>,
        plan: &'a Plan,
        traffic: TrafficPlan,
        alternative: Option<Model>,
    ) -> Result<Self, AgentError> {
        let options = AgentOptions { sharing: plan.sharing, ..AgentOptions::default() };
        let agent = |id: VehicleId, options: AgentOptions| -> Result<Agent, AgentError> {
            let mut agent = Agent::new(id, team.clone(), options);
            alternative.iter().try_for_each(|alternative| agent.average_with(alternative.clone()))?;
            Ok(agent)
        };
        let vehicle = |id: VehicleId| Ok((id.clone(), agent(id, options)?));
        let vehicles = log.vehicles().into_iter().map(vehicle).collect::<Result<Vehicles, AgentError>>()?;
        let shore = AgentOptions { record_all_receivers: true, ..options };
        Ok(Self {
            plan,
            traffic,
            alone: if alternative.is_some() { vehicles.clone() } else { BTreeMap::new() },
            vehicles,
            centralised: agent(VehicleId::new(CENTRALISED), shore)?,
            earlier: BTreeMap::new(),
            slots: BTreeMap::new(),
            online: Online {
                team,
                steps: Vec::new(),
                packets: BTreeMap::new(),
                bytes: 0,
                received: 0,
                piggyback_bytes: 0,
                model_weights: BTreeMap::new(),
            },
        })
    }

    fn finish(mut self) -> Online {
        if !self.alone.is_empty() {
            let weight = |(id, agent): (&VehicleId, &Agent)| (id.clone(), 1.0 - agent.status().alternative_weight);
            self.online.model_weights = self.vehicles.iter().map(weight).collect();
        }
        self.online
    }

    /// Processes one transmission. Each receiver predicts its event, learns from it, and then receives the data.
    fn transmit(&mut self, events: &[&Event]) -> Result<(), AgentError> {
        let Some(first) = events.first() else { return Ok(()) };
        let (sender, time_s) = (&first.transmitter_id, first.time_s);
        if let Some(agent) = self.vehicles.get_mut(sender) {
            agent.record_positions([(time_s, first.link.transmitter)])?;
        }
        let slot = self.slots.entry(sender.clone()).or_default();
        *slot += 1;
        let (slot, frame_bytes) = (*slot, self.online.team.frame_bytes);
        let is_due = self.traffic.slot_every.is_some_and(|every| slot.is_multiple_of(every));
        let n_bits = 8 * self.traffic.piggyback_bytes;
        let recent = self.vehicles.get_mut(sender).and_then(|agent| agent.piggyback(time_s, n_bits));
        self.online.piggyback_bytes += recent.map_or(0, |_| self.traffic.piggyback_bytes);
        let packet = match self.vehicles.get_mut(sender) {
            Some(agent) if is_due && agent.team().is_member(agent.id()) => {
                // The time of a slot is known in advance, so there is time to refit before sending.
                agent.refit()?;
                agent.next_frame(Some(time_s), frame_bytes)?
            }
            _ => None,
        };
        if let Some(packet) = &packet {
            *self.online.packets.entry(sender.clone()).or_default() += 1;
            self.online.bytes += packet.bytes.len();
        }
        self.apply(events)?;
        for event in events.iter().filter(|event| event.success) {
            self.deliver(event, slot, |agent| {
                if let Some(bits) = recent {
                    agent.receive_piggyback(sender, time_s, bits, n_bits);
                }
                packet.as_ref().map(|packet| agent.receive(&packet.bytes, Some(time_s)).receipt)
            });
        }
        Ok(())
    }

    /// Lets all receivers of a transmission, and the centralised vehicle, predict the events and then learn from them.
    fn apply(&mut self, events: &[&Event]) -> Result<(), AgentError> {
        let Self { vehicles, alone, centralised, .. } = self;
        let (mine, all) = rayon::join(
            || -> Result<Vec<_>, AgentError> {
                let mut predicted = Vec::with_capacity(events.len());
                for &event in events {
                    let Some(agent) = vehicles.get_mut(&event.receiver_id) else { continue };
                    let own = match alone.get_mut(&event.receiver_id) {
                        Some(alone) => predict_and_record(alone, event)?,
                        None => agent.predict([event.query()], Which::Own)?[0].probability,
                    };
                    predicted.push((event, own, predict_and_record(agent, event)?));
                }
                Ok(predicted)
            },
            || -> Result<Vec<f64>, AgentError> {
                let all = probabilities(centralised, &events.iter().map(|event| event.query()).collect::<Vec<_>>())?;
                events.iter().try_for_each(|&event| record_and_refit(centralised, [event.clone()]))?;
                Ok(all)
            },
        );
        for ((event, own, team), all) in mine?.into_iter().zip(all?) {
            let nll = |p: f64| Score::new(&[p], &[event.success]).map_or(0.0, |score| score.nll);
            let (links, outcomes) = self.earlier.entry(event.receiver_id.clone()).or_default();
            let range_only = DistanceOnly::fit(links, outcomes).probability(&event.link);
            self.online.steps.push(Step {
                time_s: event.time_s,
                earlier: links.len(),
                range_only: nll(range_only),
                own: nll(own),
                team: nll(team),
                centralised: nll(all),
            });
            links.push(event.link);
            outcomes.push(event.success);
        }
        Ok(())
    }

    /// Delivers the data of a transmission: never, once or twice. They cannot be reordered.
    fn deliver(&mut self, event: &Event, slot: usize, read: impl Fn(&mut Agent) -> Option<Receipt>) {
        let number = |id: &VehicleId| self.online.team.number(id).map_or(usize::from(u8::MAX) + 1, usize::from);
        let (sender, receiver) = (number(&event.transmitter_id), number(&event.receiver_id));
        let times = self.plan.impairments.delays(slot - 1, self.plan.seed, sender, receiver).len();
        let Some(agent) = self.vehicles.get_mut(&event.receiver_id) else { return };
        for _ in 0..times {
            self.online.received += usize::from(read(agent) == Some(Receipt::Accepted));
        }
    }
}

/// Returns the probability of an event before it is recorded, and records it.
fn predict_and_record(agent: &mut Agent, event: &Event) -> Result<f64, AgentError> {
    let probability = agent.probability(event.query())?;
    record_and_refit(agent, [event.clone()])?;
    Ok(probability)
}

/// Records events, and refits if a refit is due.
///
/// # Errors
/// Returns [`AgentError`] for an event of another receiver and for a numerical failure.
pub fn record_and_refit(agent: &mut Agent, events: impl IntoIterator<Item = Event>) -> Result<(), AgentError> {
    agent.record(events)?;
    if agent.refit_due() { agent.refit() } else { Ok(()) }
}
