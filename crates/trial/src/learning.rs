//! Learning a model from pooled events, structures in parallel.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use pingmap_agent::{Chart, Event, InputSpec, LearnedModel, Learning, OptionalTerm};
use rayon::prelude::*;

/// A fit, and the seconds it took.
type Timed = (LearnedModel, f64);

/// Learns every structure of `learning` on the current thread pool. Fits in the order of the structures, each with the
/// seconds it took; `step` is called after each.
///
/// # Errors
/// [`dgpc::Error`] for a position that is not finite, or a given number that is not finite and positive.
pub fn learn_all(
    learning: &Learning,
    chart: Chart,
    inputs: InputSpec,
    events: &[&Event],
    step: &(dyn Fn() + Sync),
) -> dgpc::Result<Vec<Timed>> {
    let fit = |structure| {
        let begin = Instant::now();
        let fit = learning.fit(structure, chart, inputs, events.iter().copied(), &[], None)?;
        step();
        Ok((fit, begin.elapsed().as_secs_f64()))
    };
    learning.structures.par_iter().map(fit).collect()
}

/// The best of [`learn_all`].
///
/// # Errors
/// As [`learn_all`]; [`dgpc::Error::OutOfRange`] without structures.
pub fn learn_best(
    learning: &Learning,
    chart: Chart,
    inputs: InputSpec,
    events: &[&Event],
) -> dgpc::Result<LearnedModel> {
    let fits = learn_all(learning, chart, inputs, events, &|| ())?;
    let chosen = learning.choose(fits.into_iter().map(|(fit, _)| fit).collect())?;
    Ok(learn_additions(learning, chosen, chart, inputs, events)?.best)
}

/// What additions came to.
pub struct Added {
    /// The chosen structure with the additions that are worth it.
    pub best: LearnedModel,
    /// Everything that was tried, in order, each with the seconds it took.
    pub tried: Vec<Timed>,
}

/// Tries [`Learning::additions`] one after the other beside a chosen structure, each beginning at the optimum before, and
/// takes those that are worth it ([`LearnedModel::improves_on`]). A thread that is free goes on to the next one before it is known what
/// becomes of those that others are at; what comes of it does not depend on that.
///
/// # Errors
/// As [`learn_all`].
pub fn learn_additions(
    learning: &Learning,
    chosen: LearnedModel,
    chart: Chart,
    inputs: InputSpec,
    events: &[&Event],
) -> dgpc::Result<Added> {
    let mut added = Added { best: chosen, tried: Vec::new() };
    let mut left = learning.additions_to(events);
    loop {
        let structure = added.best.structure;
        let mut possible: Vec<OptionalTerm> =
            left.iter().copied().filter(|&addition| structure.can_have(addition)).collect();
        if possible.is_empty() {
            added.best = learning.with_fading(added.best, events.iter().copied(), &[])?;
            return Ok(added);
        }
        if possible.first() == Some(&OptionalTerm::Range) {
            // It is mostly taken, so that whatever is tried beside it would be thrown away.
            possible.truncate(1);
        }
        let fit = |addition: OptionalTerm| {
            let begin = Instant::now();
            let structure = structure.with(addition);
            let fit = learning.fit(&structure, chart, inputs, events.iter().copied(), &[], Some(&added.best))?;
            Ok((fit, begin.elapsed().as_secs_f64()))
        };
        let (mut fits, taken) = until_one_is_taken(&possible, &added.best, fit)?;
        // Those behind one that is taken are tried with it.
        let last = possible[fits.len() - 1];
        left = left.into_iter().skip_while(|&addition| addition != last).skip(1).collect();
        if let (true, Some((best, _))) = (taken, fits.last()) {
            added.best = best.clone();
        }
        added.tried.append(&mut fits);
    }
}

/// Fits of additions in their order, up to the first that is worth it beside `before`; and whether there is one.
fn until_one_is_taken(
    additions: &[OptionalTerm],
    before: &LearnedModel,
    fit: impl Fn(OptionalTerm) -> dgpc::Result<Timed> + Sync,
) -> dgpc::Result<(Vec<Timed>, bool)> {
    // The first that is taken or fails: those behind it do not count.
    let end = AtomicUsize::new(usize::MAX);
    let ahead = additions.iter().copied().enumerate().take_while(|&(place, _)| place < end.load(Ordering::Relaxed));
    let fitted = |(place, addition)| {
        let fit = fit(addition);
        if fit.as_ref().map_or(true, |(fit, _)| fit.improves_on(addition, before)) {
            end.fetch_min(place, Ordering::Relaxed);
        }
        (place, fit)
    };
    let mut fits: Vec<_> = ahead.par_bridge().map(fitted).collect();
    fits.sort_by_key(|&(place, _)| place);
    let end = end.into_inner();
    fits.truncate(end.saturating_add(1));
    let fits = fits.into_iter().map(|(_, fit)| fit).collect::<dgpc::Result<_>>()?;
    Ok((fits, end < additions.len()))
}
