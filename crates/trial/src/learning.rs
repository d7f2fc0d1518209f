//! Learning a model from pooled events, structures in parallel.

use std::time::Instant;

use pingmap_agent::{Chart, Event, InputSpec, LearnedModel, Learning};
use rayon::prelude::*;

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
) -> dgpc::Result<Vec<(LearnedModel, f64)>> {
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
    learning.choose(fits.into_iter().map(|(fit, _)| fit).collect())
}
