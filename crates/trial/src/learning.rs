//! Learning a model from pooled events, additions in parallel.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use pingmap_agent::{Attempt, Chart, Event, InputSpec, LearnedModel, Learning, OptionalTerm};
use rayon::prelude::*;

/// An attempt and its duration in seconds.
type Timed = (Attempt, f64);

/// Result of learning a structure and its additions.
pub struct Added {
    /// The structure with the accepted additions.
    pub best: LearnedModel,
    /// All attempts in their order, from the structure without additions on, each with its duration in seconds.
    pub tried: Vec<Timed>,
}

/// Learns [`Learning::structure`]. Then tries [`Learning::additions`] one after the other, each in addition to those
/// accepted before ([`Learning::try_term`]). Idle threads already try later additions; these attempts are discarded if
/// an earlier addition is accepted. Results do not depend on the number of threads.
///
/// # Errors
/// Returns [`dgpc::Error`] for a position that is not finite, or a fixed parameter that is not finite and positive.
pub fn learn(learning: &Learning, chart: Chart, inputs: InputSpec, events: &[&Event]) -> dgpc::Result<Added> {
    let begin = Instant::now();
    let mut best = learning.first_attempt(chart, inputs, events, &[])?;
    let mut tried = vec![(best.clone(), begin.elapsed().as_secs_f64())];
    let mut left = learning.additions_to(events, inputs);
    loop {
        let structure = best.model.structure;
        let mut possible: Vec<OptionalTerm> =
            left.iter().copied().filter(|&addition| structure.can_have(addition)).collect();
        if possible.is_empty() {
            let best = learning.with_fading(best.model, events.iter().copied(), &[])?;
            return Ok(Added { best, tried });
        }
        if possible.first() == Some(&OptionalTerm::Range) {
            // This addition is accepted in most logs, so attempts with the others without it would be discarded.
            possible.truncate(1);
        }
        let try_term = |addition: OptionalTerm| {
            let begin = Instant::now();
            let attempt = learning.try_term(addition, &best, events, &[])?;
            Ok((attempt, begin.elapsed().as_secs_f64()))
        };
        let mut attempts = until_one_is_accepted(&possible, try_term)?;
        // The additions after an accepted one are tried again with it.
        let last = possible[attempts.len() - 1];
        left = left.into_iter().skip_while(|&addition| addition != last).skip(1).collect();
        if let Some((accepted, _)) = attempts.last().filter(|(attempt, _)| attempt.is_accepted) {
            best = accepted.clone();
        }
        tried.append(&mut attempts);
    }
}

/// Tries additions in their order, up to the first that is accepted.
fn until_one_is_accepted(
    additions: &[OptionalTerm],
    try_term: impl Fn(OptionalTerm) -> dgpc::Result<Timed> + Sync,
) -> dgpc::Result<Vec<Timed>> {
    // Index of the first addition that is accepted or fails. Later ones are discarded.
    let end = AtomicUsize::new(usize::MAX);
    let ahead = additions.iter().copied().enumerate().take_while(|&(place, _)| place < end.load(Ordering::Relaxed));
    let tried = |(place, addition)| {
        let attempt = try_term(addition);
        if attempt.as_ref().map_or(true, |(attempt, _)| attempt.is_accepted) {
            end.fetch_min(place, Ordering::Relaxed);
        }
        (place, attempt)
    };
    let mut attempts: Vec<_> = ahead.par_bridge().map(tried).collect();
    attempts.sort_by_key(|&(place, _)| place);
    attempts.truncate(end.into_inner().saturating_add(1));
    attempts.into_iter().map(|(_, attempt)| attempt).collect()
}
