//! Packets on the command line: content, loss, authentication, and online replays.

use crate::common::{file, json, log, pingmap, stderr, stdout, two_splits};
use serde_json::Value;
use std::path::Path;

const KEY: &str = "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff\n";

/// Returns a folder with a log, a model, a key and a team.
fn team_folder(options: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["anna", "bert"], 120));
    file(folder.path(), "team.key", KEY);
    let fast =
        ["--terms", "path", "--kernel", "matern32", "--inputs", "link", "--reciprocal", "yes", "--prior-mean", "zero"];
    let learn = pingmap(folder.path(), &[&["learn", "events.csv"], &fast[..]].concat());
    assert!(learn.status.success(), "{}", stderr(&learn));
    let team = pingmap(folder.path(), &[&["team", "events.csv"], options].concat());
    assert!(team.status.success(), "{}", stderr(&team));
    folder
}

fn refused(folder: &Path, arguments: &[&str], expected: &str) {
    let output = pingmap(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
    assert!(stderr(&output).contains(expected), "{expected:?} is missing: {}", stderr(&output));
    assert!(output.stdout.is_empty());
}

fn nll(score: &Value) -> f64 {
    score["nll"].as_f64().unwrap()
}

#[test]
fn a_team_file_gives_the_same_result_as_the_options() {
    let folder = team_folder(&[]);
    let replay = |options: &[&str]| {
        json(folder.path(), &[&["replay", "events.csv", "--frames", "2", "--json"], options].concat())
    };
    let (by_model, by_team) = (replay(&["--model", "model.toml"]), replay(&["--team", "team.toml"]));
    assert_eq!(by_model["sharing"], by_team["sharing"]);
    assert_eq!(by_model["packets"], by_team["packets"]);
}

#[test]
fn authentication_costs_one_point_of_each_packet() {
    let folder = team_folder(&["--key-file", "team.key"]);
    let result = json(folder.path(), &["replay", "events.csv", "--frames", "1", "--team", "team.toml", "--json"]);
    assert_eq!(
        (&result["packets"]["authenticated"], &result["packets"]["message"]),
        (&true.into(), &"MapAuthenticated32".into())
    );
    assert_eq!(result["sharing"][0]["points_per_frame"], 4);
    assert!(nll(&result["sharing"][0]["team"]) < nll(&result["scores"]["own"]) + 0.01);
    file(folder.path(), "team.key", "ab".repeat(32));
    refused(folder.path(), &["replay", "events.csv", "--team", "team.toml"], "all bytes of the key are equal");
    file(folder.path(), "team.key", "not a key");
    refused(
        folder.path(),
        &["replay", "events.csv", "--team", "team.toml"],
        "team.key: key must be 64 hexadecimal digits",
    );
}

#[test]
fn larger_frames_lower_the_nll() {
    let folder = team_folder(&[]);
    let team = |bytes| {
        let command =
            ["replay", "events.csv", "--model", "model.toml", "--frames", "1", "--frame-bytes", bytes, "--json"];
        let row = json(folder.path(), &command)["sharing"][0].clone();
        (row["bytes_per_vehicle"].as_f64().unwrap(), nll(&row["team"]))
    };
    let [small, middle, large] = ["32", "64", "256"].map(team);
    assert!(small.0 == 32.0 && middle.0 > 32.0 && middle.0 <= 64.0 && large.0 > 64.0 && large.0 <= 256.0);
    assert!(large.1 < small.1, "{small:?} {middle:?} {large:?}");
}

#[test]
fn duplicates_and_order_do_not_change_the_result_and_loss_does() {
    let folder = team_folder(&[]);
    let team = |options: &[&str]| {
        let command = ["replay", "events.csv", "--model", "model.toml", "--frames", "4", "--json"];
        nll(&json(folder.path(), &[&command[..], options].concat())["sharing"][0]["team"])
    };
    let (calm, rough, lost) = (team(&[]), team(&["--duplicate", "0.5", "--reorder", "0.5"]), team(&["--loss", "1"]));
    assert!((calm - rough).abs() < 1e-9, "{calm} {rough}");
    let own = json(folder.path(), &["replay", "events.csv", "--model", "model.toml", "--frames", "1", "--json"]);
    assert_eq!(lost, nll(&own["scores"]["own"]));
    assert!((calm - lost).abs() > 1e-4);
}

#[test]
fn every_alternative_use_of_the_bytes_is_compared() {
    let folder = team_folder(&[]);
    let command = ["replay", "events.csv", "--model", "model.toml", "--frames", "1,3", "--compare"];
    let text = stdout(&pingmap(folder.path(), &command));
    for name in [
        "summaries only",
        "reports only",
        "(unrounded)",
        "raw events",
        "random points",
        "bad points",
        "variational",
        "concatenation",
    ] {
        assert!(text.contains(name), "{name} is missing: {text}");
    }
    let result = json(folder.path(), &[&command[..], &["--json"]].concat());
    for row in result["sharing"].as_array().unwrap() {
        let ways = row["alternatives"].as_array().unwrap();
        assert_eq!(ways.len(), 8);
        assert!(ways.iter().all(|way| way["nll"].as_f64().is_some_and(f64::is_finite)));
    }
}

#[test]
fn an_online_replay_predicts_events_in_the_order_of_time() {
    let folder = team_folder(&[]);
    let command = ["replay", "events.csv", "--online", "--slot-every", "5", "--report", "report"];
    let output = pingmap(folder.path(), &command);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stdout(&output).contains("120 events in the order of time"), "{}", stdout(&output));
    let page = std::fs::read_to_string(folder.path().join("report/index.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("NLL"));
    assert!(std::fs::read(folder.path().join("report/online.png")).unwrap().starts_with(b"\x89PNG"));
    let result = json(folder.path(), &["replay", "events.csv", "--online", "--slot-every", "5", "--json"]);
    let number = |key: &str| result[key].as_u64().unwrap();
    let packets = result["packets"].as_object().unwrap().values().map(|sent| sent.as_u64().unwrap()).sum::<u64>();
    assert!(number("bytes") > 0 && number("bytes") <= 32 * packets && number("received") > 0);
    let running = result["running_nll"].as_array().unwrap();
    assert_eq!(running.last().unwrap(), &result["nll"]);
    // Before the first packet the team predicts like each vehicle alone.
    assert_eq!(running[0]["own"], running[0]["team"]);
    let alone =
        json(folder.path(), &["replay", "events.csv", "--online", "--slot-every", "5", "--loss", "1", "--json"]);
    let close = |a: &Value, b: &Value| (a.as_f64().unwrap() - b.as_f64().unwrap()).abs() < 1e-9;
    assert!(alone["received"] == 0 && close(&alone["nll"]["team"], &alone["nll"]["own"]), "{alone}");
    assert_eq!(alone["nll"]["own"], result["nll"]["own"]);
}

#[test]
fn the_schedule_of_a_team_is_found_in_the_log() {
    let folder = team_folder(&["--start-s", "60.5"]);
    let team = std::fs::read_to_string(folder.path().join("team.toml")).unwrap();
    assert!(team.contains("order = [\"anna\", \"bert\"]") && team.contains("duration_s = 1.0"), "{team}");
    assert!(team.contains("[slots]\nstart_s = 60.0"), "numbers are for the mission: {team}");
    // One transmission out of its slot means that there is no schedule.
    let other = log(&["anna", "bert"], 120).replacen("\n7,bert,anna", "\n7,anna,bert", 1);
    file(folder.path(), "other.csv", other);
    let output = pingmap(folder.path(), &["team", "other.csv", "--overwrite"]);
    assert!(output.status.success() && stderr(&output).contains("no TDMA schedule"), "{}", stderr(&output));
}

#[test]
fn piggybacked_bytes_are_sent_with_every_transmission() {
    let folder = team_folder(&[]);
    let command = ["replay", "events.csv", "--online", "--piggyback-bytes", "2"];
    let text = stdout(&pingmap(folder.path(), &command));
    assert!(text.contains("; 2 piggybacked bytes on each\n") && !text.contains("packet"), "{text}");
    let result = json(folder.path(), &[&command[..], &["--json"]].concat());
    assert!(result["bytes"] == 0 && result["received"] == 0 && result["slot_every"].is_null(), "{result}");
    let sent = result["piggyback_bytes_sent"].as_u64().unwrap();
    assert!(sent > 100 && sent.is_multiple_of(2), "{sent}");
    assert_ne!(result["nll"]["team"], result["nll"]["own"]);
    // The option enables them for a team with a key as well, and together with packets.
    let with_key = json(folder.path(), &[&command[..], &["--json", "--key-file", "team.key"]].concat());
    assert_eq!(with_key["nll"], result["nll"]);
    let both = json(folder.path(), &[&command[..], &["--slot-every", "5", "--json"]].concat());
    assert!(both["bytes"].as_u64().unwrap() > 0 && both["piggyback_bytes_sent"] == sent, "{both}");
}

#[test]
fn reports_are_encoded_and_decoded_as_json() {
    let folder = team_folder(&[]);
    let report = r#"{"schema":1,"message":"Report","sender":1,"first":40,"outcomes":"hm-mh",
        "waypoints":[{"slot":38,"cell":[7,200]},{"slot":51,"cell":[250,0]}]}"#;
    file(folder.path(), "report.json", report);
    let alone = stdout(&pingmap(folder.path(), &["packet", "encode", "report.json"]));
    let read = json(folder.path(), &["packet", "decode", alone.trim(), "--json"]);
    assert_eq!((&read["outcomes"], &read["waypoints"][1]["slot"]), (&"hm-mh".into(), &51.into()));
    let of_team = stdout(&pingmap(folder.path(), &["packet", "encode", "report.json", "--team", "team.toml"]));
    assert_ne!(of_team, alone);
    let padded = format!("{}0000", of_team.trim());
    let text = stdout(&pingmap(folder.path(), &["packet", "decode", &padded, "--team", "team.toml"]));
    assert!(
        text.contains("Report of bert, slots from 40 on") && text.contains("heard 2, missed 2, not reported 1"),
        "{text}"
    );
    assert!(text.contains("waypoint, m"), "{text}");
    for (wrong, right, expected) in [
        ("hm-mh", "hm?mh", "expected h, m or -"),
        ("[7,200]", "[7,200,1]", "expected 2 cells"),
        (r#""slot":51"#, r#""slot":30"#, "slots of waypoints must rise"),
        (r#""first":40"#, r#""first":400"#, "slots of waypoints must rise"),
        (r#""Report""#, r#""ReportFar""#, "unknown message"),
    ] {
        file(folder.path(), "wrong.json", report.replace(wrong, right));
        let output = pingmap(folder.path(), &["packet", "encode", "wrong.json"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    }
}

#[test]
fn map_messages_are_encoded_and_decoded_as_json() {
    let folder = team_folder(&["--key-file", "team.key"]);
    let point = r#"{"tx":[1,2],"rx":[63,0],"information":9,"mean":-4}"#;
    let none = r#"{"tx":[0,0],"rx":[0,0],"information":0,"mean":0}"#;
    let blocks = |points: &[&str], pairs: usize| {
        format!(r#"[{{"points":[{}],"correlations":{:?}}}]"#, points.join(","), vec![0; pairs])
    };
    let packet = |message: &str, blocks: String| {
        format!(r#"{{"schema":1,"message":"{message}","sender":1,"counter":513,"blocks":{blocks}}}"#)
    };
    file(folder.path(), "plain.json", packet("Map32", blocks(&[point, point, none, none, none], 10)));
    let plain = stdout(&pingmap(folder.path(), &["packet", "encode", "plain.json"]));
    assert_eq!(plain.trim().len(), 64);
    let read = json(folder.path(), &["packet", "decode", plain.trim(), "--json"]);
    assert_eq!(
        (&read["sender"], &read["counter"], &read["blocks"][0]["points"][1]["mean"]),
        (&1.into(), &513.into(), &(-4).into())
    );
    file(folder.path(), "again.json", read.to_string());
    assert_eq!(stdout(&pingmap(folder.path(), &["packet", "encode", "again.json"])), plain);

    file(folder.path(), "tagged.json", packet("MapAuthenticated32", blocks(&[point, none, none, none], 6)));
    let tagged = stdout(&pingmap(folder.path(), &["packet", "encode", "tagged.json", "--team", "team.toml"]));
    let text = stdout(&pingmap(folder.path(), &["packet", "decode", tagged.trim(), "--team", "team.toml"]));
    assert!(text.contains("MapAuthenticated32 of bert, number 513") && text.contains("transmitter, m"), "{text}");
    refused(folder.path(), &["packet", "decode", tagged.trim()], "expected --team");
    let altered = tagged.trim().replacen("02", "03", 1);
    refused(
        folder.path(),
        &["packet", "decode", &altered, "--team", "team.toml"],
        "the authentication tag does not match",
    );
    refused(folder.path(), &["packet", "decode", plain.trim(), "--team", "team.toml"], "not of this team");
    refused(folder.path(), &["packet", "decode", "fa2"], "pairs of hexadecimal digits");
    refused(folder.path(), &["packet", "decode", "00"], "message id");
    file(
        folder.path(),
        "bad.json",
        packet("Map32", blocks(&[&point.replace(":9", ":40"), none, none, none, none], 10)),
    );
    refused(folder.path(), &["packet", "encode", "bad.json"], "information must lie between 0 and 31, found 40");
}

#[test]
fn the_schema_lists_the_bits_of_every_field() {
    let folder = tempfile::tempdir().unwrap();
    let points = |options: &[&str]| {
        let schema = json(folder.path(), &[&["packet", "schema", "--json"], options].concat());
        let bits: u64 = schema["fields"].as_array().unwrap().iter().map(|field| field["bits"].as_u64().unwrap()).sum();
        assert_eq!(bits + schema["id_bits"].as_u64().unwrap(), schema["bits_used"].as_u64().unwrap());
        assert!(schema["bytes"].as_u64() <= schema["frame_bytes"].as_u64());
        schema["points"].as_u64().unwrap()
    };
    assert_eq!(
        [points(&[]), points(&["--authenticated"]), points(&["--depth"]), points(&["--depth", "--authenticated"])],
        [5, 4, 4, 3]
    );
    assert!(points(&["--frame-bytes", "64"]) > 5 && points(&["--frame-bytes", "256", "--authenticated"]) > 20);
    let proto = stdout(&pingmap(folder.path(), &["packet", "schema", "--proto"]));
    assert!(proto.starts_with("//") || proto.contains("syntax = \"proto2\";"));
    assert!(proto.contains("message MapAuthenticated32 {") && proto.contains("codec_version: 4 id: 125 max_bytes: 32"));
    let text = stdout(&pingmap(folder.path(), &["packet", "schema"]));
    assert!(text.contains("Map32, DCCL id 124: 32 of 32 bytes") && text.contains("correlation"), "{text}");
    let report = json(folder.path(), &["packet", "schema", "--report", "--authenticated", "--json"]);
    assert_eq!(
        (&report["message"], &report["id"], &report["points"]),
        (&"ReportAuthenticated".into(), &137.into(), &Value::Null)
    );
    let text = stdout(&pingmap(folder.path(), &["packet", "schema", "--report"]));
    assert!(text.contains("Report, DCCL id 136: 10 to ") && text.contains("waypoint"), "{text}");
}

#[test]
fn ten_frames_with_30_percent_loss_are_as_good_as_seven_without() {
    let folder = tempfile::tempdir().unwrap();
    let Some(events) = two_splits(folder.path(), "bay3") else { return };
    let learn = pingmap(
        folder.path(),
        &[
            "learn",
            &events,
            "--terms",
            "path",
            "--kernel",
            "matern32",
            "--inputs",
            "link",
            "--reciprocal",
            "yes",
            "--prior-mean",
            "zero",
        ],
    );
    assert!(learn.status.success(), "{}", stderr(&learn));
    let team = |frames: &str, options: &[&str]| {
        let command =
            ["replay", &events, "--splits", "splits.csv", "--model", "model.toml", "--frames", frames, "--json"];
        nll(&json(folder.path(), &[&command[..], options].concat())["sharing"][0]["team"])
    };
    let calm = team("7", &[]);
    let seeds = 10;
    let lossy = |seed: usize| team("10", &["--loss", "0.3", "--seed", &seed.to_string()]);
    let mean = (1..=seeds).map(lossy).sum::<f64>() / seeds as f64;
    assert!(mean <= calm + 0.010, "{mean} with loss, {calm} without");
}

#[test]
fn a_key_file_that_others_can_read_gives_a_warning() {
    let folder = team_folder(&[]);
    let command =
        ["team", "events.csv", "--key-file", "team.key", "--epoch", "7", "--frame-bytes", "256", "--overwrite"];
    let warns = || stderr(&pingmap(folder.path(), &command)).contains("can read the key");
    #[cfg(unix)]
    for (mode, expected) in [(0o600, false), (0o644, true)] {
        use std::os::unix::fs::PermissionsExt;
        let permissions = std::fs::Permissions::from_mode(mode);
        std::fs::set_permissions(folder.path().join("team.key"), permissions).unwrap();
        assert_eq!(warns(), expected, "{mode:o}");
    }
    // The file contains the epoch, and the window that belongs to the frame size.
    let text = std::fs::read_to_string(folder.path().join("team.toml")).unwrap();
    assert!(text.contains("epoch = 7") && text.contains("packets_per_sender_max = 56"), "{text}");
}

#[test]
fn a_replay_names_the_members_that_vehicles_do_not_use() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut log = pingmap_trial::built_in("bay3").unwrap().unwrap();
    // The receiver of auv3 reports inverted outcomes.
    let of_auv3 = log.events.iter_mut().filter(|event| event.receiver_id.as_str() == "auv3");
    of_auv3.for_each(|event| event.success = !event.success);
    file(folder, "log.csv", log.to_csv());
    let arguments = "replay log.csv --kernel matern32 --additions none --repeats 1 --frames 10".split(' ');
    let arguments: Vec<&str> = arguments.collect();
    let message = stderr(&pingmap(folder, &arguments));
    assert!(
        message.contains("auv1 does not use auv3 in 1 of 1 splits: its outcomes or summaries contradict"),
        "{message}"
    );
    let found = json(folder, &[&arguments[..], &["--json"]].concat());
    let ignored = found["per_split"][0]["ignored"].as_array().unwrap();
    let is_found = |one: &Value| one["listener"] == "auv1" && one["member"] == "auv3" && one["reason"] == "contradicts";
    assert!(ignored.iter().any(is_found), "{ignored:?}");
}
