//! Invalid input: exit status 2, a message with the position and the expected value, no output and no file.

use crate::common::{HEADER, file, log, pingmap, stderr, stdout};
use std::path::Path;

/// Every command that reads an event log, on `events.csv`.
const COMMANDS: [&[&str]; 4] = [
    &["replay", "events.csv"],
    &["predict", "events.csv", "--links", "links.csv", "-o", "result"],
    &["map", "events.csv", "--at", "0,0", "-o", "result.png"],
    &["select", "events.csv", "--vehicle", "a"],
];

/// Asserts that all commands refuse a log with a message that contains all of `expected`.
fn refused(content: impl AsRef<[u8]>, expected: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", content);
    file(folder.path(), "links.csv", "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n0,0,1,1\n");
    for command in COMMANDS {
        refused_command(folder.path(), command, expected);
        let files = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(files, 2, "{command:?} left a file behind");
    }
}

fn refused_command(folder: &Path, command: &[&str], expected: &[&str]) {
    let output = pingmap(folder, command);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{command:?}: {message}");
    assert_eq!(stdout(&output), "", "{command:?}");
    assert!(!message.contains("panicked"), "{command:?}: {message}");
    for expected in expected {
        assert!(message.contains(expected), "{command:?} should say {expected:?}: {message}");
    }
}

/// A log with one good line and one other line.
fn with_line(line: &str) -> String {
    format!("{HEADER}\n1,a,b,0,0,1,1,1\n{line}\n")
}

#[test]
fn a_missing_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for command in COMMANDS {
        let output = pingmap(folder.path(), command);
        assert_eq!(output.status.code(), Some(2), "{command:?}");
        let message = stderr(&output);
        assert!(message.contains("events.csv") || message.contains("links.csv"), "{message}");
        assert!(message.contains("cannot be read"), "{message}");
    }
}

#[test]
fn a_folder_is_refused_as_a_log() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("events.csv")).unwrap();
    refused_command(folder.path(), &["replay", "events.csv"], &["events.csv", "cannot be read"]);
}

#[test]
fn a_wrong_header_is_refused() {
    refused("when,who,what\n1,a,b\n", &["events.csv", "line 1", "time_s", "success", "found when,who,what"]);
    let without_success = HEADER.replace(",success", "");
    refused(format!("{without_success}\n1,a,b,0,0,1,1\n"), &["lacks the column success", "pingmap import --events"]);
    refused(format!("{HEADER},success\n1,a,b,0,0,1,1,1,1\n"), &["success", "more than once"]);
}

#[test]
fn text_in_a_number_column_is_refused() {
    refused(with_line("2,a,b,0,zero,1,1,1"), &["events.csv", "line 3", "tx_northing_m", "\"zero\"", "a finite number"]);
    refused(with_line("noon,a,b,0,0,1,1,1"), &["line 3", "time_s", "\"noon\""]);
}

#[test]
fn a_refused_table_of_events_is_read_by_the_command_in_the_message() {
    let folder = tempfile::tempdir().unwrap();
    let rows: String = (0..60)
        .map(|n| {
            let (minute, heard) = (n % 60, if n % 3 == 0 { "no" } else { "yes" });
            format!("2026-05-04T10:{minute:02}:00Z,a,b,41.5,-70.6,41.5{n:02},-70.6,{heard}\n")
        })
        .collect();
    let header = "time,sender,receiver,tx_latitude,tx_longitude,rx_latitude,rx_longitude,success\n";
    std::fs::write(folder.path().join("events.csv"), header.to_owned() + &rows).unwrap();
    refused_command(folder.path(), &["check", "events.csv"], &["lacks the columns", "pingmap import --events"]);
    let read = pingmap(folder.path(), &["import", "--events", "events.csv", "-o", "read.csv"]);
    assert!(read.status.success(), "{}", stderr(&read));
    let checked = pingmap(folder.path(), &["check", "read.csv"]);
    assert!(checked.status.success(), "{}", stderr(&checked));
}

#[test]
fn nan_and_infinity_are_refused() {
    for bad in ["NaN", "inf", "-inf", "1e999", "1e200"] {
        refused(with_line(&format!("2,a,b,0,0,{bad},1,1")), &["line 3", "rx_easting_m", bad, "a finite number"]);
    }
}

#[test]
fn a_success_other_than_0_or_1_is_refused() {
    for bad in ["2", "maybe", "-1", "0.5", ""] {
        refused(with_line(&format!("2,a,b,0,0,1,1,{bad}")), &["line 3", "column success", bad, "0 or 1"]);
    }
}

#[test]
fn an_empty_or_unprintable_vehicle_name_is_refused() {
    refused(with_line("2,a,,0,0,1,1,1"), &["line 3", "rx_id", "the name of a vehicle"]);
    refused(with_line("2,a\u{1b}[2J,b,0,0,1,1,1"), &["line 3", "tx_id", "without control characters"]);
}

#[test]
fn a_probability_out_of_range_is_refused() {
    let content = format!("{HEADER},true_probability\n1,a,b,0,0,1,1,1,1.5\n");
    refused(content, &["line 2", "true_probability", "1.5", "from 0 to 1"]);
}

#[test]
fn rows_with_a_wrong_number_of_fields_are_refused() {
    refused(with_line("2,a,b,0,0,1,1"), &["events.csv", "line 3", "7 fields", "expected 8"]);
    refused(with_line("2,a,b,0,0,1,1,1,extra"), &["line 3", "9 fields", "expected 8"]);
}

#[test]
fn a_log_without_events_is_refused() {
    refused(format!("{HEADER}\n"), &["events.csv", "no events", "at least one line"]);
    refused("", &["events.csv", "line 1", "time_s"]);
}

#[test]
fn a_binary_file_is_refused() {
    refused([0x89, b'P', b'N', b'G', 0, 0xff, 0xfe, b'\n', 0x80, 0x81], &["events.csv", "not a text file"]);
    let late = [with_line("2,a,b,0,0,1,1,1").as_bytes(), &[0xff, 0xfe, b'\n']].concat();
    refused(late, &["events.csv", "line 4", "not a text file"]);
}

#[test]
fn splits_that_do_not_match_the_log_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 4));
    let refused = |content: &str, expected: &[&str]| {
        file(folder.path(), "splits.csv", content);
        refused_command(folder.path(), &["replay", "events.csv", "--splits", "splits.csv"], expected);
    };
    refused("s0\n1\n0\n", &["splits.csv", "2 rows", "one per event of the log: 4"]);
    refused("s0\n1\n0\n2\n0\n", &["splits.csv", "line 4", "s0", "0 or 1"]);
    refused("s0\n0\n0\n0\n0\n", &["split s0", "holds out no event"]);
}

#[test]
fn options_out_of_range_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 20));
    for (options, expected) in [
        (&["--length-scale-m", "-3"][..], "above 0"),
        (&["--length-scale-m", "NaN"], "above 0"),
        (&["--length-scale-m", "1e-300"], "from 1e-6"),
        (&["--variance", "1e308"], "to 1e9"),
        (&["--threads", "100000"], "0 to 256"),
        (&["--variance", "0"], "above 0"),
        (&["--test-share", "1"], "below 1"),
        (&["--frames", "1,0"], "a whole number from 1 to 65536"),
        (&["--frames", "1000000000"], "a whole number from 1 to 65536"),
        (&["--repeats", "0"], "a whole number from 1 to 10000"),
        (&["--dense-events-max", "9223372036854775807"], "a whole number from 1 to 20000"),
        (&["--inducing-points-max", "9223372036854775807"], "a whole number from 1 to 4000"),
        (&["--events-max", "9223372036854775807"], "a whole number from 1 to 10000000"),
        (&["--learn", "magic"], "possible values"),
        (&["--frame-bytes", "31"], "from 32"),
        (&["--loss", "1.5"], "0 to 1"),
        (&["--online", "--slot-every", "0"], "a whole number from 1 to 65536"),
        (&["--online", "--piggyback-bytes", "9"], "a whole number from 1 to 8"),
    ] {
        let command = [&["replay", "events.csv"], options].concat();
        // The argument parser names the option, and the value's parser names the allowed values.
        refused_command(folder.path(), &command, &[options[options.len() - 2], expected]);
    }
}

#[test]
fn select_and_map_name_the_invalid_option() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 30));
    refused_command(
        folder.path(),
        &["select", "events.csv", "--vehicle", "z"],
        &["no events received by vehicle \"z\"", "expected one of a, b"],
    );
    let far = ["select", "events.csv", "--vehicle", "a", "--centre", "9e6,0,0,0", "--radius-m", "10"];
    refused_command(folder.path(), &far, &["no event of a lies within 10 m"]);
    // These numbers of points exceed the memory, and the largest number of bytes.
    for points in ["10000000000000", "9223372036854775807"] {
        let many = ["select", "events.csv", "--vehicle", "a", "--points", points];
        refused_command(folder.path(), &many, &["--points", "a whole number from 1 to 4000"]);
    }
    let map = ["map", "events.csv", "--at", "0,0"];
    let with = |more: &[&'static str]| [&map[..], more].concat();
    refused_command(
        folder.path(),
        &with(&["-o", "map.bmp"]),
        &["map.bmp", ".png, .svg, .pdf, .csv, .geojson, .kml or .tif"],
    );
    refused_command(folder.path(), &with(&["-o", "map.geojson"]), &["--origin"]);
    refused_command(folder.path(), &with(&["-o", "map.geojson", "--origin", "91,0"]), &["latitude"]);
    refused_command(folder.path(), &with(&["--cell-m", "0.001"]), &["--cell-m", "cells"]);
    refused_command(folder.path(), &with(&["--levels", "0.9,0.5"]), &["--levels", "rising"]);
    refused_command(folder.path(), &with(&["--levels", "1"]), &["--levels", "below 1"]);
    refused_command(folder.path(), &with(&["--bounds", "0,0,5,0"]), &["--bounds", "corners"]);
    refused_command(folder.path(), &with(&["--bounds", "0,0,5"]), &["--bounds", "corners"]);
    refused_command(folder.path(), &with(&["--depth", "5"]), &["--depth", "no depths"]);
    refused_command(folder.path(), &["map", "events.csv", "--at", "0,0,5"], &["--at", "no depths"]);
    refused_command(folder.path(), &["map", "events.csv", "--at", "41.5N,70.6W"], &["--at", "--origin"]);
    refused_command(folder.path(), &["map", "events.csv", "--at", "41.5N,70.6"], &["--at", "41.52N,70.67W"]);
    refused_command(folder.path(), &with(&["--crs", "EPSG:4326"]), &["EPSG:4326", "metres"]);
    refused_command(folder.path(), &with(&["--crs", "EPSG:32619", "--origin", "41,-70"]), &["--crs", "--origin"]);
    refused_command(folder.path(), &["map", "events.csv", "--at", "1e200,0"], &["--at", "1e200", "metres"]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a file was left behind");
}

#[test]
fn geojson_is_refused_far_from_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let line = |success| format!("1,a,b,431000,4700000,431100,4700100,{success}\n");
    file(folder.path(), "events.csv", format!("{HEADER}\n{}{}", line(0), line(1)));
    let command = ["map", "events.csv", "--at", "431000,4700000", "--origin", "42,-71", "-o", "map.geojson"];
    refused_command(folder.path(), &command, &["origin", "--crs EPSG:CODE", "UTM", "100 km"]);
}

#[test]
fn invalid_links_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 30));
    let command = ["predict", "events.csv", "--links", "links.csv"];
    let header = "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m";
    file(folder.path(), "links.csv", format!("{header}\n0,0,1,x\n"));
    refused_command(folder.path(), &command, &["links.csv", "line 2", "rx_northing_m", "\"x\""]);
    file(folder.path(), "links.csv", format!("{header}\n"));
    refused_command(folder.path(), &command, &["links.csv", "no links"]);
}

#[test]
fn an_output_that_cannot_be_written_exits_with_status_1() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 30));
    let output = pingmap(folder.path(), &["map", "events.csv", "--at", "0,0", "-o", "nowhere/map.png"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("nowhere/map.png"), "{}", stderr(&output));
}

#[test]
fn results_follow_symbolic_links_and_do_not_replace_devices() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 30));
    file(folder.path(), "links.csv", "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n0,0,1,1\n");
    let target = file(folder.path(), "target.csv", "");
    let predict = |output: &str| {
        let command = ["predict", "events.csv", "--links", "links.csv", "-o", output, "--overwrite"];
        assert!(pingmap(folder.path(), &command).status.success(), "{output}");
    };
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(&target, folder.path().join("link.csv")).unwrap();
        predict("link.csv");
        assert!(folder.path().join("link.csv").is_symlink());
        assert!(std::fs::read_to_string(&target).unwrap().contains("probability"));
        predict("/dev/null");
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }
}

/// A variance that overflows in a sum is invalid input. The error names the file and the number.
#[test]
fn models_with_overflowing_numbers_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 40));
    let model = |kernel: &str, mean: &str| {
        format!(
            "schema = 6\n[chart]\norigin_east_m = 0.0\norigin_north_m = 0.0\nscale_m = 500.0\n[prior_mean]\n{mean}\n\
             [[kernel]]\nshape = \"matern32\"\ncolumns = [\"range\"]\n{kernel}\n"
        )
    };
    let zero = "kind = \"zero\"";
    for (kernel, mean, expected) in [
        ("variance = 1e308\nlength_scale_m = 100.0", zero, "kernel variance must be"),
        ("variance = 1.0\nlength_scale_m = 1e308", zero, "length-scale must be"),
        ("variance = 1.0\nlength_scale_m = 1e-308", zero, "length-scale must be"),
        ("variance = 1.0\nlength_scale_m = 100.0", "kind = \"constant\"\nlog_odds = 1e308", "prior_mean.log_odds"),
    ] {
        file(folder.path(), "model.toml", model(kernel, mean));
        for command in [
            &["replay", "events.csv", "--model", "model.toml"][..],
            &["predict", "events.csv", "--links", "events.csv", "--model", "model.toml"],
            &["select", "events.csv", "--vehicle", "a", "--model", "model.toml"],
        ] {
            refused_command(folder.path(), command, &["model.toml", expected]);
        }
    }
    // A similar model within bounds is accepted.
    file(folder.path(), "model.toml", model("variance = 1.0\nlength_scale_m = 100.0", zero));
    let output = pingmap(folder.path(), &["select", "events.csv", "--vehicle", "a", "--model", "model.toml"]);
    assert!(output.status.success(), "{}", stderr(&output));
}

/// The time to read a header is linear in the number of columns.
#[test]
fn many_unknown_columns_give_a_short_warning() {
    let folder = tempfile::tempdir().unwrap();
    let (mut header, mut zeros) = (String::new(), String::new());
    for column in 0..80_000 {
        header += &format!(",extra{column}");
        zeros += ",0";
    }
    let narrow = log(&["a", "b"], 12);
    let wide: String = narrow
        .lines()
        .enumerate()
        .map(|(n, line)| format!("{line}{}\n", if n == 0 { &header } else { &zeros }))
        .collect();
    file(folder.path(), "events.csv", wide);
    let output = pingmap(folder.path(), &["select", "events.csv", "--vehicle", "a"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let warning = stderr(&output);
    assert!(warning.contains("extra19 and 79980 more") && warning.len() < 2000, "{} characters", warning.len());
    // A repeated column is refused as well.
    let twice = narrow.replacen("success", "success,extra,extra", 1);
    file(folder.path(), "events.csv", twice);
    refused_command(folder.path(), &["replay", "events.csv"], &["extra more than once"]);
}
