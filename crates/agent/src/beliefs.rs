//! What a vehicle believes: fits and posteriors, which follow from its memory and can be made again at any time.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use dgpc::{Fit, Posterior, Prior, Summary};

use crate::agent_error::AgentError;
use crate::event::Event;
use crate::events::{Change, Numbered};
use crate::fitting::{self, Begin, absorb_event};
use crate::memory::Memory;
use crate::model::Model;
use crate::packets::{Packet, PacketKey};
use crate::said::{said, summaries, surprise, told_and_heard};

/// So many events may stand beside the last fit before the next; those beyond wait for it.
pub(crate) const BESIDE_MAX: usize = 64;

/// Share of the threshold of surprise from which on a member is suspect when another one is above.
const NEAR: f64 = 0.6;

/// The smallest tilt that a warm fit begins at.
const TILT_MIN: f64 = 1e-9;

/// A prior of its own that a vehicle predicts under, and the fit of its events under it.
#[derive(Debug)]
pub(crate) struct OwnModel {
    pub(crate) fit: Fit,
    #[cfg(feature = "learn")]
    pub(crate) learned: crate::learning::LearnedModel,
}

/// Where a fit begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Start {
    /// At the last one: sooner done, and the same to the tolerance of a fit.
    Warm,
    /// Anew: the same to the bit whatever was before.
    Cold,
}

/// Who is left out, and the own and the fused posterior without them.
type Verdict = (BTreeSet<u8>, [Posterior; 2]);

/// What is believed.
#[derive(Debug, Clone)]
pub(crate) struct Beliefs {
    /// The last fit of its own events under the team's model.
    pub(crate) fit: Option<Arc<Fit>>,
    /// Whether that fit began anew.
    began_cold: bool,
    /// Numbers of the events of that fit, in its order.
    fitted: Arc<Vec<u64>>,
    /// Its own model, if it learned one.
    pub(crate) own_model: Option<Arc<OwnModel>>,
    /// Of its own events, under the team's model.
    pub(crate) own: Posterior,
    /// Of what it sent, under the team's model.
    pub(crate) public: Posterior,
    /// Of its own events and what others sent, under its own model if it has one.
    pub(crate) fused: Posterior,
    taken: Taken,
    /// Members whose packets do not count, because they say what all others and the vehicle itself know to be wrong.
    left_out: BTreeSet<u8>,
    /// The packets by which that was decided; none where it has to be decided anew.
    judged: Option<BTreeSet<PacketKey>>,
    /// The frame for which the last attempt found nothing worth sending, if nothing happened since.
    pub(crate) nothing_new_in: Option<usize>,
}

/// What of the memory is in the posteriors.
#[derive(Debug, Clone, Default)]
struct Taken {
    /// Events that came since the last fit.
    beside: Vec<Event>,
    /// How many of these are in, from the first on.
    absorbed: usize,
    /// Events that went since the last fit, and are in all the same.
    forgotten: usize,
    /// The packets that are in.
    packets: BTreeSet<PacketKey>,
    /// Whether the posteriors must be put together anew, whatever is in them.
    is_stale: bool,
}

impl Taken {
    /// Whether the posteriors hold what they should: `packets`, and so many events as stand beside a fit.
    fn holds(&self, memory: &Memory, fitted: usize, packets: &BTreeSet<PacketKey>) -> bool {
        !self.is_stale
            && self.packets == *packets
            && self.absorbed == self.beside.len().min(BESIDE_MAX)
            && fitted + self.beside.len() == memory.events.len() + self.forgotten
    }
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

impl Beliefs {
    /// What is believed before anything happened.
    pub(crate) fn new(model: &Model) -> Self {
        let nothing = model.known_before();
        Self {
            fit: None,
            began_cold: false,
            fitted: Arc::default(),
            own_model: None,
            own: nothing.clone(),
            public: nothing.clone(),
            fused: nothing,
            taken: Taken::default(),
            left_out: BTreeSet::new(),
            judged: None,
            nothing_new_in: None,
        }
    }

    /// Notes what became of the events that the memory was given.
    pub(crate) fn note(&mut self, change: Change) {
        if !change.new.is_empty() || change.forgotten > 0 {
            self.nothing_new_in = None;
        }
        self.taken.beside.extend(change.new);
        self.taken.forgotten += change.forgotten;
    }

    /// Whether more events came or went since the last fit than can stand beside it.
    pub(crate) fn refit_due(&self) -> bool {
        self.taken.beside.len() > BESIDE_MAX || self.taken.forgotten > BESIDE_MAX
    }

    /// Fits the events of the memory, under the team's model and, with what was heard, under its own if it has one. Does
    /// nothing where the last fit is what this one would be.
    pub(crate) fn refit(
        &mut self,
        memory: &Memory,
        heard: &BTreeSet<PacketKey>,
        start: Start,
    ) -> Result<(), AgentError> {
        let is_fitted = self.fit.is_some() && self.taken.beside.is_empty() && self.taken.forgotten == 0;
        if is_fitted && (start == Start::Warm || self.began_cold) {
            return Ok(());
        }
        let model = &memory.frames.team.model;
        let observations = model.observations(memory.events.iter())?;
        let fit_anew = |prior: &Prior, messages: &[&Summary], last: Option<&Fit>, near: &Posterior| {
            let last = last.filter(|_| start == Start::Warm);
            let begin = last.map(|last| self.tilts(memory, last, near)).transpose()?;
            let begin = begin.as_ref().map(|(tilts, new)| Begin {
                inducing_points: last.and_then(Fit::inducing_points).filter(|_| messages.is_empty()),
                tilts,
                new,
            });
            fitting::fit(prior, &observations, messages, &memory.frames.team.limits, begin)
        };
        let place: Vec<&Summary> = model.place_summary().into_iter().collect();
        let fit = fit_anew(&model.prior, &place, self.fit.as_deref(), &self.own)?;
        let own_model = match &self.own_model {
            Some(own) => {
                let packets = said(memory, heard.iter());
                let messages = [place, summaries(&packets)].concat();
                let fit = fit_anew(own.fit.prior(), &messages, Some(&own.fit), &self.fused)?;
                Some(Arc::new(own.with(fit)))
            }
            None => None,
        };
        self.began_cold = start == Start::Cold || self.fit.is_none();
        (self.fit, self.own_model) = (Some(Arc::new(fit)), own_model);
        self.fitted = Arc::new(memory.events.numbered().iter().map(|known| known.number).collect());
        self.taken = Taken { is_stale: true, packets: std::mem::take(&mut self.taken.packets), ..Taken::default() };
        (self.judged, self.nothing_new_in) = (None, None);
        Ok(())
    }

    /// Tilts to begin with: those of the last fit and, of events that were not in it, what the posterior near it says;
    /// and which events these are.
    fn tilts(&self, memory: &Memory, last: &Fit, near: &Posterior) -> dgpc::Result<(Vec<f64>, Vec<usize>)> {
        let known: HashMap<u64, f64> = self.fitted.iter().copied().zip(last.tilts().iter().copied()).collect();
        let events = memory.events.numbered();
        let new: Vec<usize> = (0..events.len()).filter(|&place| !known.contains_key(&events[place].number)).collect();
        let attempts = new.iter().map(|&place| events[place].event.attempt());
        let latent = near.latent(&memory.frames.team.model.inputs(attempts)?)?;
        let mut tilts =
            latent.mean.iter().zip(&latent.variance).map(|(mean, variance)| (mean * mean + variance).sqrt());
        let tilt = |event: &Numbered| known.get(&event.number).copied().or_else(|| tilts.next()).unwrap_or(1.0);
        // Where f is known to be 0 the tilt is 0, but an iteration begins above.
        Ok((events.iter().map(tilt).map(|tilt| tilt.max(TILT_MIN)).collect(), new))
    }

    /// Takes in what arrived, O(n²) for every event and point. After a fit, or where packets are in that count no more,
    /// everything is put together anew, O(n³). Nothing is fitted here.
    pub(crate) fn update(&mut self, memory: &Memory, heard: &BTreeSet<PacketKey>) -> Result<(), AgentError> {
        self.take_in(memory, heard)?;
        if let Some((left_out, [own, fused])) = self.judge(memory, heard)? {
            (self.left_out, self.own, self.fused) = (left_out, own, fused);
            self.taken.beside.sort_by(Event::canonical_order);
            self.taken.packets = self.wanted(memory, heard);
        }
        self.judged = Some(heard.clone());
        Ok(())
    }

    /// Brings the posteriors to hold what they should: what was told, and what was heard of members that are not left
    /// out.
    fn take_in(&mut self, memory: &Memory, heard: &BTreeSet<PacketKey>) -> Result<(), AgentError> {
        let wanted = self.wanted(memory, heard);
        let is_told = |key: &&PacketKey| Some(key.0) == memory.own;
        if !self.taken.packets.iter().filter(is_told).eq(wanted.iter().filter(is_told)) {
            self.nothing_new_in = None;
        }
        if self.taken.is_stale || !self.taken.packets.is_subset(&wanted) {
            self.put_together(memory, &wanted)?;
        }
        let absorbed = self.absorb_events(memory).and_then(|()| self.absorb_packets(memory, &wanted));
        self.taken.is_stale = absorbed.is_err();
        debug_assert!(absorbed.is_err() || self.taken.holds(memory, self.fitted.len(), &wanted), "{:?}", self.taken);
        absorbed
    }

    /// The packets that should be in: what was told, and what was heard of members that are not left out.
    fn wanted(&self, memory: &Memory, heard: &BTreeSet<PacketKey>) -> BTreeSet<PacketKey> {
        let own = memory.own.unwrap_or_default();
        let told = memory.told().map(|(counter, _)| (own, counter));
        told.chain(heard.iter().filter(|key| !self.left_out.contains(&key.0)).copied()).collect()
    }

    /// Who is to be left out, given what was heard, and the fused posterior without them; none where it is as it was.
    /// Between fits only members that said something since the last time are looked at, and everybody as soon as one of
    /// them is surprising, or was: O(M n²) for each of their M points, and O(n³) where somebody goes or comes back.
    fn judge(&self, memory: &Memory, heard: &BTreeSet<PacketKey>) -> Result<Option<Verdict>, AgentError> {
        let Some(judged) = &self.judged else { return self.surprising(memory, heard) };
        let speakers: BTreeSet<u8> = judged.symmetric_difference(heard).map(|key| key.0).collect();
        let threshold = memory.frames.team.surprise_max;
        for &speaker in &speakers {
            if self.left_out.contains(&speaker)
                || surprise(&self.fused, memory, heard, speaker, Posterior::shift_of)? > threshold
            {
                return self.surprising(memory, heard);
            }
        }
        Ok(None)
    }

    /// Who surprises is left out, one after the other, until nobody who is left is too surprising. Somebody who claims to
    /// be very sure makes all honest members look surprising, and may look less so himself: of those that come near the
    /// threshold when one is above, the one goes first whom the vehicle's own events contradict most. Depends on the set
    /// of packets and the last fit alone.
    fn surprising(&self, memory: &Memory, heard: &BTreeSet<PacketKey>) -> Result<Option<Verdict>, AgentError> {
        let threshold = memory.frames.team.surprise_max;
        let mut left_out = BTreeSet::new();
        loop {
            let is_in = |key: &&PacketKey| !left_out.contains(&key.0);
            let believed: BTreeSet<PacketKey> = heard.iter().filter(is_in).copied().collect();
            let is_as_it_was = left_out == self.left_out;
            let [own, posterior] = match is_as_it_was {
                true => [self.own.clone(), self.fused.clone()],
                false => self.own_and_fused(memory, &believed)?,
            };
            let members: BTreeSet<u8> = believed.iter().map(|key| key.0).collect();
            let moved = |&member: &u8| Ok((surprise(&posterior, memory, heard, member, Posterior::shift_of)?, member));
            let surprises = members.iter().map(moved).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
            if surprises.iter().all(|&(surprise, _)| surprise <= threshold) {
                return Ok((!is_as_it_was).then_some((left_out, [own, posterior])));
            }
            let suspects = surprises.iter().filter(|&&(surprise, _)| surprise > NEAR * threshold);
            left_out.extend(self.most_contradicted(memory, heard, suspects.map(|&(_, member)| member))?);
        }
    }

    /// Of these members the one whom the vehicle's own events contradict most.
    fn most_contradicted(
        &self,
        memory: &Memory,
        heard: &BTreeSet<PacketKey>,
        suspects: impl Iterator<Item = u8>,
    ) -> Result<Option<u8>, AgentError> {
        let [_, alone] = self.own_and_fused(memory, &BTreeSet::new())?;
        let contradicted = |member| Ok((surprise(&alone, memory, heard, member, Posterior::shift_by)?, member));
        let contradicted = suspects.map(contradicted).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
        Ok(contradicted.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, member)| member))
    }

    /// What the own and the fused posterior would be with just these packets of others: in canonical order, so that they
    /// are the same to the bit as when everything is put together anew.
    fn own_and_fused(&self, memory: &Memory, heard: &BTreeSet<PacketKey>) -> Result<[Posterior; 2], AgentError> {
        let (mut own, mut fused) = self.at_fit(memory, &said(memory, heard.iter()))?;
        let mut beside: Vec<&Event> = self.taken.beside.iter().collect();
        beside.sort_by(|a, b| a.canonical_order(b));
        for event in &beside[..self.taken.absorbed] {
            absorb_event(&memory.observation(event)?, &mut own, &mut fused, self.own_model.is_some())?;
        }
        Ok([own, fused])
    }

    /// The own and the fused posterior of the last fit and these packets of others, before any event beside it.
    fn at_fit(&self, memory: &Memory, heard: &[Arc<Packet>]) -> Result<(Posterior, Posterior), AgentError> {
        let model = &memory.frames.team.model;
        let place: Vec<&Summary> = model.place_summary().into_iter().collect();
        let own = self.fit.as_ref().map_or_else(|| Ok(model.known_before()), |fit| fit.posterior_with(&place))?;
        let fused = match self.fit_of_fused() {
            Some(fit) => fit.posterior_with(&[place, summaries(heard)].concat())?,
            None => {
                let mut fused = model.known_before();
                fused.absorb_summaries(&summaries(heard))?;
                fused
            }
        };
        Ok((own, fused))
    }

    /// The last fit of its own events under the model that it predicts under.
    pub(crate) fn fit_of_fused(&self) -> Option<&Fit> {
        self.own_model.as_ref().map(|own| &own.fit).or(self.fit.as_deref())
    }

    /// Events that the posteriors hold beside the last fit.
    pub(crate) fn beside(&self) -> &[Event] {
        &self.taken.beside[..self.taken.absorbed]
    }

    /// Members that are left out.
    pub(crate) fn left_out(&self) -> &BTreeSet<u8> {
        &self.left_out
    }

    /// See [`crate::Agent::surprise`].
    pub(crate) fn surprise_of(
        &self,
        memory: &Memory,
        heard: &BTreeSet<PacketKey>,
        member: u8,
    ) -> Result<f64, AgentError> {
        let is_out = self.left_out.contains(&member);
        let shift = if is_out { Posterior::shift_by } else { Posterior::shift_of };
        surprise(&self.fused, memory, heard, member, shift)
    }

    fn absorb_events(&mut self, memory: &Memory) -> Result<(), AgentError> {
        let end = self.taken.beside.len().min(BESIDE_MAX);
        for event in &self.taken.beside[self.taken.absorbed..end] {
            absorb_event(&memory.observation(event)?, &mut self.own, &mut self.fused, self.own_model.is_some())?;
        }
        self.taken.absorbed = end;
        Ok(())
    }

    fn absorb_packets(&mut self, memory: &Memory, wanted: &BTreeSet<PacketKey>) -> Result<(), AgentError> {
        let new: Vec<PacketKey> = wanted.difference(&self.taken.packets).copied().collect();
        let [told, heard] = told_and_heard(memory, &new);
        self.public.absorb_summaries(&summaries(&told))?;
        let prior = self.fused.prior();
        let heard = summaries(&heard).into_iter().map(|summary| summary.read_under(prior));
        let heard: Vec<_> = heard.collect::<Result<_, dgpc::Error>>()?;
        self.fused.absorb_summaries(&heard.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        self.taken.packets.extend(new);
        Ok(())
    }

    /// The posteriors of the last fit and these packets. Events since that fit are to be absorbed again.
    pub(crate) fn put_together(&mut self, memory: &Memory, wanted: &BTreeSet<PacketKey>) -> Result<(), AgentError> {
        let [told, heard] = told_and_heard(memory, wanted);
        let mut public = memory.frames.team.model.known_before();
        public.absorb_summaries(&summaries(&told))?;
        (self.own, self.fused) = self.at_fit(memory, &heard)?;
        self.public = public;
        self.taken.beside.sort_by(Event::canonical_order);
        (self.taken.absorbed, self.taken.is_stale) = (0, false);
        self.taken.packets.clone_from(wanted);
        Ok(())
    }

    /// Asks for everything to be put together anew.
    pub(crate) fn invalidate(&mut self) {
        self.taken.is_stale = true;
    }
}
