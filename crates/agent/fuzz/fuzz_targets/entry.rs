//! Applies any bytes as entries of a journal. They are refused, or they are the one encoding of their entry, and the
//! vehicle that has applied them restores from its snapshot.

#![no_main]

mod team;

use libfuzzer_sys::fuzz_target;
use pingmap_agent::{Agent, AgentOptions, Entry, VehicleId};

use crate::team::TEAM;

fuzz_target!(|bytes: &[u8]| {
    let mut agent = Agent::new(VehicleId::new("a"), TEAM.clone(), AgentOptions::default());
    // Each entry follows its length.
    let mut rest = bytes;
    while let Some((&length, after)) = rest.split_first() {
        let (entry_bytes, next) = after.split_at(after.len().min(length.into()));
        rest = next;
        let Ok(entry) = Entry::from_bytes(entry_bytes) else { continue };
        assert_eq!(entry.to_bytes(), entry_bytes);
        // An entry out of bounds is an error, and a frame of another team a refusal.
        drop(agent.apply(entry));
    }
    let snapshot = agent.snapshot();
    let restored = Agent::restore(VehicleId::new("a"), TEAM.clone(), AgentOptions::default(), &snapshot);
    assert_eq!(restored.expect("its own snapshot").snapshot(), snapshot);
});
