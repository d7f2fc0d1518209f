//! Simulated missions as the vehicles would have recorded them, and their truth.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_trial::EventLog;

use super::{pingmap, stderr, stdout, without_command};

/// What is in both logs of one event.
type Key = (String, String, i64);

/// Events by who and when, to the nearest slot of ten seconds.
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

/// Simulates a mission with files, as the options say.
pub fn simulate(folder: &Path, options: &str) {
    let arguments = format!("simulate -o truth.csv --as-files mission --force --depths {options}");
    let output = pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>());
    assert!(output.status.success(), "{}", stderr(&output));
}

/// The files of three vehicles as options.
pub fn files(kinds: &[&str]) -> String {
    let of = |kind: &&str| {
        let file = |id| format!("auv{id}=mission/auv{id}.{kind}.csv");
        format!("--{kind} {} ", [1, 2, 3].map(file).join(" "))
    };
    kinds.iter().map(of).collect::<String>() + "--ids mission/ids.csv --origin 41.52,-70.67"
}

/// Imports with these options; what was printed, but for the command line, and warned of.
pub fn import(folder: &Path, options: &str) -> (serde_json::Value, String) {
    let arguments = format!("import {options} --json --quiet");
    let output = pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>());
    assert!(output.status.success(), "{arguments}: {}", stderr(&output));
    (serde_json::from_str(&without_command(stdout(&output))).unwrap(), stderr(&output))
}

/// Every imported event is one of the truth: same outcome, places to 1 m, times to 0.1 s. Gives how many of the truth are not there.
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

/// How many are not known for a reason.
pub fn count(value: &serde_json::Value, key: &str) -> usize {
    value["unknown"][key].as_u64().unwrap_or(0) as usize
}
