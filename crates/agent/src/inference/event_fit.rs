//! Fits of own and remote events.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

use dgpc::{Fit, Observations, Posterior, Prior, Summary};

use crate::codec::decoded::EventKey;
use crate::error::AgentError;
use crate::inference::accepted::AcceptedData;
use crate::inference::fitting::{self, WarmStart};
use crate::store::event_location::{RemoteEvents, is_among};
use crate::store::memory::Memory;
use crate::types::event::Event;
use crate::types::limits::Limits;

/// Smallest tilt at which a warm fit starts.
const TILT_MIN: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum EventSource {
    /// Recorded by the vehicle itself, by number.
    Own(u64),
    /// Reported by another member.
    Remote(EventKey),
}

#[derive(Debug)]
pub(crate) struct EventFit {
    pub(crate) fit: Fit,
    /// Sources of the events, in the order of the fit.
    pub(crate) sources: Vec<EventSource>,
    /// Number of events that were added or removed since all events were fitted together.
    changes_since_fit: usize,
    /// Remote events of the fit, as they were located.
    pub(crate) remote: Arc<RemoteEvents>,
    /// Identity of the sites of own events. Two fits that share it have equal sites for all own events that both
    /// contain.
    sites_id: Arc<()>,
}

/// Summary of a part of the vehicle's own events of a sparse fit.
#[derive(Debug, Clone)]
pub(crate) struct PartialSummary {
    numbers: BTreeSet<u64>,
    summary: Summary,
    /// [`EventFit::sites_id`] of the fit.
    sites_id: Arc<()>,
}

impl EventFit {
    /// Returns the posterior of the events with wanted sources and of these summaries.
    pub(crate) fn posterior_of(
        &self,
        is_wanted: impl Fn(&EventSource) -> bool,
        summaries: &[&Summary],
    ) -> dgpc::Result<Posterior> {
        let wanted: Vec<usize> = (0..self.sources.len()).filter(|&index| is_wanted(&self.sources[index])).collect();
        match wanted.len() == self.sources.len() {
            true => self.fit.posterior_with(summaries),
            false => self.fit.posterior_of_part(&wanted, summaries),
        }
    }

    /// Returns the summary of the own events with these numbers; `None` for a dense fit.
    ///
    /// If `previous` is a summary of similar events, it is updated at O(M²) for each event that only one of both
    /// contains. From frame to frame this is cheap, because few outcomes are delivered in between. Otherwise the cost
    /// is that of [`Fit::summary_of_part`].
    pub(crate) fn partial_summary(
        &self,
        numbers: &BTreeSet<u64>,
        previous: Option<&PartialSummary>,
    ) -> dgpc::Result<Option<PartialSummary>> {
        let wanted = self.own_indices(|number| numbers.contains(&number));
        let numbers: BTreeSet<u64> = wanted.iter().filter_map(|&index| self.own_number(index)).collect();
        let sites_id = self.sites_id.clone();
        if let Some(previous) = previous.filter(|previous| Arc::ptr_eq(&previous.sites_id, &sites_id)) {
            let added = self.own_indices(|number| numbers.contains(&number) && !previous.numbers.contains(&number));
            let removed = self.own_indices(|number| previous.numbers.contains(&number) && !numbers.contains(&number));
            if added.len() + removed.len() < wanted.len() {
                let mut summary = previous.summary.clone();
                summary.forget(&self.fit.sites().select(&removed))?;
                summary.observe(&self.fit.sites().select(&added))?;
                return Ok(Some(PartialSummary { numbers, summary, sites_id }));
            }
        }
        Ok(self.fit.summary_of_part(&wanted)?.map(|summary| PartialSummary { numbers, summary, sites_id }))
    }

    /// Returns whether a remote event of the fit is accepted with the positions that it has in the fit.
    pub(crate) fn is_accepted(&self, key: &EventKey, accepted: &AcceptedData) -> bool {
        self.remote.get_key_value(key).is_some_and(|event| is_among(&accepted.events, event))
    }

    pub(crate) fn own_indices(&self, is_wanted: impl Fn(u64) -> bool) -> Vec<usize> {
        (0..self.sources.len()).filter(|&index| self.own_number(index).is_some_and(&is_wanted)).collect()
    }

    fn own_number(&self, index: usize) -> Option<u64> {
        match self.sources[index] {
            EventSource::Own(number) => Some(number),
            EventSource::Remote(_) => None,
        }
    }

    /// Returns the indices of the events that a new fit of these events keeps unchanged, by source.
    fn kept_indices(&self, sources: &[EventSource], accepted: &AcceptedData) -> HashMap<EventSource, usize> {
        let mut kept: HashMap<EventSource, usize> = self.sources.iter().copied().zip(0..).collect();
        let wanted: HashSet<&EventSource> = sources.iter().collect();
        kept.retain(|source, _| match source {
            EventSource::Own(_) => wanted.contains(source),
            EventSource::Remote(key) => self.is_accepted(key, accepted),
        });
        kept
    }

    /// Returns [`EventFit::changes_since_fit`] after all events but the kept ones are removed and `new` events are
    /// added.
    fn changes_after(&self, kept: &HashMap<EventSource, usize>, new: usize) -> usize {
        self.changes_since_fit + self.sources.len() - kept.len() + new
    }

    /// Returns the fit without the events that are not kept, and with new events. Sites of kept events stay as they
    /// are. `None` for a dense fit.
    fn amended(
        &self,
        kept: &HashMap<EventSource, usize>,
        new: impl Iterator<Item = EventSource>,
        observations: &Observations,
        accepted: &AcceptedData,
    ) -> dgpc::Result<Option<Self>> {
        let (stay, removed): (Vec<usize>, Vec<usize>) =
            (0..self.sources.len()).partition(|&index| kept.contains_key(&self.sources[index]));
        let Some(fit) = self.fit.amended(&removed, observations)? else { return Ok(None) };
        let sources = stay.into_iter().map(|index| self.sources[index]).chain(new).collect();
        let changes_since_fit = self.changes_after(kept, observations.len());
        // An earlier partial summary may contain a removed own event, whose site is needed to subtract it.
        let has_lost_own = removed.iter().any(|&index| matches!(self.sources[index], EventSource::Own(_)));
        let sites_id = if has_lost_own { Arc::default() } else { self.sites_id.clone() };
        Ok(Some(Self { fit, sources, changes_since_fit, remote: accepted.events.clone(), sites_id }))
    }
}

impl PartialSummary {
    pub(crate) fn posterior_with(&self, summaries: &[&Summary]) -> dgpc::Result<Posterior> {
        let prior = self.summary.prior();
        let read = summaries.iter().map(|summary| summary.read_under(prior));
        let read: Vec<_> = read.collect::<dgpc::Result<_>>()?;
        Posterior::of_summaries(prior, &read.iter().map(AsRef::as_ref).chain([&self.summary]).collect::<Vec<_>>())
    }
}

/// Returns own events and accepted remote events with their sources, in canonical order.
pub(crate) fn all_events<'a>(memory: &'a Memory, accepted: &'a AcceptedData) -> (Vec<EventSource>, Vec<&'a Event>) {
    let own = memory.counting_events().map(|recorded| (EventSource::Own(recorded.number), &recorded.event));
    let remote = accepted.events.iter().map(|(&key, event)| (EventSource::Remote(key), &**event));
    let mut all: Vec<(EventSource, &Event)> = own.chain(remote).collect();
    // The sort is stable: equal events stay in the order of their numbers.
    all.sort_by(|a, b| a.1.canonical_order(b.1));
    all.into_iter().unzip()
}

/// The start of a refit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RefitStart {
    /// Starts at the previous fit. Amends it if few events changed and it is sparse.
    Incremental,
    /// Starts at the previous fit and fits all events. It takes fewer iterations than a cold start, and the result is
    /// equal to the tolerance of a fit.
    Warm,
    /// Starts from nothing. The result does not depend on earlier fits, to the bit.
    Cold,
}

/// The previous fit, from which a new fit starts.
pub(crate) struct PreviousFit<'a> {
    pub(crate) fit: &'a EventFit,
    /// Posterior near the previous fit, which gives the initial tilts of new events.
    pub(crate) posterior: &'a Posterior,
    /// Whether the fit may be amended: it has the same messages as the new one.
    pub(crate) may_be_amended: bool,
}

/// Fits own events and accepted remote events, given the summaries in `messages`. Starts at the previous fit, if there
/// is one.
///
/// A sparse fit is amended if few events were added or removed since all events were fitted together. The cost of an
/// event then does not depend on the number of events.
pub(crate) fn fit_events(
    memory: &Memory,
    prior: &Prior,
    accepted: &AcceptedData,
    messages: &[&Summary],
    previous: Option<PreviousFit<'_>>,
) -> Result<EventFit, AgentError> {
    let team = &memory.codec.team;
    let (sources, events) = all_events(memory, accepted);
    let all = || team.model.observations(events.iter().copied());
    let complete = |fit: Fit, sources: Vec<EventSource>| {
        let (remote, sites_id) = (accepted.events.clone(), Arc::default());
        EventFit { fit, sources, changes_since_fit: 0, remote, sites_id }
    };
    let Some(PreviousFit { fit: previous, posterior, may_be_amended }) = previous else {
        return Ok(complete(fitting::fit(prior, &all()?, messages, &team.limits, None)?, sources));
    };
    let kept = previous.kept_indices(&sources, accepted);
    let new: Vec<usize> = (0..events.len()).filter(|&index| !kept.contains_key(&sources[index])).collect();
    let may_be_amended = may_be_amended && previous.fit.inducing_points().is_some();
    if may_be_amended && Limits::is_small(previous.changes_after(&kept, new.len()), previous.sources.len()) {
        let observations = team.model.observations_among(&events, &new)?;
        let new_sources = new.iter().map(|&index| sources[index]);
        if let Some(amended) = previous.amended(&kept, new_sources, &observations, accepted)? {
            return Ok(amended);
        }
    }
    let latent = posterior.latent(&team.model.inputs(new.iter().map(|&index| events[index].query()))?)?;
    let mut new_tilts =
        latent.mean.iter().zip(&latent.variance).map(|(mean, variance)| (mean * mean + variance).sqrt());
    let tilts = previous.fit.tilts();
    let tilt =
        |source: &EventSource| kept.get(source).map(|&index| tilts[index]).or_else(|| new_tilts.next()).unwrap_or(1.0);
    // The tilt is 0 where f is known to be 0, but an iteration must start above 0.
    let tilts: Vec<f64> = sources.iter().map(tilt).map(|tilt| tilt.max(TILT_MIN)).collect();
    let inducing_points = previous.fit.inducing_points().filter(|_| messages.is_empty());
    let start = WarmStart { inducing_points, tilts: &tilts, new: &new };
    Ok(complete(fitting::fit(prior, &all()?, messages, &team.limits, Some(start))?, sources))
}

#[cfg(test)]
#[path = "../../tests/unit/event_fit.rs"]
mod tests;
