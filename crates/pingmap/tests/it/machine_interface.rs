//! Interfaces for programs: JSON objects and schemas, quiet output, completions, manual pages, help.

use std::path::Path;

use crate::common::{file, json, log, pingmap, stderr, stdout};
use serde_json::Value;

#[test]
fn every_json_object_contains_its_provenance_and_matches_its_schema() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 60));
    file(folder.path(), "links.csv", "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n0,0,100,100\n");
    file(folder.path(), "track.csv", "x,y\n0,0\n100,0\n");
    let digest = json(folder.path(), &["check", "events.csv", "--json"])["log_digest"].clone();
    assert_eq!(digest.as_str().unwrap().len(), 32);
    let schema = |name: &str| serde_json::from_str(&stdout(&pingmap(folder.path(), &["schema", name]))).unwrap();
    let learned = json(folder.path(), &["learn", "events.csv", "--terms", "path", "--additions", "none", "--json"]);
    let model = learned["model_digest"].clone();
    assert!(model.as_str().unwrap().len() == 32 && model != digest);
    for (arguments, has_model) in [
        ("check events.csv", false),
        ("predict events.csv --links links.csv --model model.toml", true),
        ("map events.csv --at 0,0 --cell-m 200 --model model.toml", true),
        ("plan standoff events.csv --at 0,0 --model model.toml", true),
        ("plan track events.csv --at 0,0 --along track.csv --model model.toml", true),
        ("plan gateway events.csv --among track.csv --along track.csv --model model.toml", true),
        ("select events.csv --vehicle a --radius-m 400 --model model.toml", true),
        ("replay events.csv --model model.toml --repeats 1 --frames 1", true),
        ("replay events.csv --model model.toml --online", true),
        ("team events.csv", true),
    ] {
        let words: Vec<&str> = arguments.split(' ').chain(["--json"]).collect();
        let object = json(folder.path(), &words);
        assert_eq!(object["version"], env!("CARGO_PKG_VERSION"), "{arguments}");
        assert_eq!(object["command"], serde_json::json!(words), "{arguments}");
        assert_eq!(object["schema"], 1 + u32::from(words[0] == "map"), "{arguments}");
        assert_eq!(object["log_digest"], digest, "{arguments}");
        assert!(!has_model || object["model_digest"] == model, "{arguments}: {}", object["model_digest"]);
        let name = match &words[..] {
            ["plan", what, ..] => format!("plan {what}"),
            ["replay", .., "--online", "--json"] => "replay --online".to_owned(),
            _ => words[0].to_owned(),
        };
        fits(&object, &schema(&name), &schema(&name), arguments);
    }
    // Without a log there is no digest.
    let packet = json(folder.path(), &["packet", "schema", "--json"]);
    assert!(packet["version"].is_string() && packet["log_digest"].is_null());
    let simulated = json(folder.path(), &["simulate", "--slots", "60", "-o", "trial.csv", "--json"]);
    let checked = json(folder.path(), &["check", "trial.csv", "--json"]);
    assert_eq!(simulated["log_digest"], checked["log_digest"]);
    // Other models and logs have other digests.
    let other = json(
        folder.path(),
        &[
            "learn",
            "trial.csv",
            "--accept-bad-log",
            "-o",
            "other.toml",
            "--terms",
            "path",
            "--additions",
            "none",
            "--json",
        ],
    );
    assert!(other["model_digest"] != model && other["log_digest"] != digest);
}

/// Asserts that a value matches its schema. `whole` contains the definitions.
fn fits(value: &Value, schema: &Value, whole: &Value, place: &str) {
    if let Some(name) = schema["$ref"].as_str() {
        return fits(value, &whole["$defs"][name.trim_start_matches("#/$defs/")], whole, place);
    }
    if let Some(choices) = schema["anyOf"].as_array() {
        let choice = choices.iter().find(|choice| (choice["type"] == "null") == value.is_null());
        return fits(value, choice.unwrap_or_else(|| panic!("{place}: {value}")), whole, place);
    }
    if let Some(kinds) = schema["oneOf"].as_array() {
        let of_kind = |of: &&Value| value["kind"] == of["properties"]["kind"]["const"];
        return fits(value, kinds.iter().find(of_kind).unwrap_or_else(|| panic!("{place}: {value}")), whole, place);
    }
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let of = schema["type"].as_array().cloned().unwrap_or_else(|| vec![schema["type"].clone()]);
    let is_known = |of: &Value| of == kind || (kind == "integer" && of == "number") || of.is_null();
    assert!(of.iter().any(is_known), "{place}: {kind}, expected {of:?}");
    for (n, item) in value.as_array().into_iter().flatten().enumerate() {
        let of_item = if schema["items"].is_object() { &schema["items"] } else { &schema["prefixItems"][n] };
        fits(item, of_item, whole, &format!("{place}[{n}]"));
    }
    let Some(object) = value.as_object() else { return };
    for name in schema["required"].as_array().into_iter().flatten() {
        assert!(object.contains_key(name.as_str().unwrap()), "{place}: no {name}");
    }
    for (name, value) in object {
        let known = &schema["properties"][name];
        let known = if known.is_null() { &schema["additionalProperties"] } else { known };
        assert!(!known.is_null() && known != false, "{place}: {name} is not in the schema");
        fits(value, known, whole, &format!("{place}.{name}"));
    }
}

#[test]
fn schemas_match_the_documentation() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/schemas");
    let names = stdout(&pingmap(Path::new("."), &["schema"]));
    for name in names.lines() {
        let path = folder.join(format!("{}.json", file_name(name)));
        let printed = stdout(&pingmap(Path::new("."), &["schema", name]));
        if std::env::var_os("PINGMAP_WRITE_GOLDEN").is_some_and(|value| value == "1") {
            std::fs::write(&path, &printed).unwrap();
        }
        let written = std::fs::read_to_string(&path).unwrap_or_else(|_| panic!("no {}", path.display()));
        assert_eq!(
            written,
            printed,
            "pingmap schema {name:?} > docs/schemas/{}.json; PINGMAP_WRITE_GOLDEN=1 rewrites all schemas",
            file_name(name)
        );
        let schema: Value = serde_json::from_str(&printed).unwrap();
        if !name.starts_with("vehicle") {
            assert_eq!(schema["properties"]["command"]["type"], "array", "{name}");
        }
        every_key_is_described(&schema, name);
    }
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), names.lines().count() + 1, "one page beside the schemas");
    assert!(pingmap(Path::new("."), &["schema", "man"]).status.code() == Some(2));
}

/// Asserts that every key except constants has a description.
fn every_key_is_described(schema: &Value, place: &str) {
    for (key, of) in schema["properties"].as_object().into_iter().flatten() {
        let is_described = of["description"].as_str().is_some_and(|text| text.len() > 4) || of["const"].is_string();
        assert!(is_described, "{place}.{key} is not described");
    }
    let inner = ["$defs", "oneOf", "anyOf"].iter().flat_map(|within| match &schema[within] {
        Value::Object(of) => of.values().collect(),
        Value::Array(of) => of.iter().collect(),
        _ => Vec::new(),
    });
    inner.for_each(|of| every_key_is_described(of, place));
}

/// "packet decode (report)" → "packet-decode-report".
fn file_name(name: &str) -> String {
    let letters: String = name.chars().map(|letter| if letter.is_alphanumeric() { letter } else { ' ' }).collect();
    letters.split_whitespace().collect::<Vec<_>>().join("-")
}

#[test]
fn quiet_commands_print_only_results_and_warnings() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 60));
    let map = ["map", "events.csv", "--at", "0,0", "--cell-m", "200", "--overwrite"];
    let message = |more: &[&str]| stderr(&pingmap(folder.path(), &[&map[..], more].concat()));
    assert!(message(&[]).contains("wrote map.png"));
    let warned = message(&["--quiet"]);
    assert!(!warned.is_empty() && warned.lines().all(|line| line.starts_with("warning: ")), "{warned}");
    assert_eq!(message(&["-q"]), warned);
    // The option does not change the map.
    let drawn = std::fs::read(folder.path().join("map.png")).unwrap();
    message(&[]);
    assert_eq!(std::fs::read(folder.path().join("map.png")).unwrap(), drawn);
}

#[test]
fn completions_and_manual_pages_contain_every_command() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let text = stdout(&pingmap(folder.path(), &["completions", shell]));
        for word in ["standoff", "--along", "--conservative-range-m", "import"] {
            // Completions of fish contain long options without dashes.
            assert!(text.contains(word.trim_start_matches('-')), "{shell}: no {word}");
        }
    }
    let refused = pingmap(folder.path(), &["completions", "tcsh"]);
    assert!(refused.status.code() == Some(2) && stderr(&refused).contains("bash"), "{}", stderr(&refused));
    let page = stdout(&pingmap(folder.path(), &["man"]));
    assert!(page.contains(".TH pingmap") && page.contains("pingmap\\-plan") && page.contains("\\-\\-quiet"), "{page}");
    assert!(pingmap(folder.path(), &["man", "pages"]).status.success());
    let page = std::fs::read_to_string(folder.path().join("pages/pingmap-plan-track.1")).unwrap();
    assert!(page.contains("\\-\\-along") && page.contains("waypoints"), "{page}");
    assert!(std::fs::read_dir(folder.path().join("pages")).unwrap().count() >= 20);
    file(folder.path(), "taken", "");
    let refused = pingmap(folder.path(), &["man", "taken"]);
    assert!(
        refused.status.code() == Some(2) && stderr(&refused).contains("taken is not a folder"),
        "{}",
        stderr(&refused)
    );
}

/// The most important groups of options come first.
#[test]
fn help_is_grouped_and_ends_with_examples() {
    let folder = tempfile::tempdir().unwrap();
    let help = |command: &str| {
        stdout(&pingmap(folder.path(), &[&command.split(' ').collect::<Vec<_>>()[..], &["--help"]].concat()))
    };
    let commands =
        ["import", "check", "map", "predict", "learn", "replay", "select", "team", "simulate", "reproduce", "demo"];
    for command in commands.into_iter().chain(["plan standoff", "plan track", "plan gateway"]) {
        let text = help(command);
        let (before, examples) = text.rsplit_once("Example").unwrap_or_else(|| panic!("{command} has no example"));
        assert!(examples.contains(&format!("pingmap {command}")) && !before.is_empty(), "{command}: {examples}");
    }
    assert!(help("learn").contains("\nModel options:\n") && !help("map").contains("--kernel"));
    let text = help("map");
    let place = |what: &str| text.find(what).unwrap_or_else(|| panic!("no {what}"));
    assert!(
        place("\nView:") < place("\nVehicles and time:")
            && place("\nVehicles and time:") < place("\nReference system:")
            && place("\nDrawing:") < place("\nComputation:"),
        "{text}"
    );
    // Each option is in its own group.
    let group = |option: &str| {
        let mut headings = text[..place(option)].lines().filter(|line| line.ends_with(':') && !line.starts_with(' '));
        headings.next_back().unwrap_or_default().to_owned()
    };
    for (option, heading) in [
        ("\n      --model <FILE>", "Log and model:"),
        ("\n  -o, --output <FILE>", "Result:"),
        ("\n      --json", "Result:"),
        ("\n  [LOG]...", "Arguments:"),
    ] {
        assert_eq!(group(option), heading);
    }
}
