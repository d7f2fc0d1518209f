//! Interrupts: they stop the computations of a thread, and leave the vehicle as it was.

use std::sync::Arc;
use std::thread;

use crate::common::*;
use pingmap_agent::*;

/// Computes on another thread, to which an interrupt is attached that is requested already.
fn interrupted<T: Send>(compute: impl FnOnce() -> T + Send) -> T {
    let interrupt = Interrupt::default();
    interrupt.request();
    thread::scope(|scope| {
        let computing = scope.spawn(move || {
            interrupt.attach();
            compute()
        });
        computing.join().unwrap()
    })
}

#[test]
fn fits_learning_and_predictions_stop_on_request_and_can_be_repeated() {
    const STOPPED: Result<(), AgentError> = Err(AgentError::Method(dgpc::Error::Stopped));
    let team = Arc::new(team(2, model()));
    let expected = rebuilt_probabilities(&mut vehicle(&team, 0, walk(0, 60, 0.3)));
    let mut agent = Agent::new(name(0), team, AgentOptions::default());
    agent.record(walk(0, 60, 0.3)).unwrap();
    assert_eq!(interrupted(|| agent.refit()), STOPPED);
    assert_eq!(interrupted(|| agent.rebuild()), STOPPED);
    assert_eq!(interrupted(|| agent.adapt(&Learning::default()).map(drop)), STOPPED);
    let query = link([0.0, 0.0, 100.0, 0.0]);
    assert_eq!(interrupted(|| agent.predict([query], Which::Fused).map(drop)), STOPPED);
    // Expectation propagation begins after the posteriors are current.
    agent.refit().unwrap();
    agent.predict([query], Which::Fused).unwrap();
    assert_eq!(interrupted(|| agent.predict_intervals([query]).map(drop)), STOPPED);
    assert_eq!(bits(&rebuilt_probabilities(&mut agent)), bits(&expected));
}
