//! Fits of a vehicle's own events and of those that it was told.

use std::collections::{BTreeSet, HashMap, HashSet};
use std::sync::Arc;

use dgpc::{Candidates, DISTINCT_SHARE, Fit, Inputs, Observations, Posterior, Prior, Summary};

use crate::agent_error::AgentError;
use crate::event::Event;
use crate::fitting::{self, Begin};
use crate::frames::ToldKey;
use crate::heard::{Heard, summaries};
use crate::limits::Limits;
use crate::memory::Memory;
use crate::packets::Packet;
use crate::placing::{ToldEvents, is_among};

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
    /// How many went and came since these were fitted together.
    amended: usize,
    /// The told events among them, as they were placed.
    pub(crate) told: Arc<ToldEvents>,
    /// The same thing for all fits in which its own events that are in both have the same sites.
    origin: Arc<()>,
}

/// What some of the vehicle's own events of a sparse fit say together.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    numbers: BTreeSet<u64>,
    said: Summary,
    /// Of the fit.
    origin: Arc<()>,
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

    /// What those of its own events say that have these numbers, found from what nearly the same ones said `before`: from frame to frame
    /// a few more were told. `None` of a dense fit. O(M²) for each that is in one of both alone, or as [`Fit::summary_of_part`].
    pub(crate) fn part(&self, numbers: &BTreeSet<u64>, before: Option<&Part>) -> dgpc::Result<Option<Part>> {
        let wanted = self.own_places(|number| numbers.contains(&number));
        let numbers: BTreeSet<u64> = wanted.iter().filter_map(|&place| self.own_number(place)).collect();
        let origin = self.origin.clone();
        if let Some(before) = before.filter(|before| Arc::ptr_eq(&before.origin, &origin)) {
            let new = self.own_places(|number| numbers.contains(&number) && !before.numbers.contains(&number));
            let gone = self.own_places(|number| before.numbers.contains(&number) && !numbers.contains(&number));
            if new.len() + gone.len() < wanted.len() {
                let mut said = before.said.clone();
                said.forget(&self.fit.sites().select(&gone))?;
                said.observe(&self.fit.sites().select(&new))?;
                return Ok(Some(Part { numbers, said, origin }));
            }
        }
        Ok(self.fit.summary_of_part(&wanted)?.map(|said| Part { numbers, said, origin }))
    }

    /// Where those of its own events stand whose numbers are wanted.
    pub(crate) fn own_places(&self, is_wanted: impl Fn(u64) -> bool) -> Vec<usize> {
        (0..self.sources.len()).filter(|&place| self.own_number(place).is_some_and(&is_wanted)).collect()
    }

    fn own_number(&self, place: usize) -> Option<u64> {
        match self.sources[place] {
            Source::Own(number) => Some(number),
            Source::Told(_) => None,
        }
    }

    /// Which of these events it has, as they are, and where.
    fn kept(&self, sources: &[Source], told: &Heard) -> HashMap<Source, usize> {
        let mut kept: HashMap<Source, usize> = self.sources.iter().copied().zip(0..).collect();
        let wanted: HashSet<&Source> = sources.iter().collect();
        kept.retain(|source, _| match source {
            Source::Own(_) => wanted.contains(source),
            Source::Told(key) => self.told.get_key_value(key).is_some_and(|one| is_among(&told.told, one)),
        });
        kept
    }

    /// How many would have gone and come since these were fitted together, without what is not kept and with new events.
    fn amended_by(&self, kept: &HashMap<Source, usize>, new: usize) -> usize {
        self.amended + self.sources.len() - kept.len() + new
    }

    /// The same without what is not kept, and with new events; `None` where it is dense.
    fn with(
        &self,
        kept: &HashMap<Source, usize>,
        new: impl Iterator<Item = Source>,
        observations: &Observations,
        told: &Heard,
    ) -> dgpc::Result<Option<Self>> {
        let (stay, gone): (Vec<usize>, Vec<usize>) =
            (0..self.sources.len()).partition(|&at| kept.contains_key(&self.sources[at]));
        let Some(fit) = self.fit.amended(&gone, observations)? else { return Ok(None) };
        let sources = stay.into_iter().map(|at| self.sources[at]).chain(new).collect();
        let amended = self.amended_by(kept, observations.len());
        // Of an event that went nobody could take out what it said.
        let has_lost_own = gone.iter().any(|&at| matches!(self.sources[at], Source::Own(_)));
        let origin = if has_lost_own { Arc::default() } else { self.origin.clone() };
        Ok(Some(Self { fit, sources, amended, told: told.told.clone(), origin }))
    }
}

impl Part {
    /// The posterior of these events and of these summaries.
    pub(crate) fn posterior_with(&self, summaries: &[&Summary]) -> dgpc::Result<Posterior> {
        let prior = self.said.prior();
        let read = summaries.iter().map(|summary| summary.read_under(prior));
        let read: Vec<_> = read.collect::<dgpc::Result<_>>()?;
        Posterior::of_summaries(prior, &read.iter().map(AsRef::as_ref).chain([&self.said]).collect::<Vec<_>>())
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

/// Where a fit begins: at the last one, and at what the posterior near it says of events that were not in it.
pub(crate) struct Last<'a> {
    pub(crate) fitted: &'a Fitted,
    pub(crate) near: &'a Posterior,
    /// Whether it may be amended: it was given the same messages.
    pub(crate) may_be_amended: bool,
}

/// Fits the vehicle's own events and those that were told, given what packets say; begins at the last fit, if it is given. Where
/// what went and came since events were fitted together is a small share of them, a sparse fit is amended: so an event costs the
/// same however many there were.
pub(crate) fn fit_events(
    memory: &Memory,
    prior: &Prior,
    told: &Heard,
    messages: &[&Summary],
    last: Option<Last<'_>>,
) -> Result<Fitted, AgentError> {
    let team = &memory.frames.team;
    let (sources, events) = all_events(memory, told);
    let all = || team.model.observations(events.iter().copied());
    let Some(Last { fitted: last, near, may_be_amended }) = last else {
        let fit = fitting::fit(prior, &all()?, messages, &team.limits, None)?;
        return Ok(Fitted { fit, sources, amended: 0, told: told.told.clone(), origin: Arc::default() });
    };
    let kept = last.kept(&sources, told);
    let new: Vec<usize> = (0..events.len()).filter(|&place| !kept.contains_key(&sources[place])).collect();
    let may_be_amended = may_be_amended && last.fit.inducing_points().is_some();
    if may_be_amended && Limits::is_small(last.amended_by(&kept, new.len()), last.sources.len()) {
        let observations = team.model.observations_among(&events, &new)?;
        if let Some(amended) = last.with(&kept, new.iter().map(|&place| sources[place]), &observations, told)? {
            return Ok(amended);
        }
    }
    let near = near.latent(&team.model.inputs(new.iter().map(|&place| events[place].attempt()))?)?;
    let mut near = near.mean.iter().zip(&near.variance).map(|(mean, variance)| (mean * mean + variance).sqrt());
    let tilts = last.fit.tilts();
    let tilt = |source: &Source| kept.get(source).map(|&place| tilts[place]).or_else(|| near.next()).unwrap_or(1.0);
    // Where f is known to be 0 the tilt is 0, but an iteration begins above.
    let tilts: Vec<f64> = sources.iter().map(tilt).map(|tilt| tilt.max(TILT_MIN)).collect();
    let inducing_points = last.fit.inducing_points().filter(|_| messages.is_empty());
    let begin = Begin { inducing_points, tilts: &tilts, new: &new };
    let fit = fitting::fit(prior, &all()?, messages, &team.limits, Some(begin))?;
    Ok(Fitted { fit, sources, amended: 0, told: told.told.clone(), origin: Arc::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use dgpc::{FitOptions, Kernel, PriorMean, Shape, Term};

    fn observations(x: impl Iterator<Item = f64>) -> Observations {
        let rows: Vec<[f64; 1]> = x.map(|x| [x]).collect();
        let outcomes = rows.iter().map(|[x]| x.sin() > 0.3).collect();
        Observations::new(Inputs::from_rows(&rows).unwrap(), outcomes).unwrap()
    }

    /// A sparse fit of forty events, of which every other one is its own.
    fn fitted() -> Fitted {
        let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 4.0, 1.0, 1).unwrap()]).unwrap();
        let prior = Prior::new(kernel, PriorMean::Zero).unwrap();
        let points = observations((0..8).map(f64::from)).inputs().clone();
        let options = FitOptions::default().inducing_points(&points);
        let fit = dgpc::fit(&prior, &observations((0..40).map(|n| 0.2 * f64::from(n))), &options).unwrap();
        let source = |n: u32| if n.is_multiple_of(2) { Source::Own(n.into()) } else { Source::Told((1, n)) };
        let (sources, origin) = ((0..40).map(source).collect(), Arc::default());
        Fitted { fit, sources, amended: 0, told: Arc::default(), origin }
    }

    #[test]
    fn a_part_is_the_same_whatever_it_is_found_from() {
        let numbers = |range: std::ops::Range<u64>| range.collect::<BTreeSet<u64>>();
        let latent = |part: &Part| {
            let somewhere = observations((0..9).map(f64::from)).inputs().clone();
            part.posterior_with(&[]).unwrap().latent(&somewhere).unwrap()
        };
        let is_as_anew = |fitted: &Fitted, wanted: std::ops::Range<u64>, before: &Part| {
            let wanted = numbers(wanted);
            let found = [Some(before), None].map(|before| latent(&fitted.part(&wanted, before).unwrap().unwrap()));
            let pairs =
                |of: fn(&dgpc::Latent) -> &[f64]| of(&found[0]).iter().zip(of(&found[1])).map(|(a, b)| (a - b).abs());
            pairs(|latent| &latent.mean).chain(pairs(|latent| &latent.variance)).all(|off| off < 1e-8)
        };
        let fitted = fitted();
        // Two of these numbers are of no event of the fit yet.
        let before = fitted.part(&numbers(4..44), None).unwrap().unwrap();
        assert!(is_as_anew(&fitted, 10..38, &before));
        for gone in [Source::Told((1, 7)), Source::Own(8)] {
            let mut kept: HashMap<Source, usize> = fitted.sources.iter().copied().zip(0..).collect();
            kept.remove(&gone);
            let new = [40, 42].map(Source::Own);
            let more = observations([3.3, 5.1].into_iter());
            let after = fitted.with(&kept, new.into_iter(), &more, &Heard::default()).unwrap().unwrap();
            assert_eq!(after.sources.len(), 41);
            assert!(is_as_anew(&after, 4..44, &before), "{gone:?}");
            assert!(is_as_anew(&after, 0..41, &before), "{gone:?}");
        }
    }
}
