use pingmap_vehicle::read_snapshot;
use serde_json::{Value, json};

use super::host::{HELLO, Host, signal};
use super::mission;

const NAV: &str = r#"{"type":"nav","time":1000,"position":{"x":100,"y":100}}"#;

/// Lines after a greeting and a position, with the code of their error.
fn bad_lines() -> Vec<(&'static str, Vec<u8>)> {
    let links = |count: usize| vec![r#"{"from":"auv1","to":"auv1"}"#; count].join(",");
    let text = |text: &str| text.as_bytes().to_vec();
    vec![
        ("line_too_long", vec![b'x'; 65_537]),
        ("line_too_long", vec![b'['; 5_000_000]),
        ("line_too_long", text(&format!(r#"{{"type":"predict","links":[{}]}}"#, links(10_000)))),
        ("out_of_bounds", text(&format!(r#"{{"type":"predict","links":[{}]}}"#, links(1_001)))),
        ("not_json", text("")),
        ("not_json", text("   ")),
        ("not_json", text(r#"{"type":"#)),
        ("not_json", text("[1,2]")),
        ("not_json", text("null")),
        ("not_json", vec![b'['; 60_000]),
        ("not_json", b"{\"type\":\"\xff\xfe\"}".to_vec()),
        ("not_json", b"\x00\x01".to_vec()),
        ("not_json", text(r#"{"type":"nav","time":NaN,"position":{"x":1,"y":1}}"#)),
        ("not_json", text(r#"{"type":"nav","time":1e999,"position":{"x":1,"y":1}}"#)),
        ("unknown_type", text(r#"{"type":"dance"}"#)),
        ("unknown_type", text(r#"{"type":7}"#)),
        ("unknown_type", text("{}")),
        ("wrong_field", text(r#"{"type":"status","more":1}"#)),
        ("wrong_field", text(r#"{"type":"nav","time":1000,"position":{"x":1,"y":1,"z":1}}"#)),
        ("wrong_field", text(r#"{"type":"nav","time":1000}"#)),
        ("wrong_field", text(r#"{"type":"nav","time":"noon","position":{"x":1,"y":1}}"#)),
        ("wrong_field", text(r#"{"type":"frame_in","time":1000,"from":"auv2","bytes":"abc"}"#)),
        ("wrong_field", text(r#"{"type":"frame_request","time":1000,"bytes":-1}"#)),
        ("wrong_field", text(r#"{"type":"frame_in","time":1000,"bytes":"00"}"#)),
        ("wrong_time", text(r#"{"type":"listening","from":1000,"to":100000}"#)),
        ("wrong_time", text(r#"{"type":"nav","time":100000,"position":{"x":1,"y":1}}"#)),
        ("out_of_bounds", text(r#"{"type":"nav","time":1e300,"position":{"x":1,"y":1}}"#)),
        ("out_of_bounds", text(r#"{"type":"listening","from":1010,"to":1000}"#)),
        ("out_of_bounds", text(r#"{"type":"frame_request","time":1000,"bytes":1}"#)),
        ("out_of_bounds", text(r#"{"type":"piggyback_request","time":1000,"n_bits":900}"#)),
        ("wrong_place", text(r#"{"type":"nav","time":1000,"position":{"x":4000000,"y":0}}"#)),
        ("wrong_place", text(r#"{"type":"nav","time":1000,"position":{"x":1}}"#)),
        ("wrong_place", text(r#"{"type":"nav","time":1000,"position":{"lat":41.5,"lon":-70.6}}"#)),
        ("wrong_place", text(r#"{"type":"nav","time":1000,"position":{"x":1,"y":1,"lat":41.5,"lon":-70.6}}"#)),
        ("unknown_member", text(r#"{"type":"heard","time":1000,"from":"auv9"}"#)),
        ("unknown_member", text(r#"{"type":"heard","time":1000,"from":"auv1"}"#)),
        ("unknown_token", text(r#"{"type":"dropped","token":99}"#)),
        ("not_greeted", text(HELLO)),
    ]
}

#[test]
fn every_bad_line_gets_its_error() {
    let folder = mission::folder();
    let mut host = Host::start(folder.path(), &["vehicle"]);
    for line in [r#"{"type":"status"}"#, r#"{"type":"stop"}"#] {
        assert_eq!(host.ask(line)["code"], "not_greeted", "{line}");
    }
    for wrong in [r#""version":2"#, r#""version":1,"vehicle":"auv2""#, r#""version":1,"team":"00""#] {
        assert_eq!(host.ask(&format!(r#"{{"type":"hello",{wrong}}}"#))["code"], "mismatch", "{wrong}");
    }
    assert_eq!(host.ask(HELLO)["type"], "hello");
    assert_eq!(host.ask(NAV), json!({ "type": "ok", "input": 7, "stored": true }));
    for (number, (code, line)) in (8..).zip(bad_lines()) {
        let shown = String::from_utf8_lossy(&line[..line.len().min(120)]).into_owned();
        host.write(&line);
        let answer = host.ask("");
        let is_right = answer["type"] == "error" && answer["input"] == number && answer["code"] == code;
        let is_right = is_right && (answer["code"] != "wrong_field" || answer["field"].is_string());
        assert!(is_right && answer["message"].as_str().unwrap().len() > 10, "{shown}: {answer}");
    }
    // The process is as useful as before.
    assert_eq!(host.ask(&NAV.replace("1000", "1005"))["type"], "ok");
    assert_eq!(host.ask(r#"{"type":"status"}"#)["type"], "status");
    host.write(b"{\"type\":\"sta");
    host.close();
    let (status, messages, log) = host.finish();
    assert!(status.success() && !log.contains("panicked"), "{log}");
    let types: Vec<&Value> = messages.iter().map(|message| &message["type"]).collect();
    assert_eq!(types, ["error", "stopped"], "{messages:?}");
    assert!(messages[0]["message"].as_str().unwrap().contains("in the middle of a line"), "{messages:?}");
}

#[test]
fn every_end_is_clean() {
    let folder = mission::folder();
    for (round, end) in ["stop", "end of input", "TERM", "INT"].into_iter().enumerate() {
        let (mut host, _) = Host::greeted(folder.path());
        let nav = NAV.replace("1000", &(1000 + 10 * round).to_string());
        assert_eq!(host.ask(&nav)["type"], "ok", "{end}");
        match end {
            "stop" => host.send(r#"{"type":"stop"}"#),
            "end of input" => host.close(),
            name => signal(&host.child, name),
        }
        let (status, messages, log) = host.finish();
        assert!(status.success() && !log.contains("panicked"), "{end}: {status}, {log}");
        assert_eq!(messages.last().unwrap()["type"], "stopped", "{end}: {messages:?}");
        // Everything is in the base and in the snapshot.
        let contents = mission::contents(folder.path());
        assert!(contents.entries.is_empty(), "{end}: {}", contents.entries.len());
        let snapshot = read_snapshot(&folder.path().join("auv1.snapshot")).unwrap();
        assert_eq!(snapshot, contents.base.unwrap(), "{end}");
    }
}
