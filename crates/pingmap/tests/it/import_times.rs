//! Imports of records whose times deviate: late records, clocks that are set, and clocks that are wrong by a period.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{json, pingmap};

/// Returns a folder of the import crate's test data.
fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../import/tests/data").join(name)
}

/// Moves the times of some rows of a table.
fn delay_rows(table: &Path, seconds: i64, is_delayed: impl Fn(usize) -> bool) {
    let text = fs::read_to_string(table).unwrap();
    let delayed = text.lines().enumerate().map(|(row, line)| {
        let (time, rest) = line.split_once(',').unwrap();
        let Some(time_s) = pingmap_import::parse_time(time).filter(|_| row > 0 && is_delayed(row)) else {
            return format!("{line}\n");
        };
        format!("{},{rest}\n", pingmap_import::time_in_words(time_s + seconds as f64))
    });
    fs::write(table, delayed.collect::<String>()).unwrap();
}

fn heard_and_missed(imported: &serde_json::Value) -> (u64, u64) {
    let [events, heard] = ["events", "heard"].map(|key| imported[key].as_u64().unwrap());
    (heard, events - heard)
}

fn has_warning(imported: &serde_json::Value, words: &str) -> bool {
    imported["warnings"].as_array().unwrap().iter().any(|warning| warning.as_str().unwrap().contains(words))
}

#[test]
fn transmissions_that_one_vehicle_records_late_change_no_outcome() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(
        pingmap(folder, &["simulate", "--slots", "240", "--seed", "4", "--as-files", "w", "--with-sent"])
            .status
            .success()
    );
    delay_rows(&folder.join("w/auv1.sent.csv"), 5, |_| true);
    let imported = json(folder, &["import", "w", "--json"]);
    assert_eq!(heard_and_missed(&imported), (217, 142));
    assert!(has_warning(&imported, "auv1 records transmissions 5.0 s later"), "{}", imported["warnings"]);
}

#[test]
fn every_second_reception_three_seconds_late_changes_no_outcome() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("w")).unwrap();
    for file in fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/mission")).unwrap() {
        let file = file.unwrap();
        fs::copy(file.path(), folder.join("w").join(file.file_name())).unwrap();
    }
    delay_rows(&folder.join("w/auv3.heard.csv"), 3, |row| row % 2 == 0);
    let imported = json(folder, &["import", "w", "--always-transmits", "--json"]);
    assert_eq!(heard_and_missed(&imported), (202, 118));
    assert!(has_warning(&imported, "messages of auv3"), "{}", imported["warnings"]);
}

#[test]
fn a_clock_that_is_set_during_the_mission_changes_no_outcome() {
    let folder = tempfile::tempdir().unwrap();
    let imported = json(folder.path(), &["import", case("clock-step").to_str().unwrap(), "--json"]);
    assert_eq!(heard_and_missed(&imported), (132, 98));
    assert!(has_warning(&imported, "the clock of auv1 stepped by -3.0 s at about"), "{}", imported["warnings"]);
}

#[test]
fn residuals_find_an_offset_beyond_the_period_of_the_slots() {
    let folder = tempfile::tempdir().unwrap();
    let imported = json(folder.path(), &["import", case("gps-time-18s").to_str().unwrap(), "--json"]);
    let clock = &imported["clocks"][1];
    assert!((clock["segments"][0]["offset_s"].as_f64().unwrap() - 18.0).abs() < 0.01, "{clock}");
    assert!(clock["median_residual_s"].as_f64().unwrap() < 0.002, "{clock}");
    assert!(has_warning(&imported, "exceeds --clock-offset-s-max 10"), "{}", imported["warnings"]);
}

#[test]
fn a_schedule_that_does_not_fit_the_receptions_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    assert!(pingmap(folder, &["simulate", "--slots", "120", "--seed", "4", "--as-files", "w"]).status.success());
    fs::write(
        folder.join("w/schedule.toml"),
        "[slots]\nstart_s = 0\nduration_s = 3600\norder = ['auv1', 'auv2', 'auv3']\n",
    )
    .unwrap();
    let output = pingmap(folder, &["import", "w", "--always-transmits"]);
    let message = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(
        message.contains("fit no recorded transmission or slot") && message.contains("--accept-bad-log"),
        "{message}"
    );
    assert!(!folder.join("events.csv").exists());
    let accepted = json(folder, &["import", "w", "--always-transmits", "--accept-bad-log", "--json"]);
    assert_eq!(accepted["contradictions"].as_array().unwrap().len(), 1);
}
