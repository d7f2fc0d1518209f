//! One vehicle as a state machine: events and packets in, packets and probabilities out.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use dgpc::{Fit, Posterior, Sites, Summary};

use crate::agent_error::AgentError;
use crate::event::{Event, Link, VehicleId};
use crate::fitting::{self, FitQuality};
use crate::limits::Limits;
use crate::live::{LivePackets, PacketKey};
use crate::model::Model;
use crate::receipt::Counts;
use crate::team::Team;

/// A prior of its own that a vehicle predicts under, and the fit of its events under it.
#[derive(Debug)]
pub(crate) struct OwnModel {
    pub(crate) fit: Fit,
    #[cfg(feature = "learn")]
    pub(crate) learned: crate::learning::LearnedModel,
}

/// One vehicle. Events may arrive late and in any order; packets may be lost, repeated and reordered. It does no input
/// or output and knows no clock.
///
/// What it knows is held in three posteriors: of its own events alone, of what it sent alone (what any listener can
/// know by it), and of its own events with all that others sent. Each grows by what arrives, at O(n²) for an event or
/// packet on top of n events and inducing points; [`Agent::rebuild_posteriors`] makes all of them afresh.
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
    /// In [`Event::canonical_order`], so that fits do not depend on the order of arrival; shared by copies of the
    /// agent.
    pub(crate) events: Arc<Vec<Event>>,
    pub(crate) live: LivePackets,
    /// Counter of its next packet.
    pub(crate) counter_next: u32,
    /// How often each live packet of its own was sent again.
    pub(crate) repeats: BTreeMap<u16, u8>,
    pub(crate) counts: Counts,
    pub(crate) heard_s: BTreeMap<u8, f64>,
    /// The last fit of its own events under the team's model.
    pub(crate) fit: Option<Arc<Fit>>,
    /// Its own model, if it learned one.
    pub(crate) own_model: Option<Arc<OwnModel>>,
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
    /// The frame for which the last attempt found nothing worth sending, if nothing happened since.
    pub(crate) nothing_new_in: Option<usize>,
}

impl OwnModel {
    /// The same model with another fit of the events.
    fn with(&self, fit: Fit) -> Self {
        Self {
            fit,
            #[cfg(feature = "learn")]
            learned: self.learned.clone(),
        }
    }
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
            fit: None,
            own_model: None,
            own: nothing.clone(),
            public: nothing.clone(),
            fused: nothing,
            unread: BTreeSet::new(),
            is_stale: false,
            unfitted: Vec::new(),
            absorbed: 0,
            nothing_new_in: None,
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

    /// Records an event of its own. Once in 64 events all are fitted again. Beyond [`Limits::events_max`] the oldest
    /// go, a sixteenth at a time. O(log N) to find its place.
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
                return Err(dgpc::Error::NotFinite { what, place: dgpc::Place::Element(row), value }.into());
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
        self.nothing_new_in = None;
        if beyond > 0 || self.unfitted.len() > UNFITTED_MAX { self.refit() } else { Ok(()) }
    }

    /// Probability of success over a link.
    ///
    /// # Errors
    /// [`AgentError::Method`] when a position is not finite.
    pub fn probability(&mut self, link: &Link) -> Result<f64, AgentError> {
        Ok(self.probabilities(std::slice::from_ref(link))?[0])
    }

    /// Probability of success over each link. Takes in what arrived since the last time, and fits nothing again. O(n²)
    /// a link.
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
        self.absorb_pending()?;
        Ok(&self.fused)
    }

    /// Its own events alone, under the team's model.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn own_posterior(&mut self) -> Result<&Posterior, AgentError> {
        self.absorb_pending()?;
        Ok(&self.own)
    }

    /// The sites of its own events in the last fit, under the team's model; `None` before the first.
    pub fn sites(&self) -> Option<&Sites> {
        self.fit.as_ref().map(|fit| fit.sites())
    }

    /// Takes what arrived into the posteriors: O(n²) for every event and point. After a fit, or when packets fell out
    /// of their window, they are put together anew, O(n³). Nothing is fitted here.
    pub(crate) fn absorb_pending(&mut self) -> Result<(), AgentError> {
        if self.is_stale {
            self.put_together()?;
        }
        let absorbed = self.absorb_events().and_then(|()| self.absorb_packets());
        self.is_stale = absorbed.is_err();
        absorbed
    }

    fn absorb_events(&mut self) -> Result<(), AgentError> {
        for event in &self.unfitted[self.absorbed..] {
            let observation = self.team.model.observations([event])?;
            let site = dgpc::sites_given(&self.own, &observation)?;
            self.own.absorb_events(&site)?;
            // Under its own model an event has another site.
            let site = if self.own_model.is_some() { dgpc::sites_given(&self.fused, &observation)? } else { site };
            self.fused.absorb_events(&site)?;
        }
        self.absorbed = self.unfitted.len();
        Ok(())
    }

    fn absorb_packets(&mut self) -> Result<(), AgentError> {
        let keys = std::mem::take(&mut self.unread);
        let (own, others): (Vec<PacketKey>, _) = keys.into_iter().partition(|key| Some(key.0) == self.number);
        let said = |keys: &[PacketKey]| -> Vec<&Summary> {
            keys.iter().filter_map(|&key| self.live.get(key)).flat_map(|packet| &packet.summaries).collect()
        };
        self.public.absorb_summaries(&said(&own))?;
        let prior = self.fused.prior();
        let others: Vec<_> =
            said(&others).into_iter().map(|summary| summary.read_under(prior)).collect::<Result<_, dgpc::Error>>()?;
        self.fused.absorb_summaries(&others.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        Ok(())
    }

    /// Fits its own events again if some came since the last time, and puts everything together in canonical order:
    /// what comes of it depends on nothing but the events, the live packets and the model it learned, if it did
    /// (`Agent::adapt`; that fits its events with what was heard until then). O(N³) up to [`Limits::dense_events_max`]
    /// events, plus O(n³).
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn rebuild_posteriors(&mut self) -> Result<(), AgentError> {
        self.refit_if_due()?;
        self.put_together()
    }

    /// Fits its own events again if some came since the last time.
    pub(crate) fn refit_if_due(&mut self) -> Result<(), AgentError> {
        if self.unfitted.is_empty() && self.fit.is_some() { Ok(()) } else { self.refit() }
    }

    /// Fits its own events, under the packet model and under its own if it has one.
    fn refit(&mut self) -> Result<(), AgentError> {
        let (model, limits) = (&self.team.model, &self.team.limits);
        let observations = model.observations(self.events.iter())?;
        let fit = fitting::fit(&model.prior, &observations, &[], limits)?;
        if let Some(own) = &self.own_model {
            let fit = fitting::fit(own.fit.prior(), &observations, &self.messages(), limits)?;
            self.own_model = Some(Arc::new(own.with(fit)));
        }
        self.fit = Some(Arc::new(fit));
        self.unfitted.clear();
        self.absorbed = 0;
        self.is_stale = true;
        Ok(())
    }

    /// The posteriors of the last fit and all live packets. Events since that fit are pending again.
    pub(crate) fn put_together(&mut self) -> Result<(), AgentError> {
        let model = &self.team.model;
        let nothing = || Posterior::prior_alone(&model.prior, model.inputs.dimension());
        let public: Vec<&Summary> =
            self.number.iter().flat_map(|&number| self.live.of(number)).flat_map(|(_, p)| &p.summaries).collect();
        let others = self.messages();
        let (mut public_now, mut alone, mut fused) = (nothing(), nothing(), nothing());
        public_now.absorb_summaries(&public)?;
        match &self.fit {
            Some(fit) => alone = fit.posterior_with(&[])?,
            None => fused.absorb_summaries(&others)?,
        }
        if let Some(fit) = self.own_model.as_ref().map(|own| &own.fit).or(self.fit.as_deref()) {
            fused = fit.posterior_with(&others)?;
        }
        (self.public, self.own, self.fused) = (public_now, alone, fused);
        self.unfitted.sort_by(Event::canonical_order);
        self.absorbed = 0;
        self.unread.clear();
        self.is_stale = false;
        Ok(())
    }

    /// What others said. What it sent itself it knows better from its own events.
    pub(crate) fn messages(&self) -> Vec<&Summary> {
        let others = self.live.iter().filter(|((sender, _), _)| Some(*sender) != self.number);
        others.flat_map(|(_, packet)| &packet.summaries).collect()
    }

    /// How the last fit to its own events went; `None` before the first.
    pub fn fit_quality(&self) -> Option<FitQuality> {
        self.fit.as_ref().map(|fit| FitQuality::of(fit))
    }

    /// Whether its events are few enough for a dense fit.
    pub fn learns_densely(&self) -> bool {
        self.events.len() <= self.team.limits.dense_events_max
    }
}

/// So many events may stand beside the last fit before the next.
const UNFITTED_MAX: usize = 64;
