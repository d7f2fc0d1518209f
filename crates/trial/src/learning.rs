//! Learning a model from pooled events, structures in parallel.

use std::time::Instant;

use pingmap_agent::{Addition, Chart, Event, InputSpec, LearnedModel, Learning};
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
    let chosen = learning.choose(fits.into_iter().map(|(fit, _)| fit).collect())?;
    Ok(learn_additions(learning, chosen, chart, inputs, events)?.best)
}

/// What additions came to.
pub struct Added {
    /// The chosen structure with the additions that are worth it.
    pub best: LearnedModel,
    /// Everything that was tried, in order, each with the seconds it took.
    pub tried: Vec<(LearnedModel, f64)>,
}

/// Tries [`Learning::additions`] one after the other beside a chosen structure, each beginning at the optimum before, and
/// takes those that are worth it ([`LearnedModel::is_worth_it`]). As many at a time as there are threads; what comes of it
/// does not depend on that.
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
        let out = left.iter().take_while(|&&addition| !structure.can_have(addition)).count();
        left.drain(..out);
        let together = left.iter().take_while(|&&addition| structure.can_have(addition));
        let together: Vec<Addition> = together.take(rayon::current_num_threads()).copied().collect();
        if together.is_empty() {
            added.best = learning.with_fading(added.best, events.iter().copied(), &[])?;
            return Ok(added);
        }
        let fit = |&addition: &Addition| {
            let begin = Instant::now();
            let structure = structure.with(addition);
            let fit = learning.fit(&structure, chart, inputs, events.iter().copied(), &[], Some(&added.best))?;
            Ok((fit, begin.elapsed().as_secs_f64()))
        };
        let mut fits = together.par_iter().map(fit).collect::<dgpc::Result<Vec<(LearnedModel, f64)>>>()?;
        let mut pairs = fits.iter().zip(&together);
        let taken = pairs.position(|((fit, _), &addition)| fit.is_worth_it(addition, &added.best));
        // Those behind one that is taken are tried again with it.
        fits.truncate(taken.map_or(fits.len(), |place| place + 1));
        left.drain(..fits.len());
        if let (Some(_), Some((fit, _))) = (taken, fits.last()) {
            added.best = fit.clone();
        }
        added.tried.append(&mut fits);
    }
}
