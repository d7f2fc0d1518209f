//! What a vehicle believes: fits and posteriors, which follow from its memory and can be made again at any time.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::{Posterior, Summary};

use crate::agent_error::AgentError;
use crate::event::Event;
use crate::events::{Change, Recorded};
use crate::fitted::{Fitted, Part, Source};
use crate::fitting::absorb_event;
use crate::frames::ToldKey;
use crate::heard::{Heard, Packets, counting, said, summaries};
use crate::memory::Memory;
use crate::model::Model;
use crate::placing::{ToldEvents, among, is_among};
use crate::reports::{Told, Worth};
use crate::tellings::Tellings;

/// A prior of its own that a vehicle predicts under, and the fit of all events under it.
#[derive(Debug)]
pub(crate) struct OwnModel {
    pub(crate) fitted: Fitted,
    /// The packets that this was fitted beside.
    pub(crate) packets: Packets,
    #[cfg(feature = "learn")]
    pub(crate) learned: crate::learning::LearnedModel,
}

/// What is believed.
#[derive(Debug, Clone)]
pub(crate) struct Beliefs {
    /// The last fit of its own events under the team's model.
    pub(crate) alone: Option<Arc<Fitted>>,
    /// The last fit of its own events and of those that were told, under the team's model, if any were.
    pub(crate) together: Option<Arc<Fitted>>,
    /// Whether the last fit began anew.
    pub(crate) began_cold: bool,
    /// Its own model, if it learned one.
    pub(crate) own_model: Option<Arc<OwnModel>>,
    /// Of its own events, under the team's model.
    pub(crate) own: Posterior,
    /// Of the packets that it sent, under the team's model, without what it reported beside ([`Beliefs::public_of`]).
    pub(crate) public: Posterior,
    /// Of its own events and what others sent, under its own model if it has one.
    pub(crate) fused: Posterior,
    /// What it told in reports, as far as its last sparse fit knows it.
    told: Option<Part>,
    pub(crate) taken: Taken,
    /// Members who do not count, because they say what all others and the vehicle itself know to be wrong.
    pub(crate) left_out: BTreeSet<u8>,
    /// The packets by which that was decided; none where it has to be decided anew.
    pub(crate) judged: Option<Packets>,
    /// The frame for which the last attempt found nothing worth sending, if nothing happened since.
    pub(crate) nothing_new_in: Option<usize>,
}

/// What of the memory is in the posteriors.
#[derive(Debug, Clone, Default)]
pub(crate) struct Taken {
    /// Events of its own that came since the last fit.
    pub(crate) beside: Vec<Recorded>,
    /// How many of these are in, from the first on.
    pub(crate) absorbed: usize,
    /// Events of its own that went since the last fit, and are in all the same.
    pub(crate) forgotten: usize,
    /// Told events that are in, as they were placed.
    told: ToldEvents,
    /// All that were believed when these were taken in.
    believed: Option<Arc<ToldEvents>>,
    /// How many of these stand beside the last fit, and how many wait for the next.
    pub(crate) told_beside: [usize; 2],
    /// The packets that are in, its own included.
    packets: Packets,
    /// What it had reported when something was last taken in.
    reported: Option<Arc<Told>>,
    /// Whether the posteriors must be put together anew, whatever is in them.
    is_stale: bool,
}

impl Taken {
    /// Notes that all events were fitted anew, and that everything is to be put together by that.
    pub(crate) fn begin_anew(&mut self) {
        *self = Self { is_stale: true, packets: std::mem::take(&mut self.packets), ..Self::default() };
    }

    /// Those of what was told that are not in.
    fn not_in(&self, told: &ToldEvents) -> Vec<(ToldKey, Arc<Event>)> {
        let mut is_in = among(&self.told);
        told.iter().filter(|told| !is_in(*told)).map(|(&key, event)| (key, event.clone())).collect()
    }
}

impl Beliefs {
    /// What is believed before anything happened.
    pub(crate) fn new(model: &Model) -> Self {
        let nothing = model.known_before();
        Self {
            alone: None,
            together: None,
            began_cold: false,
            own_model: None,
            own: nothing.clone(),
            public: nothing.clone(),
            fused: nothing,
            told: None,
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

    /// Takes in what arrived, O(n²) for every event and point. After a fit, or where something is in that counts no more,
    /// everything is put together anew, O(n³). Nothing is fitted here.
    pub(crate) fn update(&mut self, memory: &Memory, heard: &Heard) -> Result<(), AgentError> {
        self.take_in(memory, &heard.without(&self.left_out))?;
        if let Some((left_out, [own, fused])) = self.judge(memory, heard)? {
            (self.left_out, self.own, self.fused) = (left_out, own, fused);
            let believed = heard.without(&self.left_out);
            self.taken.beside.sort_by(Recorded::order);
            self.taken.packets = self.wanted(memory, &believed);
            self.taken.told = self.fitted_of(&believed).map(|(&key, event)| (key, event.clone())).collect();
            self.taken.told_beside = [0, believed.told.len() - self.taken.told.len()];
            self.taken.believed = Some(believed.told.clone());
            let absorbed = self.absorb_told(memory, &believed);
            self.taken.is_stale = absorbed.is_err();
            absorbed?;
        }
        self.judged = Some(heard.packets.clone());
        Ok(())
    }

    /// Brings the posteriors to hold what they should: what was told, and what was heard of members that are believed.
    fn take_in(&mut self, memory: &Memory, believed: &Heard) -> Result<(), AgentError> {
        let wanted = self.wanted(memory, believed);
        let reported = memory.own.and_then(|own| memory.reports.told_by_shared(own));
        let is_reported_anew = reported.as_ref().map(Arc::as_ptr) != self.taken.reported.as_ref().map(Arc::as_ptr);
        if is_reported_anew || own_of(memory, &self.taken.packets) != own_of(memory, &wanted) {
            self.nothing_new_in = None;
        }
        let is_in = |(key, worth): (&_, &Worth)| wanted.get(key) == Some(worth);
        let is_new = |(key, worth): (&_, &Worth)| *worth == Worth::Beyond && !self.taken.packets.contains_key(key);
        // What the last fit has is put together from its sites, also when it comes to count again.
        let is_told_as_before = self.taken.believed.as_ref().is_some_and(|before| Arc::ptr_eq(before, &believed.told));
        let is_told_otherwise = || {
            !self.taken.told.iter().all(among(&believed.told)) || !self.fitted_of(believed).all(among(&self.taken.told))
        };
        let has_changed = !self.taken.packets.iter().all(is_in)
            || wanted.iter().any(is_new)
            || !is_told_as_before && is_told_otherwise();
        self.taken.reported = reported;
        let is_put_together = self.taken.is_stale || has_changed;
        if is_put_together {
            self.put_together(memory, believed, &wanted)?;
        }
        let mut absorbed = self.absorb_events(memory).and_then(|()| self.absorb_packets(memory, &wanted));
        if is_put_together || !is_told_as_before {
            absorbed = absorbed.and_then(|()| self.absorb_told(memory, believed));
        }
        self.taken.believed = Some(believed.told.clone());
        self.taken.is_stale = absorbed.is_err();
        absorbed
    }

    /// The packets that should be in: what was told, and what was heard of members that are believed.
    fn wanted(&self, memory: &Memory, believed: &Heard) -> Packets {
        let told = memory.told().map(|(counter, _)| (memory.own.unwrap_or_default(), counter));
        counting(memory, told).into_iter().chain(believed.packets.clone()).collect()
    }

    /// What the own and the fused posterior would be with just this of others: in canonical order, so that they are the same to
    /// the bit as when everything is put together anew. Told events beside the last fit are not in.
    pub(crate) fn own_and_fused(&self, memory: &Memory, believed: &Heard) -> Result<[Posterior; 2], AgentError> {
        let (mut own, mut fused) = self.at_fit(memory, believed)?;
        let mut beside: Vec<&Recorded> = self.taken.beside.iter().collect();
        beside.sort_by(|a, b| a.order(b));
        for known in &beside[..self.taken.absorbed] {
            absorb_event(&memory.observation(&known.event)?, &mut own, &mut fused, self.own_model.is_some())?;
        }
        Ok([own, fused])
    }

    /// The own and the fused posterior of the last fit and this of others, before any event beside it.
    fn at_fit(&self, memory: &Memory, believed: &Heard) -> Result<(Posterior, Posterior), AgentError> {
        let model = &memory.frames.team.model;
        let place: Vec<&Summary> = model.place_summary().into_iter().collect();
        let own =
            self.alone.as_ref().map_or_else(|| Ok(model.known_before()), |alone| alone.fit.posterior_with(&place))?;
        let packets = said(memory, &believed.packets, Worth::All);
        let is_alone = self.own_model.is_none() && self.together.is_none() && believed.packets.is_empty();
        let fused = match self.fitted() {
            Some(_) if is_alone => own.clone(),
            Some(fitted) => {
                let is_in = |source: &Source| match source {
                    Source::Own(_) => true,
                    Source::Told(key) => {
                        fitted.told.get_key_value(key).is_some_and(|told| is_among(&believed.told, told))
                    }
                };
                let beyond = self.beyond(memory, fitted, believed)?;
                let messages: Vec<&Summary> = place.into_iter().chain(summaries(&packets)).chain(&beyond).collect();
                fitted.posterior_of(is_in, &messages)?
            }
            None => {
                let mut fused = model.known_before();
                let beyond = said(memory, &believed.packets, Worth::Beyond);
                fused.absorb_summaries(&[summaries(&packets), summaries(&beyond)].concat())?;
                fused
            }
        };
        Ok((own, fused))
    }

    /// What packets of members say beyond the events that they told, as far as they may speak of these. Nothing as long as the fit
    /// has not all of these: the others stand beside it, and nothing would be taken from the packets for them.
    fn beyond(&self, memory: &Memory, fitted: &Fitted, believed: &Heard) -> Result<Vec<Summary>, AgentError> {
        let place: Vec<&Summary> = memory.frames.team.model.place_summary().into_iter().collect();
        let mut all = Vec::new();
        let mut is_fitted = among(&fitted.told);
        let beside = believed.told.iter().filter(|told| !is_fitted(*told));
        let beside: BTreeSet<u8> = beside.map(|(key, _)| key.0).collect();
        for member in believed.others(memory.own).difference(&beside).copied() {
            let packets = said(memory, &believed.of_member(member).packets, Worth::Beyond);
            let is_told = |source: &Source| matches!(source, Source::Told(key) if key.0 == member && believed.told.contains_key(key));
            all.extend(fitted.beyond(is_told, &place, &packets)?);
        }
        Ok(all)
    }

    /// Sums up what it told in reports, as far as others may know it: in a long mission from frame to frame and not anew for each.
    pub(crate) fn recall_told(&mut self, memory: &Memory, tellings: &Tellings) -> Result<(), AgentError> {
        let reported = memory.own.and_then(|own| memory.reports.told_by(own));
        let Some(alone) = self.alone.as_ref().filter(|_| reported.is_some()) else { return Ok(()) };
        let numbers = memory.numbers_of(&|slot| tellings.is_known(slot));
        self.told = alone.part(&numbers, self.told.as_ref())?;
        Ok(())
    }

    /// What others know by these of its packets and by what it told of these slots.
    pub(crate) fn public_of(
        &self,
        memory: &Memory,
        packets: &Packets,
        is_told: &dyn Fn(u32) -> bool,
    ) -> Result<Posterior, AgentError> {
        let model = &memory.frames.team.model;
        let place: Vec<&Summary> = model.place_summary().into_iter().collect();
        let told: BTreeSet<u64> = memory.numbers_of(is_told);
        let [all, part] = [Worth::All, Worth::Beyond].map(|worth| said(memory, packets, worth));
        let mut public = match &self.alone {
            Some(alone) if !told.is_empty() => {
                let is_in = |source: &Source| matches!(source, Source::Own(number) if told.contains(number));
                let beyond = alone.beyond(is_in, &place, &part)?;
                let messages: Vec<&Summary> = place.into_iter().chain(summaries(&all)).chain(&beyond).collect();
                match alone.part(&told, self.told.as_ref())? {
                    Some(part) => part.posterior_with(&messages)?,
                    None => alone.posterior_of(is_in, &messages)?,
                }
            }
            _ => {
                let mut public = model.known_before();
                public.absorb_summaries(&[summaries(&all), summaries(&part)].concat())?;
                public
            }
        };
        self.tell_beside(memory, &mut public, is_told)?;
        Ok(public)
    }

    /// What others know once they were told of these slots, too, which they have not been: O(n²) for each event, whatever else was
    /// told. Packets count for what they did before.
    pub(crate) fn public_with(
        &self,
        memory: &Memory,
        public: &Posterior,
        slots: &BTreeSet<u32>,
    ) -> Result<Posterior, AgentError> {
        let mut public = public.clone();
        if let Some(alone) = &self.alone {
            let told = memory.numbers_in(slots);
            let part = alone.own_places(|number| told.contains(&number));
            public.absorb_events(&alone.fit.sites().select(&part))?;
        }
        self.tell_beside(memory, &mut public, &|slot| slots.contains(&slot))?;
        Ok(public)
    }

    /// Tells somebody who knows `public` of the events of these slots that stand beside the last fit.
    fn tell_beside(
        &self,
        memory: &Memory,
        public: &mut Posterior,
        is_told: &dyn Fn(u32) -> bool,
    ) -> Result<(), AgentError> {
        for known in &self.taken.beside {
            if known.key.is_some_and(|(_, slot)| is_told(slot)) {
                dgpc::absorb_observations(public, &memory.observation(&known.event)?)?;
            }
        }
        Ok(())
    }

    /// The last fit that it predicts by.
    pub(crate) fn fitted(&self) -> Option<&Fitted> {
        let own_model = self.own_model.as_ref().map(|own| &own.fitted);
        own_model.or(self.together.as_deref()).or(self.alone.as_deref())
    }

    /// Told events that the last fit has, as they are told.
    fn fitted_of<'a>(&'a self, believed: &'a Heard) -> impl Iterator<Item = (&'a ToldKey, &'a Arc<Event>)> {
        let told = self.fitted().into_iter().flat_map(|fitted| &*fitted.told);
        let mut is_believed = among(&believed.told);
        told.filter(move |told| is_believed(*told))
    }

    /// Events of its own that the posteriors hold beside the last fit.
    pub(crate) fn beside(&self) -> &[Recorded] {
        &self.taken.beside[..self.taken.absorbed]
    }

    fn absorb_events(&mut self, memory: &Memory) -> Result<(), AgentError> {
        let end = self.taken.beside.len().min(memory.frames.team.limits.events_beside_max);
        for known in &self.taken.beside[self.taken.absorbed..end] {
            absorb_event(&memory.observation(&known.event)?, &mut self.own, &mut self.fused, self.own_model.is_some())?;
        }
        self.taken.absorbed = end;
        Ok(())
    }

    /// Takes in told events that the last fit does not have, up to a number.
    fn absorb_told(&mut self, memory: &Memory, believed: &Heard) -> Result<(), AgentError> {
        let mut new = self.taken.not_in(&believed.told);
        new.sort_by(|a, b| a.1.canonical_order(&b.1));
        let [in_already, _] = self.taken.told_beside;
        let room = memory.frames.team.limits.events_beside_max.saturating_sub(in_already).min(new.len());
        let waiting = new.split_off(room);
        let observations = memory.frames.team.model.observations(new.iter().map(|(_, event)| &**event))?;
        dgpc::absorb_observations(&mut self.fused, &observations)?;
        self.taken.told.extend(new);
        self.taken.told_beside = [in_already + room, waiting.len()];
        Ok(())
    }

    fn absorb_packets(&mut self, memory: &Memory, wanted: &Packets) -> Result<(), AgentError> {
        let new = wanted.iter().filter(|(key, _)| !self.taken.packets.contains_key(key));
        let new: Packets = new.map(|(&key, &worth)| (key, worth)).collect();
        let own = own_of(memory, &new);
        let told = said(memory, &own, Worth::All);
        let others = new.into_iter().filter(|(key, _)| !own.contains_key(key)).collect();
        let heard = said(memory, &others, Worth::All);
        self.public.absorb_summaries(&summaries(&told))?;
        let prior = self.fused.prior();
        let heard = summaries(&heard).into_iter().map(|summary| summary.read_under(prior));
        let heard: Vec<_> = heard.collect::<Result<_, dgpc::Error>>()?;
        self.fused.absorb_summaries(&heard.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        self.taken.packets.clone_from(wanted);
        Ok(())
    }

    /// The posteriors of the last fit and this. Events since that fit are to be absorbed again.
    fn put_together(&mut self, memory: &Memory, believed: &Heard, wanted: &Packets) -> Result<(), AgentError> {
        let public = self.public_of(memory, &own_of(memory, wanted), &|_| false)?;
        (self.own, self.fused) = self.at_fit(memory, believed)?;
        self.public = public;
        self.taken.beside.sort_by(Recorded::order);
        (self.taken.absorbed, self.taken.is_stale) = (0, false);
        self.taken.packets.clone_from(wanted);
        self.taken.told = self.fitted_of(believed).map(|(&key, event)| (key, event.clone())).collect();
        self.taken.told_beside = [0, 0];
        Ok(())
    }

    /// Asks for everything to be decided anew: a fit that is as it was decides nothing, and whom one looked at depends on the order of packets.
    pub(crate) fn invalidate(&mut self) {
        self.taken.is_stale = true;
        self.judged = None;
    }
}

/// Those of these packets that the vehicle sent itself.
fn own_of(memory: &Memory, packets: &Packets) -> Packets {
    packets.iter().filter(|(key, _)| Some(key.0) == memory.own).map(|(&key, &worth)| (key, worth)).collect()
}
