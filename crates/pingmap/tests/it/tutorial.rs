//! The tutorial: its commands run on the example files, and the result matches the true mission.

use std::path::Path;

use crate::common::*;
use pingmap_trial::EventLog;

#[test]
fn the_commands_of_the_tutorial_recover_the_true_mission() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let text = std::fs::read_to_string(root.join("docs/tutorial.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for entry in std::fs::read_dir(root.join("examples/mission")).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
    }
    let commands: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("    pingmap ")).collect();
    assert!(commands.len() >= 6, "{commands:?}");
    let mut message = Vec::new();
    for command in &commands {
        let output = pingmap(folder, &command.split_whitespace().collect::<Vec<_>>());
        assert!(output.status.success(), "{command}: {}", stderr(&output));
        message.push((stderr(&output), stdout(&output)));
    }
    // The first import names an option for each of three unknowns. The second import resolves two of them.
    for option in ["--always-transmits", "--correct-clocks", "--listening auv3"] {
        assert!(message[0].0.contains(option), "{option}: {}", message[0].0);
    }
    assert!(
        !message[1].0.contains("--always-transmits") && !message[1].0.contains("--correct-clocks"),
        "{}",
        message[1].0
    );
    assert!(
        message[1].1.contains("--origin 41.53,-70.66") && text.contains("--origin 41.53,-70.66"),
        "{}",
        message[1].1
    );
    assert!(message[2].1.contains("Nothing suspicious"), "{}", message[2].1);
    for file in ["map.png", "doubt.png", "map.geojson", "model.toml", "standoff.png", "track.png"] {
        assert!(folder.join(file).exists(), "{file}");
    }
    assert_true_mission(folder, &root);
}

/// Compares the log of the tutorial with the true mission, simulated by the command in `examples/README.md`.
fn assert_true_mission(folder: &Path, root: &Path) {
    let page = std::fs::read_to_string(root.join("examples/README.md")).unwrap();
    let simulate = page.lines().find_map(|line| line.strip_prefix("    pingmap ")).unwrap();
    let simulate = simulate.replace("examples/mission", "again");
    assert!(pingmap(folder, &simulate.split_whitespace().collect::<Vec<_>>()).status.success());
    let again = std::fs::read_to_string(folder.join("again/auv2.heard.csv")).unwrap();
    assert_eq!(
        again,
        std::fs::read_to_string(root.join("examples/mission/auv2.heard.csv")).unwrap(),
        "the page states how"
    );
    let [truth, found] = ["trial.csv", "events.csv"].map(|name| EventLog::open(&folder.join(name)).unwrap());
    assert!(found.events.len() > 300, "{}", found.events.len());
    for event in &found.events {
        let is_it = |other: &&pingmap_agent::Event| {
            other.receiver_id == event.receiver_id && (other.time_s - event.time_s).abs() < 0.1
        };
        let true_event = truth.events.iter().find(is_it).unwrap_or_else(|| panic!("{event:?} did not take place"));
        assert_eq!(
            (&event.transmitter_id, event.success),
            (&true_event.transmitter_id, true_event.success),
            "{event:?}"
        );
        // The origin of the log is about 1.4 km from that of the truth, so only distances are compared.
        assert!((event.link.range_m() - true_event.link.range_m()).abs() < 1.0, "{event:?}: {true_event:?}");
    }
}
