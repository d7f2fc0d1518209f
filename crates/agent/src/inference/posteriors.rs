//! The fits and posteriors of a vehicle. They follow from its memory and can be computed again at any time.

use std::collections::{BTreeSet, HashSet};
use std::sync::Arc;

use dgpc::{Posterior, Summary};

use crate::codec::decoded::{EventKey, PacketKey};
use crate::error::AgentError;
use crate::inference::accepted::{AcceptedData, packets_with, summaries, summaries_under};
use crate::inference::alternative::AlternativeModel;
use crate::inference::event_fit::{EventFit, EventSource, PartialSummary};
use crate::inference::posterior_pair::PosteriorPair;
use crate::model::link_model::Model;
use crate::store::event_location::{RemoteEvents, among};
use crate::store::events::{EventChange, RecordedEvent};
use crate::store::memory::Memory;
use crate::store::reports::ReceivedReports;
use crate::types::event::Event;
use crate::types::sharing::Sharing;

/// A model that the vehicle learned under way, and the fit of all events under it.
#[derive(Debug)]
pub(crate) struct OwnModel {
    pub(crate) fit: EventFit,
    /// Summary packets that were messages of this fit.
    pub(crate) packets: Arc<BTreeSet<PacketKey>>,
    #[cfg(feature = "learn")]
    pub(crate) learned: crate::model::learning::LearnedModel,
}

/// Fits, posteriors, and members that are excluded by them.
#[derive(Debug, Clone)]
pub(crate) struct Posteriors {
    /// The last fit of the vehicle's own events under the team's model.
    pub(crate) own_fit: Option<Arc<EventFit>>,
    /// The last fit of own and remote events under the team's model, if there are remote events.
    pub(crate) joint_fit: Option<Arc<EventFit>>,
    pub(crate) began_cold: bool,
    pub(crate) own_model: Option<Arc<OwnModel>>,
    pub(crate) pair: PosteriorPair,
    /// Posterior of the vehicle's own summary packets, under the team's model: what a listener can compute from these.
    pub(crate) shared: Posterior,
    /// The alternative model, if there is one.
    pub(crate) alternative: Option<AlternativeModel>,
    /// Summary of the own events that reports have delivered, if the last fit is sparse.
    delivered: Option<PartialSummary>,
    pub(crate) included: Included,
    /// Members whose data are not used because they contradict all others.
    pub(crate) excluded: BTreeSet<u8>,
    /// Summary packets by which faulty members were detected; `None` if detection must run again.
    pub(crate) examined: Option<Arc<BTreeSet<PacketKey>>>,
    /// The frame length and the ways of sharing for which nothing was worth sending, if nothing has changed since.
    pub(crate) nothing_to_send: Option<(usize, Sharing)>,
}

/// Posteriors by expectation propagation.
#[derive(Debug)]
pub(crate) struct IntervalPosteriors {
    /// Of the data of the fused posterior.
    pub(crate) fused: Posterior,
    /// Under the alternative model, if there is one.
    pub(crate) alternative: Option<Posterior>,
}

/// The part of the memory that the posteriors include.
#[derive(Debug, Clone, Default)]
pub(crate) struct Included {
    pub(crate) pending_own: Vec<RecordedEvent>,
    /// Number of these events that the posteriors include, from the first on.
    pub(crate) absorbed: usize,
    /// Number of own events that were forgotten since the last fit. The posteriors still include them.
    pub(crate) forgotten: usize,
    remote: RemoteEvents,
    accepted: Option<Arc<RemoteEvents>>,
    /// Numbers of remote events since the last fit: included, and waiting for the next fit.
    pub(crate) pending_remote: [usize; 2],
    /// Summary packets that the posteriors include, own ones among them.
    packets: BTreeSet<PacketKey>,
    reported: Option<Arc<ReceivedReports>>,
    is_stale: bool,
}

impl Included {
    /// Notes that all events were fitted again.
    pub(crate) fn reset(&mut self) {
        *self = Self { is_stale: true, packets: std::mem::take(&mut self.packets), ..Self::default() };
    }

    fn missing(&self, accepted: &RemoteEvents) -> Vec<(EventKey, Arc<Event>)> {
        let mut is_in = among(&self.remote);
        accepted.iter().filter(|event| !is_in(*event)).map(|(&key, event)| (key, event.clone())).collect()
    }
}

impl Posteriors {
    /// Returns the posteriors before any event.
    pub(crate) fn new(model: &Model) -> Self {
        let prior = model.prior_posterior();
        Self {
            own_fit: None,
            joint_fit: None,
            began_cold: false,
            own_model: None,
            pair: PosteriorPair::new(prior.clone(), None),
            shared: prior,
            alternative: None,
            delivered: None,
            included: Included::default(),
            excluded: BTreeSet::new(),
            examined: None,
            nothing_to_send: None,
        }
    }

    /// Notes which own events came and went.
    pub(crate) fn note(&mut self, change: EventChange) {
        if !change.new.is_empty() || change.forgotten > 0 {
            self.nothing_to_send = None;
        }
        self.included.pending_own.extend(change.new);
        self.included.forgotten += change.forgotten;
        if !change.restored.is_empty() {
            self.note_restored(change.restored);
        }
    }

    /// Notes events that count again. The posteriors may still include them.
    fn note_restored(&mut self, restored: Vec<RecordedEvent>) {
        self.nothing_to_send = None;
        let fitted = self.own_fit.iter().flat_map(|fit| &fit.sources).copied();
        let pending = self.included.pending_own.iter().map(|recorded| EventSource::Own(recorded.number));
        let included: HashSet<EventSource> = fitted.chain(pending).collect();
        for recorded in restored {
            match included.contains(&EventSource::Own(recorded.number)) {
                true => self.included.forgotten = self.included.forgotten.saturating_sub(1),
                false => self.included.pending_own.push(recorded),
            }
        }
    }

    /// Absorbs new data, O(n²) for each event and inducing point. After a fit, or where included data no longer count,
    /// the posteriors are rebuilt, O(n³). Nothing is fitted.
    pub(crate) fn update(&mut self, memory: &Memory, data: &AcceptedData) -> Result<(), AgentError> {
        self.include(memory, &data.without(&self.excluded))?;
        if let Some((excluded, pair)) = self.detect_faulty_members(memory, data)? {
            let trusted = data.without(&excluded);
            self.included.pending_own.sort_by(RecordedEvent::order);
            self.rebuild_alternative(memory, &trusted, self.included.absorbed)?;
            (self.excluded, self.pair) = (excluded, pair);
            self.included.packets = Self::wanted(memory, &trusted);
            self.included.remote = self.fitted_among(&trusted).map(|(&key, event)| (key, event.clone())).collect();
            self.included.pending_remote = [0, trusted.events.len() - self.included.remote.len()];
            self.included.accepted = Some(trusted.events.clone());
            let absorbed = self.absorb_remote(memory, &trusted);
            self.included.is_stale = absorbed.is_err();
            absorbed?;
        }
        self.examined = Some(data.packets.clone());
        Ok(())
    }

    /// Makes the posteriors include own packets and the data of trusted members.
    fn include(&mut self, memory: &Memory, trusted: &AcceptedData) -> Result<(), AgentError> {
        let wanted = Self::wanted(memory, trusted);
        let reported = memory.own.and_then(|own| memory.reports.reports_of(own)).cloned();
        let has_new_reports = reported.as_ref().map(Arc::as_ptr) != self.included.reported.as_ref().map(Arc::as_ptr);
        if has_new_reports || own_of(memory, &self.included.packets) != own_of(memory, &wanted) {
            self.nothing_to_send = None;
        }
        // Events of the last fit are included by their sites, also if they begin to count again.
        let is_unchanged = self.included.accepted.as_ref().is_some_and(|before| Arc::ptr_eq(before, &trusted.events));
        let differs = || {
            !self.included.remote.iter().all(among(&trusted.events))
                || !self.fitted_among(trusted).all(among(&self.included.remote))
        };
        let has_lost = !self.included.packets.is_subset(&wanted) || !is_unchanged && differs();
        self.included.reported = reported;
        let is_rebuilt = self.included.is_stale || has_lost;
        if is_rebuilt {
            self.rebuild(memory, trusted, &wanted)?;
        }
        let mut absorbed = self.absorb_own(memory).and_then(|()| self.absorb_packets(memory, &wanted));
        if is_rebuilt || !is_unchanged {
            absorbed = absorbed.and_then(|()| self.absorb_remote(memory, trusted));
        }
        self.included.accepted = Some(trusted.events.clone());
        self.included.is_stale = absorbed.is_err();
        absorbed
    }

    /// Returns the packets that the posteriors should include: own ones, and those of trusted members.
    fn wanted(memory: &Memory, trusted: &AcceptedData) -> BTreeSet<PacketKey> {
        memory.own_packets().chain(trusted.packets.iter().copied()).collect()
    }

    /// Returns the own and the fused posterior with these data of other members, in canonical order: equal to the bit
    /// to a rebuild. Remote events since the last fit are not included.
    pub(crate) fn pair_of(&self, memory: &Memory, trusted: &AcceptedData) -> Result<PosteriorPair, AgentError> {
        let mut pair = self.pair_at_fit(memory, trusted)?;
        let mut pending: Vec<&RecordedEvent> = self.included.pending_own.iter().collect();
        pending.sort_by(|a, b| a.order(b));
        for recorded in &pending[..self.included.absorbed] {
            pair.absorb_own(&memory.observation(&recorded.event)?)?;
        }
        Ok(pair)
    }

    /// Returns the own and the fused posterior of the last fit and these data, without events since.
    fn pair_at_fit(&self, memory: &Memory, trusted: &AcceptedData) -> Result<PosteriorPair, AgentError> {
        let model = &memory.codec.team.model;
        let site: Vec<&Summary> = model.site_summary().into_iter().collect();
        let own =
            self.own_fit.as_ref().map_or_else(|| Ok(model.prior_posterior()), |own| own.fit.posterior_with(&site))?;
        let is_alone = self.own_model.is_none() && self.joint_fit.is_none() && trusted.packets.is_empty();
        let fused = match is_alone {
            true => None,
            false => Some(self.fused_at_fit(memory, trusted, &BTreeSet::new())?),
        };
        Ok(PosteriorPair::new(own, fused))
    }

    /// Returns the fused posterior of the last fit and these data, without the own events with these numbers, and
    /// without events since.
    pub(crate) fn fused_at_fit(
        &self,
        memory: &Memory,
        trusted: &AcceptedData,
        omitted: &BTreeSet<u64>,
    ) -> Result<Posterior, AgentError> {
        let model = &memory.codec.team.model;
        let packets = packets_with(memory, &*trusted.packets);
        let Some(fit) = self.last_fit() else {
            let mut fused = model.prior_posterior();
            fused.absorb_summaries(&summaries(&packets))?;
            return Ok(fused);
        };
        let is_in = |source: &EventSource| match source {
            EventSource::Own(number) => !omitted.contains(number),
            EventSource::Remote(key) => fit.is_accepted(key, trusted),
        };
        let messages: Vec<&Summary> = model.site_summary().into_iter().chain(summaries(&packets)).collect();
        Ok(fit.posterior_of(is_in, &messages)?)
    }

    /// Updates the summary of the own events that reports have delivered. The cost follows the change since the last
    /// frame.
    pub(crate) fn update_shared_summary(
        &mut self,
        memory: &Memory,
        is_delivered: &dyn Fn(u32) -> bool,
    ) -> Result<(), AgentError> {
        let reported = memory.own.and_then(|own| memory.reports.reports_of(own));
        let Some(own_fit) = self.own_fit.as_ref().filter(|_| reported.is_some()) else { return Ok(()) };
        let numbers = memory.numbers_of(is_delivered);
        self.delivered = own_fit.partial_summary(&numbers, self.delivered.as_ref())?;
        Ok(())
    }

    /// Returns the posterior that a listener can compute from the vehicle's summary packets and from its outcomes of
    /// these slots.
    pub(crate) fn shared_of(&self, memory: &Memory, is_shared: &dyn Fn(u32) -> bool) -> Result<Posterior, AgentError> {
        let model = &memory.codec.team.model;
        let site: Vec<&Summary> = model.site_summary().into_iter().collect();
        let shared: BTreeSet<u64> = memory.numbers_of(is_shared);
        let packets = packets_with(memory, &memory.own_packets().collect::<Vec<_>>());
        let mut posterior = match &self.own_fit {
            Some(own_fit) if !shared.is_empty() => {
                let is_in =
                    |source: &EventSource| matches!(source, EventSource::Own(number) if shared.contains(number));
                let messages: Vec<&Summary> = site.into_iter().chain(summaries(&packets)).collect();
                match own_fit.partial_summary(&shared, self.delivered.as_ref())? {
                    Some(partial) => partial.posterior_with(&messages)?,
                    None => own_fit.posterior_of(is_in, &messages)?,
                }
            }
            _ => {
                let mut posterior = model.prior_posterior();
                posterior.absorb_summaries(&summaries(&packets))?;
                posterior
            }
        };
        self.absorb_pending_of(memory, &mut posterior, is_shared)?;
        Ok(posterior)
    }

    /// Returns `shared` with the outcomes of further slots. O(n²) for each event.
    pub(crate) fn shared_with(
        &self,
        memory: &Memory,
        shared: &Posterior,
        slots: &BTreeSet<u32>,
    ) -> Result<Posterior, AgentError> {
        let mut posterior = shared.clone();
        if let Some(own_fit) = &self.own_fit {
            let numbers = memory.numbers_of(&|slot| slots.contains(&slot));
            let indices = own_fit.own_indices(|number| numbers.contains(&number));
            posterior.absorb_events(&own_fit.fit.sites().select(&indices))?;
        }
        self.absorb_pending_of(memory, &mut posterior, &|slot| slots.contains(&slot))?;
        Ok(posterior)
    }

    /// Absorbs own events of these slots that came after the last fit.
    fn absorb_pending_of(
        &self,
        memory: &Memory,
        posterior: &mut Posterior,
        is_wanted: &dyn Fn(u32) -> bool,
    ) -> Result<(), AgentError> {
        for recorded in &self.included.pending_own {
            if recorded.key.is_some_and(|(_, slot)| is_wanted(slot)) {
                dgpc::absorb_observations(posterior, &memory.observation(&recorded.event)?)?;
            }
        }
        Ok(())
    }

    /// Returns the last fit that predictions follow from.
    pub(crate) fn last_fit(&self) -> Option<&EventFit> {
        let own_model = self.own_model.as_ref().map(|own| &own.fit);
        own_model.or(self.joint_fit.as_deref()).or(self.own_fit.as_deref())
    }

    /// Returns the remote events of the last fit that are accepted unchanged.
    fn fitted_among<'a>(&'a self, trusted: &'a AcceptedData) -> impl Iterator<Item = (&'a EventKey, &'a Arc<Event>)> {
        let remote = self.last_fit().into_iter().flat_map(|fit| &*fit.remote);
        let mut is_accepted = among(&trusted.events);
        remote.filter(move |event| is_accepted(*event))
    }

    /// Returns the own events since the last fit that the posteriors include.
    pub(crate) fn absorbed_own(&self) -> &[RecordedEvent] {
        &self.included.pending_own[..self.included.absorbed]
    }

    fn absorb_own(&mut self, memory: &Memory) -> Result<(), AgentError> {
        let end = self.included.pending_own.len().min(memory.codec.team.limits.pending_events_max);
        for recorded in &self.included.pending_own[self.included.absorbed..end] {
            let observation = memory.observation(&recorded.event)?;
            self.pair.absorb_own(&observation)?;
            if let Some(alternative) = &mut self.alternative {
                dgpc::absorb_observations(&mut alternative.posterior, &observation)?;
            }
        }
        self.included.absorbed = end;
        Ok(())
    }

    /// Absorbs remote events that the last fit does not have, up to a limit.
    fn absorb_remote(&mut self, memory: &Memory, trusted: &AcceptedData) -> Result<(), AgentError> {
        let mut new = self.included.missing(&trusted.events);
        new.sort_by(|a, b| a.1.canonical_order(&b.1));
        let [included, _] = self.included.pending_remote;
        let room = memory.codec.team.limits.pending_events_max.saturating_sub(included).min(new.len());
        let waiting = new.split_off(room);
        let observations = memory.codec.team.model.observations(new.iter().map(|(_, event)| &**event))?;
        self.pair.absorb_remote(&observations)?;
        if let Some(alternative) = &mut self.alternative {
            dgpc::absorb_observations(&mut alternative.posterior, &observations)?;
        }
        self.included.remote.extend(new);
        self.included.pending_remote = [included + room, waiting.len()];
        Ok(())
    }

    fn absorb_packets(&mut self, memory: &Memory, wanted: &BTreeSet<PacketKey>) -> Result<(), AgentError> {
        let new: BTreeSet<PacketKey> = wanted.difference(&self.included.packets).copied().collect();
        let (own, others): (Vec<PacketKey>, Vec<PacketKey>) = new.iter().partition(|key| Some(key.0) == memory.own);
        let (own, others) = (packets_with(memory, &own), packets_with(memory, &others));
        self.shared.absorb_summaries(&summaries(&own))?;
        let others = summaries_under(&others, self.pair.fused().prior())?;
        self.pair.absorb_summaries(&others.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        self.included.packets.clone_from(wanted);
        Ok(())
    }

    /// Computes the posteriors of the last fit and these data. Events since that fit are absorbed afterwards.
    fn rebuild(
        &mut self,
        memory: &Memory,
        trusted: &AcceptedData,
        wanted: &BTreeSet<PacketKey>,
    ) -> Result<(), AgentError> {
        let own = packets_with(memory, own_of(memory, wanted));
        let mut shared = memory.codec.team.model.prior_posterior();
        shared.absorb_summaries(&summaries(&own))?;
        let pair = self.pair_at_fit(memory, trusted)?;
        // This is the last step that may fail. The posteriors change together.
        self.rebuild_alternative(memory, trusted, 0)?;
        (self.pair, self.shared) = (pair, shared);
        self.included.pending_own.sort_by(RecordedEvent::order);
        (self.included.absorbed, self.included.is_stale) = (0, false);
        self.included.packets.clone_from(wanted);
        self.included.remote = self.fitted_among(trusted).map(|(&key, event)| (key, event.clone())).collect();
        self.included.pending_remote = [0, 0];
        Ok(())
    }

    /// Computes the posterior under the alternative model: of the last fit, without events of members that are not
    /// trusted, and of the first `absorbed` own events since that fit.
    fn rebuild_alternative(
        &mut self,
        memory: &Memory,
        trusted: &AcceptedData,
        absorbed: usize,
    ) -> Result<(), AgentError> {
        let absorbed = &self.included.pending_own[..absorbed];
        self.alternative.as_mut().map_or(Ok(()), |alternative| alternative.rebuild(memory, trusted, absorbed))
    }

    /// Requests a rebuild of the posteriors, and another detection of faulty members.
    pub(crate) fn invalidate(&mut self) {
        self.included.is_stale = true;
        self.examined = None;
    }
}

/// Returns the vehicle's own packets among these.
fn own_of<'a>(memory: &Memory, packets: &'a BTreeSet<PacketKey>) -> Vec<&'a PacketKey> {
    packets.iter().filter(|key| Some(key.0) == memory.own).collect()
}
