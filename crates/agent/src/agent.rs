//! One vehicle: the events it owns, what it learned from them, what it tells the others and what it heard from them.

use std::collections::BTreeMap;
use std::sync::Arc;

use dgpc::{Candidates, Inputs, MeanField, Observations, Posterior, Prior, Sites, Summary, mean_field};

use crate::event::{Event, Link, VehicleId};
use crate::learning::{Fit, Learning};
use crate::limits::Limits;
use crate::model::Model;

/// What an agent can refuse to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// Events arrived since the agent last learned, or it never did.
    #[error("vehicle {id} has {events} events that it has not learned from yet")]
    NotLearned {
        /// The vehicle.
        id: VehicleId,
        /// How many events it has in all.
        events: usize,
    },
    /// A packet was formed under another model than the agent's.
    #[error("vehicle {id} cannot use a packet of {sender}: it was formed under another model")]
    ForeignPacket {
        /// The vehicle.
        id: VehicleId,
        /// Who sent the packet.
        sender: VehicleId,
    },
    /// The method refused.
    #[error(transparent)]
    Method(#[from] dgpc::Error),
}

/// Which message a packet carries about its region (docs/method.md, section 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SummaryKind {
    /// The exact message about the inducing points: never overconfident.
    Marginal,
    /// The paper's: additive over events, overconfident where a region is too large for its points.
    Variational,
}

/// How packets are put together (docs/method.md, section 6).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fusion {
    /// Packets join the vehicle's own raw events as sites; the prior counts once.
    Sites,
    /// The paper's: all packets, the vehicle's own included, stacked block by block; raw events stay out.
    Concatenation,
}

/// What an agent sends: its message about one region of its events.
#[derive(Debug, Clone)]
pub struct Packet {
    /// Who sent it.
    pub sender: VehicleId,
    /// Which of the sender's regions it is about.
    pub region: usize,
    /// How many events it sums up.
    pub events: usize,
    /// The message: inducing points, and what the events say about them.
    pub summary: Summary,
}

/// The inducing points of an agent's packets, in the order of sending: the first F packets of a plan are the plan for F.
#[derive(Debug, Clone)]
pub struct PacketPlan {
    /// Inducing points of each packet.
    packets: Vec<Inputs>,
}

impl PacketPlan {
    /// How many packets are worth sending, at most as many as were asked for.
    pub fn len(&self) -> usize {
        self.packets.len()
    }

    /// Whether nothing is worth sending.
    pub fn is_empty(&self) -> bool {
        self.packets.is_empty()
    }
}

/// How a fit went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitQuality {
    /// Whether the fixed point was reached.
    pub converged: bool,
    /// Largest change of a tilt in the last iteration.
    pub change: f64,
    /// What was added to a diagonal to factorise it (0 in the ordinary case).
    pub jitter: f64,
}

/// A fit of an agent's own events under some prior.
#[derive(Debug)]
struct Knowledge {
    quality: FitQuality,
    sites: Sites,
    /// Stands for the sites when they are too many to be used one by one.
    condensed: Option<Summary>,
}

impl Knowledge {
    /// Fits `observations` given what others said: densely up to [`Limits::dense_events_max`], sparsely beyond.
    fn fit(prior: &Prior, observations: &Observations, messages: &[&Summary], limits: &Limits) -> dgpc::Result<Self> {
        // Predictions move by far less than their own uncertainty at a tolerance of 1e-6 in the latent function.
        let options = mean_field::Options { tolerance: 1e-6, ..Default::default() };
        let quality = |fit: &MeanField| FitQuality { converged: fit.converged, change: fit.change, jitter: fit.jitter };
        if observations.len() <= limits.dense_events_max {
            let fit = mean_field::dense_with_messages(prior, observations, messages, &options)?;
            return Ok(Self { quality: quality(&fit), sites: fit.sites, condensed: None });
        }
        let candidates = limits.candidates(observations.inputs());
        let chosen = Candidates::new(prior.kernel(), &candidates)?.greedy(limits.inducing_points_max);
        let mut inducing_points = candidates.select(&chosen.indices);
        messages.iter().try_for_each(|message| inducing_points.append(message.inducing_points()))?;
        let fit = mean_field::sparse_with_messages(prior, observations, messages, &inducing_points, &options)?;
        let condensed = Some(Summary::variational(prior, &fit.sites, &inducing_points)?);
        Ok(Self { quality: quality(&fit), sites: fit.sites, condensed })
    }

    /// Own events and summaries, all under `prior`, put together.
    fn fuse(&self, prior: &Prior, summaries: &[&Summary]) -> dgpc::Result<Posterior> {
        match &self.condensed {
            None => Posterior::fuse(prior, &self.sites, summaries),
            Some(condensed) => {
                let none = Sites::empty(condensed.inducing_points().dimension());
                Posterior::fuse(prior, &none, &[summaries, &[condensed]].concat())
            }
        }
    }
}

/// A model that an agent learned by itself, and the fit of its own events under it.
#[derive(Debug)]
struct Own {
    fit: Fit,
    knowledge: Knowledge,
    /// How many events it had then.
    events: usize,
}

/// One vehicle. Events may arrive late and in any order; packets may arrive in any order and more than once.
///
/// ```
/// use pingmap_agent::*;
/// use std::sync::Arc;
///
/// let chart = Chart::about([]);
/// let shape = dgpc::Shape::SquaredExponential;
/// let model = Arc::new(Model::isotropic(chart, InputSpec::Positions, shape, true, 400.0, 4.0)?);
/// let link = |east_m| Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, 0.0) };
///
/// let mut alice = Agent::new(VehicleId::new("alice"), model.clone(), Limits::default());
/// for (time_s, east_m, success) in [(0.0, 100.0, true), (10.0, 200.0, true), (20.0, 900.0, false)] {
///     let (transmitter_id, receiver_id) = (VehicleId::new("bob"), VehicleId::new("alice"));
///     alice.observe(Event { time_s, transmitter_id, receiver_id, link: link(east_m), success });
/// }
/// alice.learn()?;
/// let plan = alice.plan_packets(1, 2)?;
///
/// let mut bob = Agent::new(VehicleId::new("bob"), model, Limits::default());
/// bob.learn()?;
/// for packet in alice.packets(&plan, 1, SummaryKind::Marginal)? {
///     bob.receive(packet)?;
/// }
/// let p = bob.probability(&[link(150.0), link(900.0)], Fusion::Sites)?;
/// assert!(p[0] > 0.5 && p[1] < 0.5);
/// # Ok::<(), pingmap_agent::AgentError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Agent {
    id: VehicleId,
    model: Arc<Model>,
    limits: Limits,
    /// In [`Event::canonical_order`], so that results do not depend on the order of arrival; shared by copies of the agent.
    events: Arc<Vec<Event>>,
    knowledge: Option<Arc<Knowledge>>,
    /// Its own model, once it learned one.
    own: Option<Arc<Own>>,
    /// The latest packet of every region, in an order that does not depend on arrival.
    received: BTreeMap<(VehicleId, usize), Packet>,
}

impl Agent {
    /// A vehicle that has seen nothing.
    pub fn new(id: VehicleId, model: Arc<Model>, limits: Limits) -> Self {
        Self { id, model, limits, events: Arc::default(), knowledge: None, own: None, received: BTreeMap::new() }
    }

    /// Who it is.
    pub fn id(&self) -> &VehicleId {
        &self.id
    }

    /// The model it shares with its team.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Its own events, in canonical order.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Records an event. O(1) for one later than all before, O(N) otherwise.
    pub fn observe(&mut self, event: Event) {
        let events = Arc::make_mut(&mut self.events);
        let place = events.partition_point(|known| known.canonical_order(&event).is_le());
        events.insert(place, event);
        self.knowledge = None;
    }

    /// Records many events in any order. O(N log N).
    pub fn observe_all(&mut self, new: impl IntoIterator<Item = Event>) {
        let events = Arc::make_mut(&mut self.events);
        events.extend(new);
        events.sort_by(Event::canonical_order);
        self.knowledge = None;
    }

    /// Fits its own events by mean field under the team's model: densely up to [`Limits::dense_events_max`], O(N³) an iteration,
    /// sparsely beyond.
    ///
    /// # Errors
    /// [`AgentError::Method`] when a position is not finite.
    pub fn learn(&mut self) -> Result<(), AgentError> {
        let observations = self.model.observations(self.events.iter())?;
        self.knowledge = Some(Arc::new(Knowledge::fit(&self.model.prior, &observations, &[], &self.limits)?));
        Ok(())
    }

    /// Learns a model of its own from its own events and from what others said, and from then on predicts under that. What it
    /// sends stays under the team's model. The first time every structure is tried; later the chosen one goes on from its last
    /// optimum, at the cost of one search that never ends worse in E than it began.
    ///
    /// # Errors
    /// As [`Learning::best`].
    pub fn adapt(&mut self, learning: &Learning) -> Result<&Fit, AgentError> {
        let Model { chart, inputs, .. } = *self.model;
        let messages = self.messages();
        let events = self.events.iter();
        let fit = match &self.own {
            Some(own) => learning.fit(&own.fit.structure, chart, inputs, events, &messages, Some(&own.fit))?,
            None => learning.best(chart, inputs, events, &messages)?,
        };
        let observations = fit.model.observations(self.events.iter())?;
        let knowledge = Knowledge::fit(&fit.model.prior, &observations, &messages, &self.limits)?;
        let events = self.events.len();
        Ok(&self.own.insert(Arc::new(Own { fit, knowledge, events })).fit)
    }

    /// The model it learned by itself, if it did.
    pub fn own_fit(&self) -> Option<&Fit> {
        self.own.as_ref().map(|own| &own.fit)
    }

    /// What others said. What it sent itself it knows better from its own events.
    fn messages(&self) -> Vec<&Summary> {
        let others = self.received.values().filter(|packet| packet.sender != self.id);
        others.map(|packet| &packet.summary).collect()
    }

    /// How the fit to its own events went.
    ///
    /// # Errors
    /// [`AgentError::NotLearned`] when events arrived since [`Agent::learn`].
    pub fn fit_quality(&self) -> Result<FitQuality, AgentError> {
        Ok(self.knowledge()?.quality)
    }

    /// Whether its events are few enough for a dense fit.
    pub fn learns_densely(&self) -> bool {
        self.events.len() <= self.limits.dense_events_max
    }

    fn knowledge(&self) -> Result<&Knowledge, AgentError> {
        self.knowledge.as_deref().ok_or_else(|| self.not_learned())
    }

    fn not_learned(&self) -> AgentError {
        AgentError::NotLearned { id: self.id.clone(), events: self.events.len() }
    }

    /// Chooses the inducing points of up to `frames` packets of `points_per_frame` points: packet by packet the points that leave
    /// the least prior variance at its own events unexplained, given the packets before. Fewer where nothing is left to tell.
    ///
    /// # Errors
    /// [`AgentError::NotLearned`] when events arrived since [`Agent::learn`].
    pub fn plan_packets(&self, frames: usize, points_per_frame: usize) -> Result<PacketPlan, AgentError> {
        let inputs = self.limits.candidates(self.knowledge()?.sites.inputs());
        let mut candidates = Candidates::new(self.model.prior.kernel(), &inputs)?;
        let mut packets = Vec::new();
        while packets.len() < frames {
            let chosen = candidates.good(points_per_frame);
            if chosen.indices.is_empty() {
                break;
            }
            candidates.condition_on(&chosen.indices);
            packets.push(inputs.select(&chosen.indices));
        }
        Ok(PacketPlan { packets })
    }

    /// The first `frames` packets of a plan. Every own event goes into exactly one of them: that of the inducing point with which
    /// it correlates most. O(region³) a packet for marginal summaries.
    ///
    /// # Errors
    /// [`AgentError::NotLearned`] when events arrived since [`Agent::learn`].
    pub fn packets(&self, plan: &PacketPlan, frames: usize, kind: SummaryKind) -> Result<Vec<Packet>, AgentError> {
        let knowledge = self.knowledge()?;
        let points = &plan.packets[..frames.min(plan.packets.len())];
        let regions = self.regions(knowledge.sites.inputs(), points)?;
        let packet = |(region, (points, members)): (usize, (&Inputs, Vec<usize>))| {
            let summary = self.summarise(knowledge, &members, points, kind)?;
            Ok(Packet { sender: self.id.clone(), region, events: members.len(), summary })
        };
        points.iter().zip(regions).enumerate().map(packet).collect()
    }

    /// For every packet the events that it speaks for.
    fn regions(&self, inputs: &Inputs, packets: &[Inputs]) -> Result<Vec<Vec<usize>>, AgentError> {
        let kernel = self.model.prior.kernel();
        let mut best = vec![(0, f64::NEG_INFINITY); inputs.len()];
        for (packet, points) in packets.iter().enumerate() {
            let covariance = kernel.cross(inputs, points)?;
            for (column, variance) in kernel.diagonal(points)?.iter().enumerate() {
                for (best, k) in best.iter_mut().zip(covariance.column(column)) {
                    // k² / k(z, z): the prior variance at the event that the point explains.
                    let explained = k * k / variance;
                    if explained > best.1 {
                        *best = (packet, explained);
                    }
                }
            }
        }
        let mut regions = vec![Vec::new(); packets.len()];
        if !packets.is_empty() {
            best.iter().enumerate().for_each(|(event, &(packet, _))| regions[packet].push(event));
        }
        Ok(regions)
    }

    /// The message of the events at `members` about `points`.
    fn summarise(
        &self,
        knowledge: &Knowledge,
        members: &[usize],
        points: &Inputs,
        kind: SummaryKind,
    ) -> Result<Summary, AgentError> {
        let prior = &self.model.prior;
        let sites = knowledge.sites.select(members);
        match (kind, &knowledge.condensed) {
            (SummaryKind::Variational, _) => Ok(Summary::variational(prior, &sites, points)?),
            (SummaryKind::Marginal, Some(condensed)) if members.len() > self.limits.dense_events_max => {
                // The region's share of the sparse fit stands for its events.
                let region = Summary::variational(prior, &sites, condensed.inducing_points())?;
                let none = Sites::empty(points.dimension());
                Ok(Posterior::fuse(prior, &none, &[&region])?.summarise(points)?)
            }
            (SummaryKind::Marginal, _) => Ok(Summary::marginal(prior, &sites, points)?),
        }
    }

    /// Takes in a packet; one of the same sender and region replaces the older. Its own packets are kept for
    /// [`Fusion::Concatenation`] only.
    ///
    /// # Errors
    /// [`AgentError::ForeignPacket`] when it was formed under another model.
    pub fn receive(&mut self, packet: Packet) -> Result<(), AgentError> {
        if packet.summary.prior() != &self.model.prior {
            return Err(AgentError::ForeignPacket { id: self.id.clone(), sender: packet.sender });
        }
        self.received.insert((packet.sender.clone(), packet.region), packet);
        Ok(())
    }

    /// Its own events and all packets put together, under its own model if it learned one. O(n³), n = own events + all inducing
    /// points.
    ///
    /// # Errors
    /// [`AgentError::NotLearned`] when events arrived since [`Agent::learn`], or since [`Agent::adapt`] if it has a model of its own.
    pub fn posterior(&self, fusion: Fusion) -> Result<Posterior, AgentError> {
        let team = &self.model.prior;
        if fusion == Fusion::Concatenation {
            self.knowledge()?;
            let summaries: Vec<&Summary> = self.received.values().map(|packet| &packet.summary).collect();
            return Ok(Posterior::concatenate(team, &summaries)?);
        }
        match &self.own {
            None => Ok(self.knowledge()?.fuse(team, &self.messages())?),
            Some(own) if own.events < self.events.len() => Err(self.not_learned()),
            Some(own) => {
                let prior = &own.fit.model.prior;
                let messages =
                    self.messages().iter().map(|message| message.under(prior)).collect::<dgpc::Result<Vec<_>>>()?;
                Ok(own.knowledge.fuse(prior, &messages.iter().collect::<Vec<_>>())?)
            }
        }
    }

    /// Probability of success over each link. See [`Agent::posterior`].
    ///
    /// # Errors
    /// As [`Agent::posterior`]; [`AgentError::Method`] when a position is not finite.
    pub fn probability(&self, links: &[Link], fusion: Fusion) -> Result<Vec<f64>, AgentError> {
        let inputs = self.model.inputs(links)?;
        Ok(self.posterior(fusion)?.probability(&inputs)?)
    }
}
