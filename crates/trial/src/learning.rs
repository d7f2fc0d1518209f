//! Learning a model from pooled events, additions in parallel.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use pingmap_agent::{Chart, Event, InputSpec, LearnedModel, Learning, OptionalTerm};
use rayon::prelude::*;

/// A fit and its duration in seconds.
type Timed = (LearnedModel, f64);

/// Result of learning a structure and its additions.
pub struct Added {
    /// The structure with the accepted additions.
    pub best: LearnedModel,
    /// All fits in the order of trial, from the structure without additions on, each with its duration in seconds.
    pub tried: Vec<Timed>,
}

/// Learns [`Learning::structure`]. Then tries [`Learning::additions`] one after the other, each starting from the
/// optimum before, and accepts an addition if the fit improves ([`LearnedModel::improves_on`]). Idle threads already
/// try later additions; these fits are discarded if an earlier addition is accepted. Results do not depend on the
/// number of threads.
///
/// # Errors
/// Returns [`dgpc::Error`] for a position that is not finite, or a fixed parameter that is not finite and positive.
pub fn learn(learning: &Learning, chart: Chart, inputs: InputSpec, events: &[&Event]) -> dgpc::Result<Added> {
    let begin = Instant::now();
    let first = learning.fit(&learning.structure, chart, inputs, events.iter().copied(), &[], None)?;
    let mut added = Added { best: first.clone(), tried: vec![(first, begin.elapsed().as_secs_f64())] };
    let mut left = learning.additions_to(events, inputs);
    loop {
        let structure = added.best.structure;
        let mut possible: Vec<OptionalTerm> =
            left.iter().copied().filter(|&addition| structure.can_have(addition)).collect();
        if possible.is_empty() {
            added.best = learning.with_fading(added.best, events.iter().copied(), &[])?;
            return Ok(added);
        }
        if possible.first() == Some(&OptionalTerm::Range) {
            // This addition is accepted in most logs, so fits of the others without it would be discarded.
            possible.truncate(1);
        }
        let fit = |addition: OptionalTerm| {
            let begin = Instant::now();
            let structure = structure.with(addition);
            let fit = learning.fit(&structure, chart, inputs, events.iter().copied(), &[], Some(&added.best))?;
            Ok((fit, begin.elapsed().as_secs_f64()))
        };
        let (mut fits, taken) = until_one_is_taken(&possible, &added.best, fit)?;
        // The additions after an accepted one are tried again with it.
        let last = possible[fits.len() - 1];
        left = left.into_iter().skip_while(|&addition| addition != last).skip(1).collect();
        if let (true, Some((best, _))) = (taken, fits.last()) {
            added.best = best.clone();
        }
        added.tried.append(&mut fits);
    }
}

/// Fits additions in their order, up to the first that improves on `before`. Also returns whether there is one.
fn until_one_is_taken(
    additions: &[OptionalTerm],
    before: &LearnedModel,
    fit: impl Fn(OptionalTerm) -> dgpc::Result<Timed> + Sync,
) -> dgpc::Result<(Vec<Timed>, bool)> {
    // Index of the first addition that is accepted or fails. Later ones are discarded.
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
