//! Unusual but valid input: commands succeed, with a warning.

use crate::common::{HEADER, file, json, log, pingmap, stderr, stdout};
use serde_json::Value;
use std::fmt::Write;

/// Replays a log, asserts the warning and finite numbers, and returns the result.
fn replay(content: &str, options: &[&str], warning: &str) -> Value {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", content);
    let command = [&["replay", "events.csv", "--frames", "1,3", "--json"], options].concat();
    let output = pingmap(folder.path(), &command);
    let message = stderr(&output);
    assert!(output.status.success(), "{message}");
    assert!(message.contains(warning), "should warn of {warning:?}: {message}");
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    for score in ["base_rate", "distance_only", "own", "centralised"] {
        assert!(result["scores"][score]["nll"].as_f64().unwrap().is_finite(), "{score}: {result}");
    }
    for sharing in result["sharing"].as_array().unwrap() {
        assert!(sharing["team"]["nll"].as_f64().unwrap().is_finite(), "{result}");
    }
    result
}

#[test]
fn a_log_with_equal_outcomes_is_replayed_with_accept_bad_log() {
    for (outcome, warning) in [("1", "no event is a miss (60 heard)"), ("0", "all of 60 events are misses")] {
        let content: String =
            log(&["a", "b"], 60)
                .lines()
                .map(|line| {
                    if line == HEADER { format!("{line}\n") } else { format!("{}{outcome}\n", &line[..line.len() - 1]) }
                })
                .collect();
        let result = replay(&content, &["--accept-bad-log"], warning);
        assert!(result["scores"]["centralised"]["nll"].as_f64().unwrap() < 0.2, "{result}");
    }
}

#[test]
fn one_receiver_leaves_no_gap_to_close() {
    let mut content = format!("{HEADER}\n");
    for n in 0..80 {
        writeln!(content, "{n},shore,buoy,0,0,{},0,{}", n * 10, u8::from(n < 40)).unwrap();
    }
    let result = replay(&content, &[], "buoy is the only receiver");
    assert_eq!(result["vehicles"], 1);
    assert_eq!(result["scores"]["own"], result["scores"]["centralised"]);
    assert!(result["sharing"].as_array().unwrap().iter().all(|sharing| sharing["gap_closed"].is_null()), "{result}");
}

#[test]
fn events_over_one_link_give_the_base_rate() {
    let mut content = format!("{HEADER}\n");
    for n in 0..200 {
        let (tx, rx) = if n % 2 == 0 { ("a", "b") } else { ("b", "a") };
        writeln!(content, "{n},{tx},{rx},0,0,300,400,{}", u8::from(n % 5 == 0)).unwrap();
    }
    let result = replay(&content, &[], "only 1 distinct links among 200 events");
    // Only the base rate can be learned: one event in five, 0.5 nats.
    let nll = result["scores"]["centralised"]["nll"].as_f64().unwrap();
    assert!((0.4..0.6).contains(&nll), "{nll}");
}

#[test]
fn a_vehicle_without_training_events_learns_from_the_team() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b", "c"], 60));
    let text = std::fs::read_to_string(folder.path().join("events.csv")).unwrap();
    let mut splits = "all_of_b,some\n".to_owned();
    for (n, line) in text.lines().skip(1).enumerate() {
        let received_by_b = line.split(',').nth(2) == Some("b");
        writeln!(splits, "{},{}", u8::from(received_by_b), u8::from(n % 3 == 0)).unwrap();
    }
    file(folder.path(), "splits.csv", splits);
    // With a given kernel the comparison does not depend on the search.
    let command = ["replay", "events.csv", "--splits", "splits.csv", "--frames", "2", "--json"];
    let kernel = ["--length-scale-m", "500", "--variance", "4"];
    let output = pingmap(folder.path(), &[&command[..], &kernel].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("split all_of_b: no training events for b"), "{}", stderr(&output));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    // The vehicle has no own events, so its predictions improve by the packets of others.
    let (own, team) = (&result["scores"]["own"]["nll"], &result["sharing"][0]["team"]["nll"]);
    assert!(team.as_f64() < own.as_f64(), "{result}");
}

#[test]
fn only_unknown_columns_give_a_warning() {
    let mut content = format!("success,comment,{},true_probability\n", HEADER.trim_end_matches(",success"));
    for line in log(&["a", "b"], 40).lines().skip(1) {
        let (rest, success) = line.rsplit_once(',').unwrap();
        writeln!(content, "{success},calm,{rest},0.5").unwrap();
    }
    let result = replay(&content, &[], "ignoring the column comment");
    let nll = result["scores"]["true_probability"]["nll"].as_f64().unwrap();
    assert!((nll - 2f64.ln()).abs() < 1e-12, "{nll}");
}

#[test]
fn depths_add_two_inputs() {
    let mut content = format!("{HEADER},tx_depth_m,rx_depth_m\n");
    log(&["a", "b"], 40)
        .lines()
        .skip(1)
        .enumerate()
        .for_each(|(n, line)| writeln!(content, "{line},{},{n}", 40 - n).unwrap());
    let result = replay(&content, &[], "");
    assert_eq!(result["kernel"]["inputs"], "positions and depths");
}

#[test]
fn a_byte_order_mark_blank_lines_and_windows_line_ends_are_accepted() {
    let content = format!("\u{feff}{}", log(&["a", "b"], 40).replace('\n', "\r\n\r\n"));
    assert_eq!(replay(&content, &[], "")["events"], 40);
}

#[test]
fn a_warning_gives_the_number_of_events_used() {
    let result = replay(&log(&["a", "b"], 400), &["--events-max", "100"], "using 100 of 400 events");
    assert_eq!((&result["events"], &result["events_used"]), (&Value::from(400), &Value::from(100)));
}

#[test]
fn sparse_fits_are_named_and_close_to_dense_fits() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 300));
    let run = |options: &[&str]| {
        let fixed = ["replay", "events.csv", "--frames", "1", "--json", "--length-scale-m", "300", "--variance", "4"];
        json(folder.path(), &[&fixed, options].concat())
    };
    let (dense, sparse) = (run(&[]), run(&["--dense-events-max", "20", "--inducing-points-max", "100"]));
    assert_eq!(dense["inference"]["own"], "dense mean field");
    assert_eq!(sparse["inference"]["own"], "sparse mean field");
    for score in ["own", "centralised"] {
        let nll = |result: &Value| result["scores"][score]["nll"].as_f64().unwrap();
        assert!((nll(&dense) - nll(&sparse)).abs() < 0.005, "{score}: {} against {}", nll(&dense), nll(&sparse));
    }
}

#[test]
#[ignore = "takes a minute; .ci/full runs it"]
fn a_million_events_are_thinned_and_replayed() {
    let mut content = format!("{HEADER}\n");
    for n in 0..1_000_000_u64 {
        let (tx, rx) = if n % 2 == 0 { ("a", "b") } else { ("b", "a") };
        let (east, north) = (n * 7919 % 2003, n * 104_729 % 1999);
        writeln!(content, "{n},{tx},{rx},{east},0,0,{north},{}", u8::from(east + north < 1500)).unwrap();
    }
    let options = ["--events-max", "2000", "--repeats", "1", "--length-scale-m", "500", "--variance", "4"];
    let result = replay(&content, &options, "using 2000 of 1000000 events");
    assert_eq!(result["events"], 1_000_000);
    let nll = |score: &str| result["scores"][score]["nll"].as_f64().unwrap();
    assert!(nll("centralised") < 0.7 * nll("base_rate"), "{result}");
}

#[test]
fn a_split_without_training_events_gives_even_odds() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "splits.csv", format!("s0\n{}", "1\n".repeat(30)));
    let splits = folder.path().join("splits.csv");
    let options = ["--splits", splits.to_str().unwrap(), "--prior-mean", "zero"];
    let result = replay(&log(&["a", "b"], 30), &options, "split s0: every event is held out");
    assert!((result["scores"]["own"]["nll"].as_f64().unwrap() - 2f64.ln()).abs() < 1e-12, "{result}");
}

#[test]
fn shifted_coordinates_give_the_same_scores() {
    let near = log(&["a", "b"], 60);
    let far: String = near
        .lines()
        .enumerate()
        .map(|(n, line)| {
            let shift = |(column, field): (usize, &str)| match (n, column) {
                (1.., 3 | 5) => format!("{}", field.parse::<f64>().unwrap() + 431_000.0),
                (1.., 4 | 6) => format!("{}", field.parse::<f64>().unwrap() + 4_700_000.0),
                _ => field.to_owned(),
            };
            line.split(',').enumerate().map(shift).collect::<Vec<_>>().join(",") + "\n"
        })
        .collect();
    let nll = |content: &str| replay(content, &[], "")["scores"]["centralised"]["nll"].as_f64().unwrap();
    assert!((nll(&near) - nll(&far)).abs() < 1e-6);
}

#[test]
fn places_without_a_depth_are_at_the_mean_depth() {
    let folder = tempfile::tempdir().unwrap();
    let mut content = format!("{HEADER},tx_depth_m,rx_depth_m\n");
    log(&["a", "b"], 100).lines().skip(1).for_each(|line| writeln!(content, "{line},1000,1000").unwrap());
    file(folder.path(), "events.csv", &content);
    let header = "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m";
    file(folder.path(), "links.csv", format!("{header}\n500,200,500,300\n"));
    let output = pingmap(folder.path(), &["predict", "events.csv", "--links", "links.csv", "--json"]);
    assert!(stderr(&output).contains("1000.0 m, the mean depth"), "{}", stderr(&output));
    let result: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(result["predictions"][0]["probability"].as_f64().unwrap() > 0.8, "{result}");
    let centre = ["select", "events.csv", "--vehicle", "a", "--centre", "500,200,500,300", "--radius-m", "300"];
    let output = pingmap(folder.path(), &centre);
    assert!(output.status.success(), "{}", stderr(&output));
    // The depth of one end alone is ignored.
    file(folder.path(), "events.csv", content.replace(",rx_depth_m", ",note"));
    let output = pingmap(folder.path(), &["replay", "events.csv", "--frames", "1", "--repeats", "1"]);
    assert!(stderr(&output).contains("ignoring the column tx_depth_m, note"), "{}", stderr(&output));
}

/// The grid is so small that no event is within it, so no summary can be sent.
#[test]
fn a_grid_without_events_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 60));
    let run = |arguments: &[&str]| {
        let output = pingmap(folder.path(), arguments);
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        stdout(&output)
    };
    run(&["learn", "events.csv", "--terms", "path", "--prior-mean", "zero"]);
    run(&["team", "events.csv", "--cell-m", "0.01"]);
    let text = run(&["replay", "events.csv", "--team", "team.toml", "--repeats", "1", "--frames", "2", "--compare"]);
    assert!(text.contains("random points"), "{text}");
}

/// Standard output has a file name even if it is a pipe.
#[cfg(target_os = "linux")]
#[test]
fn results_are_written_to_a_pipe_by_its_name() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 60));
    let output = pingmap(folder.path(), &["map", "events.csv", "--at", "0,0", "-o", "map.csv"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let output = pingmap(folder.path(), &["simulate", "--slots", "20", "-o", "/dev/stdout", "--json"]);
    assert!(output.status.success() && stdout(&output).starts_with("time_s,"), "{}", stderr(&output));
}

/// An unknown shape is refused with the list of shapes.
#[test]
fn kernel_shapes_accept_a_parameter_after_a_colon() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 40));
    let learn = |shape: &str| {
        let fixed = ["--length-scale-m", "300", "--variance", "2", "--terms", "path", "--json"];
        pingmap(folder.path(), &[&["learn", "events.csv", "--kernel", shape][..], &fixed].concat())
    };
    let output = learn("rational-quadratic:0.5");
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stdout(&output).contains("rational-quadratic:"), "{}", stdout(&output));
    for (shape, expected) in [
        ("rational-quadratic:x", "must be a number, found \"x\""),
        ("rational-quadratic:0", "from 0.001 to 1000"),
        ("matern", "matern32"),
    ] {
        let output = learn(shape);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(expected), "{shape}: {}", stderr(&output));
    }
}

/// Returns the probabilities over links of 50, 500 and 950 m, learned from a log.
fn predicted(content: &str) -> [f64; 3] {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", content);
    let links = "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n0,500,50,500\n0,500,500,500\n0,500,950,500\n";
    file(folder.path(), "links.csv", links);
    let result = json(folder.path(), &["predict", "events.csv", "--links", "links.csv", "--json"]);
    [0, 1, 2].map(|row| result["predictions"][row]["probability"].as_f64().unwrap())
}

#[test]
fn one_miss_far_away_changes_no_prediction() {
    // Links in a square kilometre, heard up to about 500 m.
    let place = |n: usize, step: f64| 1000.0 * (n as f64 * step).fract();
    let mut content = format!("{HEADER}\n");
    for n in 0..200 {
        let [tx, rx] = [[0.618_034, 0.754_878], [0.569_84, 0.819_173]].map(|steps| steps.map(|step| place(n, step)));
        let range_m = (tx[0] - rx[0]).hypot(tx[1] - rx[1]);
        let heard = range_m < 400.0 + 200.0 * (n as f64 * 0.414_214).fract();
        writeln!(content, "{},a,b,{},{},{},{},{}", n * 10, tx[0], tx[1], rx[0], rx[1], u8::from(heard)).unwrap();
    }
    let without = predicted(&content);
    assert!(without[0] > 0.9 && without[2] < 0.1, "{without:?}");
    for (east_m, north_m) in [(3e4, 0.0), (4e5, -3e5), (1.1e7, -4.9e6)] {
        let with = predicted(&format!("{content}2000,a,b,500,500,{east_m},{north_m},0\n"));
        for (with, without) in with.iter().zip(without) {
            assert!((with - without).abs() < 0.05, "{with} and {without}, with a miss at {east_m} m");
        }
    }
}
