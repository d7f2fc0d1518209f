//! Search of optional terms: the result does not depend on the number of threads.

use std::path::Path;

use pingmap_agent::*;
use pingmap_trial::{EventLog, learn};

/// Returns the structures tried, in order, with the bits of their learned parameters. The last entry is the best
/// structure.
fn tried(log: &EventLog, threads: usize) -> Vec<(Structure, Vec<u64>)> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let learning = Learning::default();
    let events: Vec<&Event> = log.events.iter().collect();
    let (chart, inputs) = (log.chart(), log.inputs());
    let added = pool.install(|| learn(&learning, chart, inputs, &events).unwrap());
    let numbers =
        |fit: &LearnedModel| fit.model.prior.parameter_values().iter().map(|number| number.to_bits()).collect();
    assert!(added.tried.iter().any(|(attempt, _)| attempt.is_screened_out));
    let tried = added.tried.iter().map(|(attempt, _)| &attempt.model);
    tried.chain([&added.best]).map(|fit| (fit.structure, numbers(fit))).collect()
}

#[test]
fn the_search_of_optional_terms_does_not_depend_on_the_number_of_threads() {
    let log = EventLog::open(&Path::new(env!("CARGO_MANIFEST_DIR")).join("data/bay3.csv")).unwrap();
    let alone = tried(&log, 1);
    let (best, all) = alone.split_last().unwrap();
    // The search accepts at least one term before the last, and rejects the last.
    let is_taken = |(structure, _): &&(Structure, Vec<u64>)| {
        structure.additions.iter().all(|addition| best.0.additions.has(addition))
    };
    let taken = all.iter().filter(is_taken).count();
    assert!(taken > 0 && taken < all.len() && !is_taken(&all.last().unwrap()), "{taken} of {all:?}");
    assert_eq!(tried(&log, 2), alone);
}
