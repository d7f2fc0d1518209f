//! One vehicle as a state machine: events and packets in, packets and probabilities out.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use dgpc::{Posterior, Prior, Sites, Summary, mean_field};

use crate::event::{Event, Link, VehicleId};
use crate::knowledge::{FitQuality, Knowledge};
use crate::learning::{Fit, Learning};
use crate::limits::Limits;
use crate::live::{LivePackets, PacketKey};
use crate::model::Model;
use crate::receipt::Counts;
use crate::team::{Team, TeamError};

/// What an agent can refuse to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// Only members send.
    #[error("{id} is not a member of the team, and has no number to send under")]
    NotAMember {
        /// Who it is.
        id: VehicleId,
    },
    /// A counter must never repeat under one key.
    #[error("{id} has used up all counters of key epoch {epoch}; sending needs a new epoch")]
    CountersUsedUp {
        /// The vehicle.
        id: VehicleId,
        /// The epoch.
        epoch: u32,
    },
    /// The frame is too small.
    #[error(transparent)]
    Team(#[from] TeamError),
    /// A packet could not be encoded.
    #[error(transparent)]
    Packet(#[from] pingmap_packet::Error),
    /// Bytes that are no snapshot of this vehicle.
    #[error("not a snapshot of {id}: {problem}")]
    Snapshot {
        /// The vehicle.
        id: VehicleId,
        /// What is wrong.
        problem: String,
    },
    /// The method refused.
    #[error(transparent)]
    Method(#[from] dgpc::Error),
}

/// A model that an agent learned by itself, and the fit of its own events under it.
#[derive(Debug)]
pub(crate) struct Own {
    fit: Fit,
    knowledge: Knowledge,
}

/// One vehicle. Events may arrive late and in any order; packets may be lost, repeated and reordered. It does no input or output
/// and knows no clock.
///
/// What it knows is held in three posteriors: of its own events alone, of what it sent alone (what any listener can know by it),
/// and of its own events with all that others sent. Each grows by what arrives, at O(n²) for an event or packet on top of n
/// events and inducing points; [`Agent::rebuild`] makes all of them afresh.
///
/// ```
/// use pingmap_agent::*;
/// use std::sync::Arc;
///
/// let chart = Chart::about([]);
/// let shape = dgpc::Shape::SquaredExponential;
/// let model = Model::isotropic(chart, InputSpec::Positions, shape, true, 400.0, 4.0)?;
/// let names = ["alice", "bob"].map(VehicleId::new);
/// let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
/// let team = Arc::new(Team::new(names.clone(), model, reach)?);
/// let link = |east_m| Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, 0.0) };
///
/// let mut alice = Agent::new(names[0].clone(), team.clone());
/// for (time_s, east_m, success) in [(0.0, 100.0, true), (10.0, 200.0, true), (20.0, 900.0, false)] {
///     let [receiver_id, transmitter_id] = names.clone();
///     alice.observe(Event { time_s, transmitter_id, receiver_id, link: link(east_m), success })?;
/// }
/// let frame = alice.next_packet(30.0, 32)?.expect("there is something to tell");
/// assert!(frame.len() <= 32);
///
/// let mut bob = Agent::new(names[1].clone(), team);
/// assert_eq!(bob.receive(&frame, 31.0), Receipt::Accepted);
/// assert_eq!(bob.receive(&frame, 32.0), Receipt::Refused(Refusal::Duplicate));
/// assert!(bob.probability(&link(150.0))? > 0.5);
/// assert!(bob.probability(&link(900.0))? < 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Agent {
    pub(crate) id: VehicleId,
    /// Its number in the team, if it is a member.
    pub(crate) number: Option<u8>,
    pub(crate) team: Arc<Team>,
    pub(crate) digest: [u8; 32],
    /// In [`Event::canonical_order`], so that fits do not depend on the order of arrival; shared by copies of the agent.
    pub(crate) events: Arc<Vec<Event>>,
    pub(crate) live: LivePackets,
    /// Counter of its next packet.
    pub(crate) counter_next: u32,
    /// How often each live packet of its own was sent again.
    pub(crate) repeats: BTreeMap<u16, u8>,
    pub(crate) counts: Counts,
    pub(crate) heard_s: BTreeMap<u8, f64>,
    /// The last fit of its own events, and its own model's.
    pub(crate) knowledge: Option<Arc<Knowledge>>,
    pub(crate) own_model: Option<Arc<Own>>,
    /// Its own events under the team's model.
    pub(crate) own: Posterior,
    /// What it sent, under the team's model.
    pub(crate) public: Posterior,
    /// Its own events and what others sent, under its own model if it has one.
    pub(crate) fused: Posterior,
    /// Packets that are not in the posteriors yet.
    pub(crate) unread: BTreeSet<PacketKey>,
    /// Whether the posteriors must be put together anew: after a fit, or when something went that they cannot forget.
    pub(crate) is_stale: bool,
    /// Events since the last fit.
    pub(crate) unfitted: Vec<Event>,
    /// How many of these are in the posteriors, from the first on.
    pub(crate) absorbed: usize,
    /// The frame for which the last attempt found nothing to tell, if nothing happened since.
    pub(crate) told_all_in: Option<usize>,
}

impl Agent {
    /// A vehicle that has seen nothing. Who is not a member of the team listens only.
    pub fn new(id: VehicleId, team: Arc<Team>) -> Self {
        let nothing = Posterior::prior_alone(&team.model.prior, team.model.inputs.dimension());
        Self {
            number: team.number(&id),
            id,
            digest: team.digest(),
            events: Arc::default(),
            live: LivePackets::new(team.packets_per_sender_max),
            counter_next: 0,
            repeats: BTreeMap::new(),
            counts: Counts::default(),
            heard_s: BTreeMap::new(),
            knowledge: None,
            own_model: None,
            own: nothing.clone(),
            public: nothing.clone(),
            fused: nothing,
            unread: BTreeSet::new(),
            is_stale: false,
            unfitted: Vec::new(),
            absorbed: 0,
            told_all_in: None,
            team,
        }
    }

    /// Who it is.
    pub fn id(&self) -> &VehicleId {
        &self.id
    }

    /// Whether it has a number to send under.
    pub fn is_member(&self) -> bool {
        self.number.is_some()
    }

    /// What the team agreed on.
    pub fn team(&self) -> &Team {
        &self.team
    }

    /// The packet model.
    pub fn model(&self) -> &Model {
        &self.team.model
    }

    /// Its own events, in canonical order.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// Packets received, by what became of them.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// How many packets count at present, its own included.
    pub fn live_packets(&self) -> usize {
        self.live.len()
    }

    /// When a member was last heard by a packet that counted.
    pub fn heard_s(&self, member: &VehicleId) -> Option<f64> {
        self.team.number(member).and_then(|number| self.heard_s.get(&number)).copied()
    }

    /// Records an event of its own. Once in 64 events all are fitted again. Beyond [`Limits::events_max`] the oldest go, a sixteenth
    /// at a time. O(log N) to find its place.
    ///
    /// # Errors
    /// [`AgentError::Method`] for a time or position that is not finite.
    pub fn observe(&mut self, event: Event) -> Result<(), AgentError> {
        self.observe_all([event])
    }

    /// Records many events in any order. O(N log N).
    ///
    /// # Errors
    /// As [`Agent::observe`], and then none is recorded.
    pub fn observe_all(&mut self, new: impl IntoIterator<Item = Event>) -> Result<(), AgentError> {
        let new: Vec<Event> = new.into_iter().collect();
        self.team.model.inputs(new.iter().map(|event| &event.link))?;
        // Time, and depths that the model does not look at.
        for (row, event) in new.iter().enumerate() {
            let depths = event.link.ends().into_iter().filter_map(|end| end.depth_m).map(|depth| ("depth", depth));
            let mut numbers = [("time of an event", event.time_s)].into_iter().chain(depths);
            if let Some((what, value)) = numbers.find(|(_, value)| !value.is_finite()) {
                return Err(dgpc::Error::NotFinite { what, row, column: 0, value }.into());
            }
        }
        if new.is_empty() {
            return Ok(());
        }
        let events = Arc::make_mut(&mut self.events);
        if let [event] = new.as_slice() {
            let place = events.partition_point(|known| known.canonical_order(event).is_le());
            events.insert(place, event.clone());
        } else {
            events.extend(new.iter().cloned());
            events.sort_by(Event::canonical_order);
        }
        // A sixteenth at a time: whoever forgets must fit again.
        let Limits { events_max, .. } = self.team.limits;
        let beyond = if events.len() > events_max { events.len() - events_max + events_max / 16 } else { 0 };
        events.drain(..beyond);
        self.unfitted.extend(new);
        self.told_all_in = None;
        if beyond > 0 || self.unfitted.len() > UNFITTED_MAX { self.fit() } else { Ok(()) }
    }

    /// Probability of success over a link.
    ///
    /// # Errors
    /// [`AgentError::Method`] when a position is not finite.
    pub fn probability(&mut self, link: &Link) -> Result<f64, AgentError> {
        Ok(self.probabilities(std::slice::from_ref(link))?[0])
    }

    /// Probability of success over each link. Takes in what arrived since the last time, and fits nothing again. O(n²) a link.
    ///
    /// # Errors
    /// As [`Agent::probability`].
    pub fn probabilities(&mut self, links: &[Link]) -> Result<Vec<f64>, AgentError> {
        let inputs = self.team.model.inputs(links)?;
        Ok(self.posterior()?.probability(&inputs)?)
    }

    /// Its own events and all that others sent, put together.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn posterior(&mut self) -> Result<&Posterior, AgentError> {
        self.settle()?;
        Ok(&self.fused)
    }

    /// Its own events alone, under the team's model.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn own_posterior(&mut self) -> Result<&Posterior, AgentError> {
        self.settle()?;
        Ok(&self.own)
    }

    /// The sites of its own events in the last fit, under the team's model; `None` before the first.
    pub fn sites(&self) -> Option<&Sites> {
        self.knowledge.as_ref().map(|knowledge| &knowledge.sites)
    }

    /// Takes what arrived into the posteriors: O(n²) for every event and point. After a fit, or when packets fell out of their window,
    /// they are put together anew, O(n³). Nothing is fitted here.
    pub(crate) fn settle(&mut self) -> Result<(), AgentError> {
        if self.is_stale {
            self.put_together()?;
        }
        let settled = self.absorb_news();
        self.is_stale = settled.is_err();
        settled
    }

    fn absorb_news(&mut self) -> Result<(), AgentError> {
        for event in &self.unfitted[self.absorbed..] {
            let observation = self.team.model.observations([event])?;
            let site = mean_field::beside(&self.own, &observation)?;
            self.own.absorb(&site, &[])?;
            // Under its own model an event has another site.
            let site = if self.own_model.is_some() { mean_field::beside(&self.fused, &observation)? } else { site };
            self.fused.absorb(&site, &[])?;
        }
        self.absorbed = self.unfitted.len();
        let keys = std::mem::take(&mut self.unread);
        let (own, others): (Vec<PacketKey>, _) = keys.into_iter().partition(|key| Some(key.0) == self.number);
        let none = Sites::empty(self.team.model.inputs.dimension());
        let said = |keys: &[PacketKey]| -> Vec<&Summary> {
            keys.iter().filter_map(|&key| self.live.get(key)).flat_map(|packet| &packet.summaries).collect()
        };
        self.public.absorb(&none, &said(&own))?;
        let others = under(self.fused.prior(), &said(&others))?;
        self.fused.absorb(&none, &others.iter().collect::<Vec<_>>())?;
        Ok(())
    }

    /// Fits its own events again if some came since the last time, and puts everything together in canonical order: what comes of
    /// it depends on nothing but the events, the live packets and the model it learned, if it did ([`Agent::adapt`]; that fits its
    /// events with what was heard until then). O(N³) up to [`Limits::dense_events_max`] events, plus O(n³).
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn rebuild(&mut self) -> Result<(), AgentError> {
        self.catch_up()?;
        self.put_together()
    }

    /// Fits its own events again if some came since the last time.
    pub(crate) fn catch_up(&mut self) -> Result<(), AgentError> {
        if self.unfitted.is_empty() && self.knowledge.is_some() { Ok(()) } else { self.fit() }
    }

    /// Fits its own events, under the packet model and under its own if it has one.
    fn fit(&mut self) -> Result<(), AgentError> {
        let (model, limits) = (&self.team.model, &self.team.limits);
        let observations = model.observations(self.events.iter())?;
        let knowledge = Knowledge::fit(&model.prior, &observations, &[], limits)?;
        if let Some(own) = &self.own_model {
            let knowledge = Knowledge::fit(&own.fit.model.prior, &observations, &self.messages(), limits)?;
            self.own_model = Some(Arc::new(Own { fit: own.fit.clone(), knowledge }));
        }
        self.knowledge = Some(Arc::new(knowledge));
        self.unfitted.clear();
        self.absorbed = 0;
        self.is_stale = true;
        Ok(())
    }

    /// The posteriors of the last fit and all live packets. Events since that fit are news again.
    fn put_together(&mut self) -> Result<(), AgentError> {
        let model = &self.team.model;
        let none = Sites::empty(model.inputs.dimension());
        let fuse = |summaries: &[&Summary]| match &self.knowledge {
            Some(knowledge) => knowledge.fuse(&model.prior, summaries),
            None => Posterior::fuse(&model.prior, &none, summaries),
        };
        let public: Vec<&Summary> =
            self.number.iter().flat_map(|&number| self.live.of(number)).flat_map(|(_, p)| &p.summaries).collect();
        let public = Posterior::fuse(&model.prior, &none, &public)?;
        let own = fuse(&[])?;
        let fused = match &self.own_model {
            None => fuse(&self.messages())?,
            Some(own) => {
                let messages = under(&own.fit.model.prior, &self.messages())?;
                own.knowledge.fuse(&own.fit.model.prior, &messages.iter().collect::<Vec<_>>())?
            }
        };
        (self.public, self.own, self.fused) = (public, own, fused);
        self.unfitted.sort_by(Event::canonical_order);
        self.absorbed = 0;
        self.unread.clear();
        self.is_stale = false;
        Ok(())
    }

    /// Learns a model of its own from its own events and from what others said, and from then on predicts under that. What it
    /// sends stays under the team's model. The first time every structure is tried; later the chosen one goes on from its last
    /// optimum, at the cost of one search that never ends worse in E than it began.
    ///
    /// # Errors
    /// As [`Learning::best`].
    pub fn adapt(&mut self, learning: &Learning) -> Result<&Fit, AgentError> {
        self.catch_up()?;
        let Model { chart, inputs, .. } = self.team.model;
        let messages = self.messages();
        let events = self.events.iter();
        let fit = match &self.own_model {
            Some(own) => learning.fit(&own.fit.structure, chart, inputs, events, &messages, Some(&own.fit))?,
            None => learning.best(chart, inputs, events, &messages)?,
        };
        let observations = fit.model.observations(self.events.iter())?;
        let knowledge = Knowledge::fit(&fit.model.prior, &observations, &messages, &self.team.limits)?;
        let own = self.own_model.insert(Arc::new(Own { fit, knowledge })).clone();
        self.put_together()?;
        Ok(&self.own_model.insert(own).fit)
    }

    /// The model it learned by itself, if it did.
    pub fn own_fit(&self) -> Option<&Fit> {
        self.own_model.as_ref().map(|own| &own.fit)
    }

    /// What others said. What it sent itself it knows better from its own events.
    fn messages(&self) -> Vec<&Summary> {
        let others = self.live.iter().filter(|((sender, _), _)| Some(*sender) != self.number);
        others.flat_map(|(_, packet)| &packet.summaries).collect()
    }

    /// How the last fit to its own events went; `None` before the first.
    pub fn fit_quality(&self) -> Option<FitQuality> {
        self.knowledge.as_ref().map(|knowledge| knowledge.quality)
    }

    /// Whether its events are few enough for a dense fit.
    pub fn learns_densely(&self) -> bool {
        self.events.len() <= self.team.limits.dense_events_max
    }
}

/// Summaries read under another prior.
fn under(prior: &Prior, summaries: &[&Summary]) -> dgpc::Result<Vec<Summary>> {
    let read =
        |summary: &&Summary| if summary.prior() == prior { Ok((*summary).clone()) } else { summary.under(prior) };
    summaries.iter().map(read).collect()
}

/// So many events may stand beside the last fit before the next.
const UNFITTED_MAX: usize = 64;
