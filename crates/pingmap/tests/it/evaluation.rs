//! Evaluation: splits, paired differences with errors, calibration, and models that have seen the log.

use crate::common::*;
use serde_json::Value;
use std::path::Path;

const QUICK: [&str; 5] = ["replay", "events.csv", "--frames", "1", "--json"];

fn replay(folder: &Path, more: &[&str]) -> Value {
    json(folder, &[&QUICK, more].concat())
}

fn nll(result: &Value, score: &str) -> f64 {
    result["scores"][score]["nll"].as_f64().unwrap()
}

#[test]
fn written_splits_give_the_same_scores() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    file(folder, "events.csv", log(&["a", "b", "c"], 90));
    let mut scores = Vec::new();
    for (by, splits, held_out) in [("random", 2, 31), ("time", 2, 32), ("range", 1, 36), ("vehicle", 3, 30)] {
        let repeats: &[&str] = if splits == 2 { &["--repeats", "2"] } else { &[] };
        let result =
            replay(folder, &[&["--split-by", by, "--write-splits", "splits.csv", "--overwrite"], repeats].concat());
        let again = replay(folder, &["--splits", "splits.csv"]);
        assert_eq!(result["splits"], splits, "{by}");
        let found = result["per_split"][0]["held_out_events"].as_u64().unwrap();
        assert!(found.abs_diff(held_out) <= 3, "{by}: {found}");
        assert_eq!(result["scores"], again["scores"], "{by}");
        scores.push(nll(&result, "centralised"));
    }
    assert!(scores.windows(2).all(|pair| pair[0] != pair[1]), "{scores:?}");
    // The name of a vehicle, and so of a split, may need quotes.
    let named = log(&["a", "b"], 60).replace(",a,", ",\"a,1\",");
    file(folder, "events.csv", named);
    let result = replay(folder, &["--split-by", "vehicle", "--write-splits", "splits.csv", "--overwrite"]);
    assert_eq!(result["per_split"][0]["name"], "a,1");
    assert_eq!(replay(folder, &["--splits", "splits.csv"])["scores"], result["scores"]);
}

#[test]
fn contradictory_options_of_splits_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 20));
    let refused = |more: &[&str], expected: &str| {
        let output = pingmap(folder.path(), &[&QUICK, more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(stderr(&output).contains(expected), "{more:?}: {}", stderr(&output));
    };
    refused(&["--split-by", "range", "--repeats", "3"], "--repeats has no effect");
    refused(&["--split-by", "vehicle", "--repeats", "3"], "--repeats has no effect");
    refused(&["--split-by", "vehicle", "--test-share", "0.3"], "--test-share has no effect");
    refused(&["--split-by", "time", "--whole-transmissions"], "blocks of time always do so");
    refused(&["--split-by", "range", "--whole-transmissions"], "receiver cannot");
    refused(&["--split-by", "weather"], "possible values: random, time, range, vehicle");
    file(
        folder.path(),
        "events.csv",
        log(&["a", "b"], 20).lines().filter(|l| !l.contains(",b,a,")).collect::<Vec<_>>().join("\n"),
    );
    refused(&["--split-by", "vehicle"], "only one vehicle");
}

#[test]
fn a_training_log_of_the_model_is_recognised() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (events, other) = (log(&["a", "b"], 60), log(&["a", "b"], 61));
    file(folder, "events.csv", &events);
    // Only a part of it is learned from.
    assert!(pingmap(folder, &["learn", "events.csv", "--learn-events-max", "30"]).status.success());
    assert!(pingmap(folder, &["team", "events.csv"]).status.success());
    let digest = |name| {
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        let line = text.lines().find(|line| line.starts_with("log_digest")).unwrap().to_owned();
        assert_eq!(line.len(), "log_digest = \"\"".len() + 32, "{line}");
        line
    };
    assert_eq!(digest("model.toml"), digest("team.toml"));
    // The name, the order of rows and additional columns do not change the digest of a log.
    let mut lines: Vec<String> = events.lines().skip(1).map(|line| format!("{line},0.5")).collect();
    lines.reverse();
    file(folder, "again.csv", format!("{HEADER},true_probability\n{}\n", lines.join("\n")));
    file(folder, "other.csv", other);
    for (log, known) in [("events.csv", true), ("again.csv", true), ("other.csv", false)] {
        for agreed in [["--model", "model.toml"], ["--team", "team.toml"]] {
            for way in [&["--frames", "1"][..], &["--online"]] {
                let output = pingmap(folder, &[&["replay", log], &agreed[..], way].concat());
                let loud = "LEARNED FROM THIS LOG";
                assert_eq!(stderr(&output).contains(loud), known, "{log} {agreed:?} {way:?}: {}", stderr(&output));
                assert_eq!(stdout(&output).contains(loud), known, "{log} {agreed:?} {way:?}: {}", stdout(&output));
            }
            let result = json(folder, &["replay", log, agreed[0], agreed[1], "--frames", "1", "--json"]);
            assert_eq!(result["model_has_seen_log"], known, "{log} {agreed:?}");
        }
    }
    assert_eq!(replay(folder, &[])["model_has_seen_log"], false);
}

#[test]
fn differences_are_paired_and_an_indistinguishable_gap_has_no_closed_share() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Each of the two vehicles alone has little information about the links of the other.
    let truth: String = log(&["a", "b"], 160)
        .lines()
        .skip(1)
        .map(|line| format!("{line},{}\n", if line.ends_with('1') { "0.9" } else { "0.1" }))
        .collect();
    file(folder, "events.csv", format!("{HEADER},true_probability\n{truth}"));
    let result = replay(folder, &["--repeats", "10"]);
    let (sharing, scores) = (&result["sharing"][0], &result["scores"]);
    let number = |value: &Value| value.as_f64().unwrap_or_else(|| panic!("{value} in {result}"));
    let team = number(&sharing["team"]["nll"]);
    assert!((number(&sharing["better_than_own"]["nll"]) - (nll(&result, "own") - team)).abs() < 1e-12);
    assert!((number(&sharing["worse_than_centralised"]["nll"]) - (team - nll(&result, "centralised"))).abs() < 1e-12);
    assert!((number(&scores["gap"]["nll"]) - (nll(&result, "own") - nll(&result, "centralised"))).abs() < 1e-12);
    // The closed share is null exactly if the gap is indistinguishable from zero.
    assert_eq!(sharing["gap_closed"].is_null(), scores["gap"]["indistinguishable"].as_bool().unwrap());
    for score in [&scores["own"], &scores["base_rate"], &sharing["team"]] {
        for key in ["brier", "brier_se", "regret", "regret_se", "nll_se"] {
            assert!(number(&score[key]) >= 0.0, "{key}");
        }
    }
    assert_eq!(number(&scores["true_probability"]["regret"]), 0.0);
    assert!(number(&scores["base_rate"]["regret"]) > number(&scores["own"]["regret"]));
    // The bins contain every held-out event of every vehicle.
    let calibration = &replay(folder, &["--repeats", "2", "--calibration"])["calibration"];
    for (who, vehicles) in [("own", 2), ("team", 2), ("centralised", 1)] {
        let bins = calibration[who]["bins"].as_array().unwrap();
        let counted: u64 = bins.iter().map(|bin| bin["events"].as_u64().unwrap()).sum();
        assert_eq!(counted, 2 * vehicles * 56, "{who}");
        for key in ["expected_error", "coverage_50", "coverage_90"] {
            assert!((0.0..=1.0).contains(&number(&calibration[who][key])), "{who} {key}");
        }
    }
    assert!(number(&calibration["median_variance_ratio"]) > 0.3);
    // A single split has no standard error, so every difference is indistinguishable.
    let single = replay(folder, &["--repeats", "1"]);
    assert!(single["sharing"][0]["gap_closed"].is_null() && single["scores"]["own"]["nll_se"].is_null());
    assert_eq!(single["scores"]["gap"]["indistinguishable"], true);
}

#[test]
fn every_split_is_listed_with_its_terms_excluded_members_and_scores() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    file(folder, "events.csv", log(&["a", "b", "c"], 90));
    let splits = replay(folder, &["--repeats", "3"])["per_split"].as_array().unwrap().clone();
    let output = pingmap(folder, &[&QUICK[..QUICK.len() - 1], &["--repeats", "3"]].concat());
    let text = stdout(&output);
    for split in &splits {
        let nll = ["distance_only", "own", "centralised"].map(|name| split["nll"][name].as_f64().unwrap());
        let terms = split["structure"].as_str().unwrap().split(", ").nth(3).unwrap();
        let name = split["name"].as_str().unwrap();
        let line = text.lines().find(|line| line.split_whitespace().next() == Some(name)).unwrap();
        let expected = [terms.to_owned(), "none".to_owned()].into_iter().chain(nll.map(|nll| format!("{nll:.4}")));
        expected.for_each(|part| assert!(line.contains(&part), "{part}: {line}"));
    }
    assert_eq!(splits.len(), 3);
}

#[test]
fn a_mission_in_the_order_of_time_reports_the_weight_of_a_given_model() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    file(folder, "events.csv", log(&["a", "b", "c"], 90));
    assert!(pingmap(folder, &["learn", "events.csv", "-o", "model.toml"]).status.success());
    let online = |more: &[&str]| json(folder, &[&["replay", "events.csv", "--online", "--json"], more].concat());
    let given = online(&["--model", "model.toml"]);
    let weights = given["model_weights"].as_object().unwrap();
    assert_eq!(weights.keys().collect::<Vec<_>>(), ["a", "b", "c"]);
    assert!(weights.values().all(|weight| (0.0..=1.0).contains(&weight.as_f64().unwrap())), "{weights:?}");
    assert!(online(&[])["model_weights"].as_object().unwrap().is_empty());
    let text = pingmap(folder, &["replay", "events.csv", "--online", "--model", "model.toml"]);
    let text = stdout(&text);
    assert!(text.contains("mean final weight of the model is") && text.contains("own events 1 to 50"), "{text}");
    assert_ne!(given["nll"]["range_only"], given["nll"]["own"]);
}
