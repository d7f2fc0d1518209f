//! Choice of inducing points. The measure of the result is the remaining trace.

use dgpc::{Candidates, greedy_by_variance, greedy_judged};

use crate::data::{synthetic, truth};

fn candidates(size: usize) -> Candidates {
    Candidates::new(truth().kernel(), synthetic(size).inputs()).expect("finite places")
}

/// Chooses the best of all pairs, starting from the kernel.
pub fn best_pair(size: usize, repeats: usize) -> Box<dyn FnMut() -> f64> {
    let (prior, events) = (truth(), synthetic(size));
    Box::new(move || {
        let choose =
            |_| Candidates::new(prior.kernel(), events.inputs()).expect("finite places").minimise_trace(2).trace;
        (0..repeats).map(choose).sum::<f64>() / repeats as f64
    })
}

/// Fifty points, one after the other.
pub fn greedy() -> Box<dyn FnMut() -> f64> {
    let candidates = candidates(446);
    Box::new(move || candidates.greedy(50).trace)
}

/// Fifty points, exchanged until no swap helps.
pub fn exchange() -> Box<dyn FnMut() -> f64> {
    let candidates = candidates(446);
    Box::new(move || candidates.minimise_trace(50).trace)
}

/// Fifty of very many, judged by 2000 of them.
pub fn greedy_of_many(size: usize) -> Box<dyn FnMut() -> f64> {
    let (prior, events) = (truth(), synthetic(size));
    Box::new(move || greedy_judged(prior.kernel(), events.inputs(), 50, 2000).expect("finite places").trace)
}

/// Fifty of ten thousand by the cheap rule.
pub fn greedy_by_variance_of_many() -> Box<dyn FnMut() -> f64> {
    let (prior, events) = (truth(), synthetic(10_000));
    Box::new(move || greedy_by_variance(prior.kernel(), events.inputs(), 50).expect("finite places").trace)
}
