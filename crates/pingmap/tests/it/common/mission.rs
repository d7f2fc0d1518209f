//! Records of simulated missions, and the true missions.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_trial::EventLog;

use super::{pingmap, stderr, stdout, without_command};

/// Identifies an event in both logs: transmitter, receiver and slot.
type Key = (String, String, i64);

/// Returns the events by their keys, with slots of ten seconds.
fn by_slot(log: &EventLog) -> BTreeMap<Key, &pingmap_agent::Event> {
    let key = |event: &pingmap_agent::Event| {
        let slot = (event.time_s / 10.0).round() as i64;
        (event.transmitter_id.to_string(), event.receiver_id.to_string(), slot)
    };
    let events: BTreeMap<Key, &pingmap_agent::Event> = log.events.iter().map(|event| (key(event), event)).collect();
    assert_eq!(events.len(), log.events.len(), "an event for each slot and receiver");
    events
}

pub fn read(folder: &Path, name: &str) -> EventLog {
    EventLog::open(&folder.join(name)).unwrap()
}

/// Simulates a mission with files and these options.
pub fn simulate(folder: &Path, options: &str) {
    let arguments = format!("simulate -o truth.csv --as-files mission --overwrite --depths {options}");
    let output = pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>());
    assert!(output.status.success(), "{}", stderr(&output));
}

/// Returns the options for the files of three vehicles.
pub fn files(kinds: &[&str]) -> String {
    let of = |kind: &&str| {
        let file = |id| format!("auv{id}=mission/auv{id}.{kind}.csv");
        format!("--{kind} {} ", [1, 2, 3].map(file).join(" "))
    };
    kinds.iter().map(of).collect::<String>() + "--ids mission/ids.csv --origin 41.52,-70.67"
}

/// Imports with these options, and returns the JSON object without its command line, and the warnings.
pub fn import(folder: &Path, options: &str) -> (serde_json::Value, String) {
    let arguments = format!("import {options} --json --quiet --overwrite");
    let output = pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>());
    assert!(output.status.success(), "{arguments}: {}", stderr(&output));
    (serde_json::from_str(&without_command(stdout(&output))).unwrap(), stderr(&output))
}

/// Asserts that every imported event is a true event: same outcome, positions to 1 m, times to 0.1 s. Returns the
/// number of true events that are missing.
pub fn compare(folder: &Path) -> usize {
    let (truth, found) = (read(folder, "truth.csv"), read(folder, "events.csv"));
    assert!(found.has_depths);
    let (truth, found) = (by_slot(&truth), by_slot(&found));
    for (key, event) in &found {
        let true_event = truth.get(key).unwrap_or_else(|| panic!("{key:?} did not take place"));
        assert_eq!(event.success, true_event.success, "{key:?}");
        assert!((event.time_s - true_event.time_s).abs() < 0.1, "{key:?}: {} {}", event.time_s, true_event.time_s);
        for (found, truth) in event.link.ends().iter().zip(true_event.link.ends()) {
            let off_m = (found.east_m - truth.east_m).hypot(found.north_m - truth.north_m);
            assert!(off_m < 1.0, "{key:?}: {found:?} {truth:?}");
            assert!((found.depth_m.unwrap() - truth.depth_m.unwrap()).abs() < 1.0);
        }
    }
    truth.len() - found.len()
}

/// Returns the number of events that are excluded for this reason.
pub fn count(value: &serde_json::Value, key: &str) -> usize {
    value["excluded"][key].as_u64().unwrap_or(0) as usize
}
