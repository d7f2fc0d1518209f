//! `pingmap learn`, and model files in other commands.

use std::path::Path;

use crate::common::{HEADER, file, json, learn, log, pingmap, stderr, stdout};
use serde_json::Value;

/// Learns from a small log, and returns the text of the model file.
fn learned(folder: &Path, options: &[&str]) -> String {
    file(folder, "events.csv", log(&["a", "b"], 120));
    let output = pingmap(
        folder,
        &[&["learn", "events.csv", "--kernel", "matern32", "--inputs", "raw", "--overwrite"], options].concat(),
    );
    assert!(output.status.success(), "{}", stderr(&output));
    std::fs::read_to_string(folder.join("model.toml")).unwrap()
}

/// Asserts that a command is refused, and returns its error message.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = pingmap(folder, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
    assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
    stderr(&output)
}

#[test]
fn learn_prints_every_candidate_and_writes_the_best() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 120));
    let command = ["learn", "events.csv", "--test-share", "0.3", "--reciprocal", "yes", "--json"];
    let result = json(folder.path(), &command);
    let candidates = result["candidates"].as_array().unwrap();
    // The first structure, and eight or nine optional terms.
    assert!((9..=10).contains(&candidates.len()), "{candidates:?}");
    let merit = |candidate: &Value| candidate["leave_one_out"].as_f64().unwrap();
    assert!(candidates.windows(2).all(|pair| merit(&pair[0]) >= merit(&pair[1])));
    for candidate in candidates {
        assert!(candidate["evidence"].as_f64().unwrap() < 0.0 && merit(candidate) < 0.0, "{candidate}");
        assert!(candidate["held_out_nll"].as_f64().unwrap() < 0.6, "{candidate}");
        assert_eq!(candidate["events_used"], 84, "{candidate}");
    }
    // The written model was learned from all events.
    assert!(candidates.iter().any(|candidate| candidate["structure"] == result["model"]["structure"]));
    assert_eq!(result["model"]["events_used"], 120);
    let text = stdout(&pingmap(
        folder.path(),
        &["learn", "events.csv", "--terms", "path", "--kernel", "matern32", "--overwrite"],
    ));
    for expected in
        ["E: evidence bound", "leave-one-out", "range mean", "Matérn 3/2, ", "Matérn 3/2 *", "Rule: ", "0.001 nats"]
    {
        assert!(text.contains(expected), "{expected:?} is missing: {text}");
    }
}

#[test]
fn all_commands_accept_a_model_file() {
    let folder = tempfile::tempdir().unwrap();
    let text = learned(folder.path(), &["--terms", "path", "--prior-mean", "zero"]);
    for expected in
        ["schema = 6", "[chart]", "origin_east_m", "scale_m", "length_scale_m = ", "evidence = ", "events = 120"]
    {
        assert!(text.contains(expected), "{expected:?} is missing: {text}");
    }
    file(folder.path(), "links.csv", "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n0,200,500,300\n");
    let model = ["--model", "model.toml"];
    let events = ["events.csv"];
    let predict =
        json(folder.path(), &[&["predict"], &events[..], &model, &["--links", "links.csv", "--json"]].concat());
    let map =
        json(folder.path(), &[&["map"], &events[..], &model, &["--at", "0,0", "-o", "map.csv", "--json"]].concat());
    let select = json(folder.path(), &[&["select", "events.csv", "--vehicle", "a", "--json"], &model[..]].concat());
    let replay = json(folder.path(), &[&["replay", "events.csv", "--frames", "1", "--json"], &model[..]].concat());
    let length_scale_m = &predict["kernel"]["length_scale_m"];
    assert!(text.contains(&format!("length_scale_m = {length_scale_m}")), "{length_scale_m}: {text}");
    for result in [map, select, replay] {
        assert_eq!(&result["kernel"]["length_scale_m"], length_scale_m);
    }
    // An edited model file is used without learning.
    let edited = text.replace(&format!("length_scale_m = {length_scale_m}"), "length_scale_m = 123.0");
    file(folder.path(), "model.toml", edited);
    let select = json(folder.path(), &[&["select", "events.csv", "--vehicle", "a", "--json"], &model[..]].concat());
    assert_eq!(select["kernel"]["terms"][0]["length_scales_m"], Value::from(vec![123.0; 4]));
}

#[test]
fn an_invalid_model_file_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let text = learned(folder.path(), &["--terms", "path", "--prior-mean", "zero"]);
    let select = ["select", "events.csv", "--vehicle", "a", "--model", "changed.toml"];
    let with = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}: {text}");
        file(folder.path(), "changed.toml", text.replacen(from, to, 1));
        refused(folder.path(), &select)
    };
    let expect = |message: String, parts: &[&str]| {
        for part in [&["changed.toml"], parts].concat() {
            assert!(message.contains(part), "{part:?} is missing: {message}");
        }
    };
    expect(with("scale_m = ", "colour = 3\nscale_m = "), &["unknown field `colour`", "scale_m"]);
    expect(with("variance = ", "variance = -"), &["kernel term 1", "kernel variance", "positive", "-"]);
    expect(with("length_scale_m = ", "length_scale_m = -"), &["kernel term 1", "length-scale", "positive"]);
    expect(with("\"tx_east\"", "\"tx_up\""), &["kernel term 1", "tx_up", "expected one of tx_east"]);
    expect(with("\"rx_east\", ", ""), &["reciprocal", "rx_east"]);
    expect(with("schema = 6", "schema = 7"), &["schema 7", "newer"]);
    expect(with("correlation = 0.35", "correlation = 1.5"), &["fading.correlation", "from 0 to 1", "1.5"]);
    expect(with("drift_m_per_s = 0.15", "drift_m_per_s = 0.0"), &["fading.drift_m_per_s", "above 0"]);
    expect(with("depths = false", "depths = true"), &["depths", "tx_depth_m"]);
    expect(with("kind = \"zero\"", "kind = \"zero\"\nintercept = 2.0"), &["intercept"]);
    expect(with("origin_east_m = ", "origin_east_m = 9000"), &["chart", "km", "[chart]"]);
    expect(with("scale_m = ", "scale_m = -"), &["scale_m", "1e-6"]);
    file(folder.path(), "changed.toml", b"\xff\xfe");
    expect(refused(folder.path(), &select), &["cannot read it"]);
    let replay = ["replay", "events.csv", "--model", "changed.toml", "--kernel", "matern52"];
    let both = refused(folder.path(), &replay);
    assert!(both.contains("'--model <FILE>' cannot be used with") && both.contains("--kernel"), "{both}");
}

/// The prior has even odds at the given range.
#[test]
fn a_conservative_range_has_even_odds_before_learning() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", format!("{HEADER}\n1,a,b,0,0,0,100,1\n"));
    let header = "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m";
    file(folder.path(), "links.csv", format!("{header}\n9000,0,9000,250\n9000,0,9000,500\n9000,0,9000,1000\n"));
    let prior = ["--conservative-range-m", "500", "--accept-bad-log"];
    let command =
        ["predict", "events.csv", "--links", "links.csv", "--json", "--accept-bad-log", "--model", "model.toml"];
    let p = |more: &[&str]| {
        learn(folder.path(), &[&prior[..], more].concat(), "model.toml");
        let result = json(folder.path(), &command);
        [0, 1, 2].map(|n: usize| result["predictions"][n]["probability"].as_f64().unwrap())
    };
    let [near, there, far] = p(&[]);
    assert!(near > 0.7 && (there - 0.5).abs() < 0.1 && far < 0.2, "{near} {there} {far}");
    let [steep, _, _] = p(&["--conservative-slope-per-km", "20"]);
    assert!(steep > near, "{steep} {near}");
    refused(folder.path(), &[&["learn", "events.csv"], &prior[..], &["--prior-mean", "zero"]].concat());
    refused(folder.path(), &["replay", "events.csv", "--conservative-slope-per-km", "20"]);
}

#[test]
fn uninformative_events_keep_parameters_near_the_prior() {
    let folder = tempfile::tempdir().unwrap();
    let one_place = "1,a,b,0,0,300,400,1\n2,a,b,0,0,300,400,0\n".repeat(10);
    let one_class = (0..20).map(|n| format!("{n},a,b,{},0,{},400,1\n", 30 * n, 10 * n)).collect::<String>();
    for (rows, warning) in [(one_place, "only 1 distinct links"), (one_class, "no event is a miss (120 heard)")] {
        // The warning about links needs many events.
        file(folder.path(), "events.csv", format!("{HEADER}\n{}", rows.repeat(6)));
        let learn = ["learn", "events.csv", "--kernel", "matern32", "--inputs", "link", "--json", "--accept-bad-log"];
        let learn = [&learn[..], &["--overwrite"]].concat();
        let output = pingmap(folder.path(), &learn);
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(stderr(&output).contains(warning), "{warning}: {}", stderr(&output));
        let result: Value = serde_json::from_slice(&output.stdout).unwrap();
        for candidate in result["candidates"].as_array().unwrap() {
            for term in candidate["kernel"]["terms"].as_array().unwrap() {
                for length_scale in term["length_scales_m"].as_array().unwrap() {
                    assert!((20.0..20_000.0).contains(&length_scale.as_f64().unwrap()), "{candidate}");
                }
                assert!((0.05..500.0).contains(&term["variance"].as_f64().unwrap()), "{candidate}");
            }
        }
    }
}

#[test]
fn replay_learns_pooled_models_own_models_or_both() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 120));
    let run = |learn: &str| {
        json(folder.path(), &["replay", "events.csv", "--frames", "2", "--repeats", "2", "--json", "--learn", learn])
    };
    let (pooled, own, both) = (run("pooled"), run("own"), run("both"));
    assert_eq!((&pooled["learn"], &own["learn"]), (&"pooled".into(), &"own".into()));
    assert_ne!(pooled["scores"]["own"], own["scores"]["own"]);
    assert_eq!(both["scores"], pooled["scores"]);
    assert_eq!(both["own_learning"]["scores"]["own"], own["scores"]["own"]);
    assert_eq!(both["own_learning"]["sharing"][0]["team"], own["sharing"][0]["team"]);
    let text = stdout(&pingmap(
        folder.path(),
        &["replay", "events.csv", "--frames", "2", "--repeats", "2", "--learn", "both"],
    ));
    assert!(text.contains("model learned from") && text.contains("every vehicle, NLL"), "{text}");
}

#[test]
fn learning_does_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let one = learned(folder.path(), &["--threads", "1"]);
    assert_eq!(one, learned(folder.path(), &["--threads", "3"]));
}

#[test]
fn the_model_file_contains_the_number_of_events_used() {
    let folder = tempfile::tempdir().unwrap();
    let text = learned(folder.path(), &["--learn-events-max", "50"]);
    assert!(text.contains("events = 120\nevents_used = 50"), "{text}");
}

#[test]
fn a_site_prior_improves_predictions_of_the_next_mission() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let all = log(&["a", "b"], 240);
    let lines: Vec<&str> = all.lines().skip(1).collect();
    let part = |lines: &[&str]| format!("{HEADER}\n{}\n", lines.join("\n"));
    file(folder, "first.csv", part(&lines[..120]));
    file(folder, "second.csv", part(&lines[120..180]));
    file(folder, "third.csv", part(&lines[180..]));
    let run = |arguments: &str| pingmap(folder, &arguments.split(' ').collect::<Vec<_>>());
    let succeeded = |arguments: &str| {
        let output = run(arguments);
        assert!(output.status.success(), "{arguments}: {}", stderr(&output));
        stderr(&output)
    };
    succeeded("learn first.csv -o model.toml");
    succeeded("learn first.csv --site-prior 24 -o site.toml");
    let added = json(
        folder,
        &"learn second.csv --site-prior 24 --update site.toml -o both.toml --json".split(' ').collect::<Vec<_>>(),
    );
    assert_eq!((added["events"].as_u64(), added["site_points"].as_u64()), (Some(60), Some(24)));
    assert!(succeeded("learn first.csv --site-prior 24 --update site.toml -o twice.toml").contains("counts twice"));
    // The site prior lowers the NLL of the next mission, from a model file and from a team file.
    let nll = |how: &str| {
        let command = format!("replay third.csv --online {how} --json");
        let result = json(folder, &command.split(' ').collect::<Vec<_>>());
        (result["nll"]["own"].as_f64().unwrap(), result["model_has_seen_log"].as_bool().unwrap())
    };
    let [without, with, both] = ["model", "site", "both"].map(|name| nll(&format!("--model {name}.toml")).0);
    assert!(with < without - 0.02 && both < with + 0.01, "{without} {with} {both}");
    succeeded("team third.csv --model both.toml -o team.toml");
    assert_eq!(nll("--team team.toml"), (both, false));
    // Results on the training log of a site prior are marked.
    let seen = json(folder, &"replay second.csv --online --model both.toml --json".split(' ').collect::<Vec<_>>());
    assert_eq!(seen["model_has_seen_log"], true);
    assert!(succeeded("map --events second.csv --model both.toml --at 0,0 -o map.csv").contains("counts twice"));
    assert!(!succeeded("map --events third.csv --model both.toml --at 0,0 -o third-map.csv").contains("counts twice"));
    assert!(refused(folder, &["learn", "second.csv", "--update", "site.toml"]).contains("--site-prior"));
    assert!(refused(folder, &["learn", "second.csv", "--site-prior", "0"]).contains("from 1 to 256"));
}
