//! One vehicle: the events it owns, what it learned from them, what it tells the others and what it heard from them.

use std::collections::BTreeMap;
use std::sync::Arc;

use dgpc::{Candidates, Inputs, MeanField, Observations, Posterior, Sites, Summary, mean_field};

use crate::event::{Event, Link, VehicleId};
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

/// Bounds on work and memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Up to so many events are fitted densely, O(N³); beyond, with inducing points, O(NM²).
    pub dense_events_max: usize,
    /// How many inducing points a sparse fit has at most.
    pub inducing_points_max: usize,
    /// How many events are candidates for inducing points at most: every k-th in time, with the smallest k that keeps to this.
    pub candidates_max: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { dense_events_max: 1000, inducing_points_max: 256, candidates_max: 1000 }
    }
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

/// What an agent learned from its own events.
#[derive(Debug)]
struct Knowledge {
    quality: FitQuality,
    sites: Sites,
    /// Stands for the sites when they are too many to be used one by one.
    condensed: Option<Summary>,
}

/// One vehicle. Events may arrive late and in any order; packets may arrive in any order and more than once.
///
/// ```
/// use pingmap_agent::*;
/// use std::sync::Arc;
///
/// let chart = Chart { origin: Position::new(0.0, 0.0), geographic: None };
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
    /// The latest packet of every region, in an order that does not depend on arrival.
    received: BTreeMap<(VehicleId, usize), Packet>,
}

impl Agent {
    /// A vehicle that has seen nothing.
    pub fn new(id: VehicleId, model: Arc<Model>, limits: Limits) -> Self {
        Self { id, model, limits, events: Arc::default(), knowledge: None, received: BTreeMap::new() }
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

    /// Fits its own events by mean field: densely up to [`Limits::dense_events_max`], O(N³) an iteration, sparsely beyond.
    ///
    /// # Errors
    /// [`AgentError::Method`] when a position is not finite.
    pub fn learn(&mut self) -> Result<(), AgentError> {
        let inputs = self.model.inputs(self.events.iter().map(|event| &event.link))?;
        let outcomes = self.events.iter().map(|event| event.success).collect();
        let observations = Observations::new(inputs, outcomes)?;
        let prior = &self.model.prior;
        // Predictions move by far less than their own uncertainty at a tolerance of 1e-6 in the latent function.
        let options = mean_field::Options { tolerance: 1e-6, ..Default::default() };
        let quality = |fit: &MeanField| FitQuality { converged: fit.converged, change: fit.change, jitter: fit.jitter };
        let knowledge = if self.learns_densely() {
            let fit = mean_field::dense(prior, &observations, &options)?;
            Knowledge { quality: quality(&fit), sites: fit.sites, condensed: None }
        } else {
            let candidates = self.candidate_inputs(observations.inputs());
            let chosen = Candidates::new(prior.kernel(), &candidates)?.greedy(self.limits.inducing_points_max);
            let inducing_points = candidates.select(&chosen.indices);
            let fit = mean_field::sparse(prior, &observations, &inducing_points, &options)?;
            let condensed = Some(Summary::variational(prior, &fit.sites, &inducing_points)?);
            Knowledge { quality: quality(&fit), sites: fit.sites, condensed }
        };
        self.knowledge = Some(Arc::new(knowledge));
        Ok(())
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

    /// Every k-th of its inputs in time, k the smallest that keeps to [`Limits::candidates_max`].
    fn candidate_inputs(&self, inputs: &Inputs) -> Inputs {
        let step = inputs.len().div_ceil(self.limits.candidates_max.max(1)).max(1);
        inputs.select(&(0..inputs.len()).step_by(step).collect::<Vec<_>>())
    }

    fn knowledge(&self) -> Result<&Knowledge, AgentError> {
        let stale = || AgentError::NotLearned { id: self.id.clone(), events: self.events.len() };
        self.knowledge.as_deref().ok_or_else(stale)
    }

    /// Chooses the inducing points of up to `frames` packets of `points_per_frame` points: packet by packet the points that leave
    /// the least prior variance at its own events unexplained, given the packets before. Fewer where nothing is left to tell.
    ///
    /// # Errors
    /// [`AgentError::NotLearned`] when events arrived since [`Agent::learn`].
    pub fn plan_packets(&self, frames: usize, points_per_frame: usize) -> Result<PacketPlan, AgentError> {
        let inputs = self.candidate_inputs(self.knowledge()?.sites.inputs());
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

    /// Its own events and all packets put together. O(n³), n = own events + all inducing points.
    ///
    /// # Errors
    /// [`AgentError::NotLearned`] when events arrived since [`Agent::learn`].
    pub fn posterior(&self, fusion: Fusion) -> Result<Posterior, AgentError> {
        let knowledge = self.knowledge()?;
        let prior = &self.model.prior;
        if fusion == Fusion::Concatenation {
            let summaries: Vec<&Summary> = self.received.values().map(|packet| &packet.summary).collect();
            return Ok(Posterior::concatenate(prior, &summaries)?);
        }
        // What it sent itself it knows better from its own events.
        let others = self.received.values().filter(|packet| packet.sender != self.id);
        let summaries: Vec<&Summary> = others.map(|packet| &packet.summary).chain(&knowledge.condensed).collect();
        let none = Sites::empty(self.model.inputs.dimension());
        let own = if knowledge.condensed.is_some() { &none } else { &knowledge.sites };
        Ok(Posterior::fuse(prior, own, &summaries)?)
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
