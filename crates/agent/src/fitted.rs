//! Fits of a vehicle's own events and of those that it was told.

use std::collections::HashMap;
use std::sync::Arc;

use dgpc::{Candidates, DISTINCT_SHARE, Fit, Inputs, Posterior, Prior, Summary};

use crate::agent_error::AgentError;
use crate::event::Event;
use crate::fitting::{self, Begin};
use crate::frames::ToldKey;
use crate::heard::{Heard, summaries};
use crate::memory::Memory;
use crate::model::Model;
use crate::packets::Packet;
use crate::placing::ToldEvents;

/// The smallest tilt that a warm fit begins at.
const TILT_MIN: f64 = 1e-9;

/// Where an event is known from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) enum Source {
    /// One of its own, by number.
    Own(u64),
    /// Told.
    Told(ToldKey),
}

/// A fit, and which events it is of, in its order.
#[derive(Debug)]
pub(crate) struct Fitted {
    pub(crate) fit: Fit,
    pub(crate) sources: Vec<Source>,
    /// The told events among them, as they were placed.
    pub(crate) told: Arc<ToldEvents>,
}

/// The least that packets must say beyond reports, as a share of what they say: less is rounding, by which information may be off
/// by a fifth.
const BEYOND_SHARE: f64 = 0.25;

impl Fitted {
    /// What packets say beyond told events of this fit that they may speak of, too; all that they say where it has none of them.
    /// `place` is known before either.
    pub(crate) fn beyond(
        &self,
        is_told: impl Fn(&Source) -> bool,
        place: &[&Summary],
        packets: &[Arc<Packet>],
    ) -> dgpc::Result<Vec<Summary>> {
        let said = summaries(packets);
        if said.is_empty() || !self.sources.iter().any(&is_told) {
            return Ok(said.into_iter().cloned().collect());
        }
        let prior = self.fit.prior();
        let known = self.posterior_of(is_told, place)?;
        let said: Vec<_> = [place, &said]
            .concat()
            .into_iter()
            .map(|summary| summary.read_under(prior))
            .collect::<dgpc::Result<_>>()?;
        let mut points = Inputs::empty(self.fit.sites().inputs().dimension());
        summaries(packets).into_iter().try_for_each(|summary| points.append(summary.inducing_points()))?;
        let distinct = Candidates::new(prior.kernel(), &points)?.distinct(DISTINCT_SHARE);
        let points = points.select(&distinct);
        let said = Posterior::of_summaries(prior, &said.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
        Ok(vec![said.summarise(&points)?.beyond(&known.summarise(&points)?, BEYOND_SHARE)?])
    }

    /// The posterior of those events whose source is wanted, and of these summaries.
    pub(crate) fn posterior_of(
        &self,
        is_wanted: impl Fn(&Source) -> bool,
        summaries: &[&Summary],
    ) -> dgpc::Result<Posterior> {
        let part: Vec<usize> = (0..self.sources.len()).filter(|&place| is_wanted(&self.sources[place])).collect();
        match part.len() == self.sources.len() {
            true => self.fit.posterior_with(summaries),
            false => self.fit.posterior_of_part(&part, summaries),
        }
    }
}

/// The vehicle's own events and those that were told, in canonical order.
pub(crate) fn all_events<'a>(memory: &'a Memory, told: &'a Heard) -> (Vec<Source>, Vec<&'a Event>) {
    let own = memory.sent_events().map(|known| (Source::Own(known.number), &known.event));
    let told = told.told.iter().map(|(&key, event)| (Source::Told(key), &**event));
    let mut all: Vec<(Source, &Event)> = own.chain(told).collect();
    // Stable: equal events stay in the order of their numbers.
    all.sort_by(|a, b| a.1.canonical_order(b.1));
    all.into_iter().unzip()
}

/// Fits the vehicle's own events and those that were told, given what packets say; begins at the last fit, if it is given, and
/// at what the posterior near it says of events that were not in it.
pub(crate) fn fit_events(
    memory: &Memory,
    prior: &Prior,
    told: &Heard,
    messages: &[&Summary],
    last: Option<(&Fitted, &Posterior)>,
) -> Result<Fitted, AgentError> {
    let team = &memory.frames.team;
    let (sources, events) = all_events(memory, told);
    let observations = team.model.observations(events.iter().copied())?;
    let begin = last.map(|(last, near)| tilts(&team.model, &sources, &events, last, near)).transpose()?;
    let begin = last.zip(begin.as_ref()).map(|((last, _), (tilts, new))| Begin {
        inducing_points: last.fit.inducing_points().filter(|_| messages.is_empty()),
        tilts,
        new,
    });
    let fit = fitting::fit(prior, &observations, messages, &team.limits, begin)?;
    Ok(Fitted { fit, sources, told: told.told.clone() })
}

/// Tilts to begin with: those of the last fit and, of events that were not in it, what the posterior near it says; and which
/// events these are.
fn tilts(
    model: &Model,
    sources: &[Source],
    events: &[&Event],
    last: &Fitted,
    near: &Posterior,
) -> dgpc::Result<(Vec<f64>, Vec<usize>)> {
    let known: HashMap<Source, f64> = last.sources.iter().copied().zip(last.fit.tilts().iter().copied()).collect();
    let new: Vec<usize> = (0..events.len()).filter(|&place| !known.contains_key(&sources[place])).collect();
    let latent = near.latent(&model.inputs(new.iter().map(|&place| events[place].attempt()))?)?;
    let mut tilts = latent.mean.iter().zip(&latent.variance).map(|(mean, variance)| (mean * mean + variance).sqrt());
    let tilt = |source: &Source| known.get(source).copied().or_else(|| tilts.next()).unwrap_or(1.0);
    // Where f is known to be 0 the tilt is 0, but an iteration begins above.
    Ok((sources.iter().map(tilt).map(|tilt| tilt.max(TILT_MIN)).collect(), new))
}
