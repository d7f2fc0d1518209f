//! Long experiments stop on request.

use dgpc::Error;
use pingmap_agent::Interrupt;
use pingmap_trial::built_in;
use pingmap_trial::paper::{DataSet, Experiment};

#[test]
fn a_requested_interrupt_stops_the_experiment() {
    let set = DataSet::new("bay3", built_in("bay3").unwrap().unwrap()).unwrap();
    let experiment = Experiment::new(vec![set], 3, 7).unwrap();
    let interrupt = Interrupt::default();
    let on_thread = interrupt.clone();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).start_handler(move |_| on_thread.attach());
    // The request comes after the first permutation.
    let outcome = pool.build().unwrap().install(|| experiment.at_radius(0.4, &|| interrupt.request()));
    assert_eq!(outcome.unwrap_err(), Error::Stopped);
}
