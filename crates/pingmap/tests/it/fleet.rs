//! `pingmap fleet`: one process for each vehicle of a mission.

use crate::common::*;

#[test]
fn processes_score_like_a_replay_of_the_same_mission() {
    let folder = tempfile::tempdir().unwrap();
    let result = json(folder.path(), &["fleet", "--json"]);
    let (processes, replay) = (result["nll"].as_f64().unwrap(), result["replayed"]["team"].as_f64().unwrap());
    assert!((processes - replay).abs() <= 0.002, "{processes} {replay}");
    assert!(processes < result["replayed"]["own"].as_f64().unwrap());
    assert!(!result["killed"].is_null());
}

#[test]
fn a_log_with_a_long_gap_has_the_same_events_in_every_process() {
    let folder = tempfile::tempdir().unwrap();
    let later = |line: &str| match line.split_once(',') {
        Some((time_s, rest)) if time_s.parse().is_ok_and(|time_s: u32| time_s >= 40) => {
            format!("{},{rest}\n", time_s.parse::<u32>().unwrap() + 6000)
        }
        _ => format!("{line}\n"),
    };
    file(folder.path(), "events.csv", log(&["a", "b"], 80).lines().map(later).collect::<String>());
    let result = json(folder.path(), &["fleet", "events.csv", "--no-kill", "--json"]);
    assert_eq!(result["events"], 80);
}
