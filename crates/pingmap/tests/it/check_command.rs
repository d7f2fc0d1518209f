//! `pingmap check`: findings, refusals, and several logs as one.

use std::io::Write;
use std::process::{Command, Stdio};

use crate::common::*;

#[test]
fn a_correct_log_passes() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = ["simulate", "--slots", "90", "-o", "events.csv"];
    assert!(pingmap(folder.path(), &simulate).status.success());
    let output = pingmap(folder.path(), &["check", "events.csv", "--strict"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = stdout(&output);
    for words in ["auv1 → auv2", "share heard", "range (m)"] {
        assert!(text.contains(words), "{text}");
    }
    let json = json(folder.path(), &["check", "events.csv", "--json"]);
    assert_eq!(json["findings"].as_array().unwrap().len(), 0, "{json}");
    let sent: u64 = json["pairs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|pair| pair["heard"].as_u64().unwrap() + pair["missed"].as_u64().unwrap())
        .sum();
    assert_eq!(sent, 180);
}

#[test]
fn findings_are_printed_and_unusable_logs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let events = log(&["a", "b"], 60);
    file(
        folder,
        "heard.csv",
        events.lines().filter(|line| !line.ends_with(",0")).map(|line| format!("{line}\n")).collect::<String>(),
    );
    file(folder, "case.csv", events.replacen(",b,", ",B,", 3));
    let check = |name: &str, options: &[&str]| {
        let output = pingmap(folder, &[&["check", name], options].concat());
        (output.status.code(), stdout(&output))
    };
    let (status, text) = check("heard.csv", &[]);
    assert!(status == Some(0) && text.contains("!! no event is a miss"), "{text}");
    assert_eq!(check("heard.csv", &["--strict"]).0, Some(2));
    assert!(check("case.csv", &[]).1.contains("B and b differ in case only"));
    // Commands that learn a map refuse it without --accept-bad-log.
    for command in [&["learn", "heard.csv"][..], &["map", "heard.csv", "--at", "0,0"], &["team", "heard.csv"]] {
        let output = pingmap(folder, command);
        assert_eq!(output.status.code(), Some(2), "{command:?}");
        let message = stderr(&output);
        assert!(
            message.contains("heard.csv") && message.contains("pingmap import") && message.contains("--accept-bad-log"),
            "{message}"
        );
        let output = pingmap(folder, &[command, &["--accept-bad-log"]].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(stderr(&output).contains("no event is a miss"));
    }
    // Other findings are warnings.
    let output = pingmap(folder, &["team", "case.csv", "--overwrite"]);
    assert!(output.status.success() && stderr(&output).contains("warning: case.csv: B and b"), "{}", stderr(&output));
}

#[test]
fn several_logs_are_read_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let whole = log(&["a", "b", "c"], 90);
    let lines: Vec<&str> = whole.lines().collect();
    let part = |lines: &[&str]| format!("{HEADER}\n{}\n", lines.join("\n"));
    file(folder, "whole.csv", &whole);
    file(folder, "one.csv", part(&lines[1..40]));
    file(folder, "two.csv", part(&lines[40..]));
    let digest = |arguments: &[&str]| json(folder, &[arguments, &["--json"]].concat())["log_digest"].clone();
    let all = digest(&["check", "whole.csv"]);
    assert_eq!(digest(&["check", "one.csv", "two.csv"]), all);
    assert_eq!(digest(&["check", "two.csv", "one.csv"]), all);
    assert_ne!(digest(&["check", "one.csv"]), all);
    // One of the logs may come from standard input.
    let mut child = Command::new(env!("CARGO_BIN_EXE_pingmap"))
        .current_dir(folder)
        .args(["check", "one.csv", "-", "--json"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(part(&lines[40..]).as_bytes()).unwrap();
    let found: serde_json::Value = serde_json::from_slice(&child.wait_with_output().unwrap().stdout).unwrap();
    assert_eq!(found["log_digest"], all);
    // Every command accepts several logs. The old option for logs still works.
    let map = |logs: &[&str]| {
        let output = pingmap(
            folder,
            &[&["map"], logs, &["--at", "500,200", "--cell-m", "200", "-o", "map.csv", "--overwrite"]].concat(),
        );
        assert!(output.status.success(), "{}", stderr(&output));
        std::fs::read(folder.join("map.csv")).unwrap()
    };
    let of_whole = map(&["whole.csv"]);
    assert_eq!(map(&["one.csv", "two.csv"]), of_whole);
    assert_eq!(map(&["--events", "whole.csv"]), of_whole);
    // Either all logs or none have depths.
    file(folder, "deep.csv", format!("{HEADER},tx_depth_m,rx_depth_m\n1,a,b,0,0,9,9,1,5,5\n"));
    let output = pingmap(folder, &["check", "one.csv", "deep.csv"]);
    assert!(
        output.status.code() == Some(2) && stderr(&output).contains("deep.csv: one log has depths"),
        "{}",
        stderr(&output)
    );
    assert_eq!(pingmap(folder, &["check"]).status.code(), Some(2));
}

#[test]
fn a_silent_pair_and_a_wrong_schedule_are_found_in_logs_of_any_origin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let events: String = (0..60)
        .map(|n| match n % 2 {
            0 => format!("{},a,b,0,0,{},0,0\n", 10 * n, 500 + n),
            _ => format!("{},b,a,{},0,0,0,1\n", 10 * n, 500 + n),
        })
        .collect();
    file(folder, "events.csv", format!("{HEADER}\n{events}"));
    let found = json(folder, &["check", "events.csv", "--json"]);
    let texts = |found: &serde_json::Value| -> Vec<String> {
        found["findings"].as_array().unwrap().iter().map(|finding| finding["text"].to_string()).collect()
    };
    assert!(texts(&found).iter().any(|text| text.contains("b heard none of 30 messages from a")), "{found}");
    // The schedule gives each vehicle one slot in 20 s, or one in 40 s.
    for (seconds, is_right) in [(10, true), (20, false)] {
        file(
            folder,
            "mac.cfg",
            format!(
                "mac {{ type: MAC_FIXED_DECENTRALIZED slot {{ src: a slot_seconds: {seconds} }} slot {{ src: b slot_seconds: {seconds} }} }}"
            ),
        );
        let found = json(folder, &["check", "events.csv", "--json", "--schedule", "mac.cfg"]);
        let excess =
            texts(&found).iter().filter(|text| text.contains("30 transmissions, and the schedule gives it")).count();
        assert_eq!(excess, if is_right { 0 } else { 2 }, "{found}");
    }
}
