//! Tables of a small mission with two vehicles, in degrees.

use std::path::Path;

use super::file;

/// Start of the mission, 2026-05-03T12:00:00Z, in seconds since 1970.
pub const START_S: f64 = 1_777_809_600.0;

/// Number of transmissions of the mission.
pub const TRANSMISSIONS: usize = 80;

/// Writes tables of navigation, receptions and transmissions of the vehicles ada and bob near a place. Every fourth
/// message is missed. Longitudes may exceed 180 degrees.
pub fn write_tables(folder: &Path, latitude_deg: f64, longitude_deg: f64) {
    let names = ["ada", "bob"];
    for (vehicle, name) in names.into_iter().enumerate() {
        let mut nav = String::from("time,lat,lon\n");
        let mut heard = String::from("time,source\n");
        let mut sent = String::from("time,sent\n");
        for n in 0..=2 * TRANSMISSIONS {
            let (time_s, share) = (START_S + 10.0 * n as f64, n as f64 / 160.0);
            let latitude_deg = latitude_deg + 0.004 * share;
            let longitude_deg = longitude_deg + if vehicle == 0 { 0.005 * share } else { 0.01 - 0.003 * share };
            nav += &format!("{time_s:.1},{latitude_deg:.6},{longitude_deg:.6}\n");
        }
        for n in 0..TRANSMISSIONS {
            let time_s = START_S + 20.0 * n as f64 + 5.0;
            if n % 2 == vehicle {
                sent += &format!("{time_s:.3},1\n");
            } else if n % 8 < 6 {
                heard += &format!("{:.3},{}\n", time_s + 1.0, names[n % 2]);
            }
        }
        for (kind, text) in [("nav", nav), ("heard", heard), ("sent", sent)] {
            file(folder, &format!("{name}.{kind}.csv"), text);
        }
    }
}

/// Changes each line of a table. Lines count from 0, the header.
pub fn rewrite_lines(folder: &Path, name: &str, change: impl Fn(usize, &str) -> String) {
    let text = std::fs::read_to_string(folder.join(name)).unwrap();
    file(folder, name, text.lines().enumerate().map(|(n, line)| change(n, line) + "\n").collect::<String>());
}

/// Returns the names of the six tables.
pub fn table_names() -> impl Iterator<Item = String> {
    ["ada", "bob"].into_iter().flat_map(|name| ["nav", "heard", "sent"].map(|kind| format!("{name}.{kind}.csv")))
}

/// Runs the import of the tables in the folder with further options.
fn run_import(folder: &Path, options: &[&str]) -> std::process::Output {
    let names: Vec<String> = table_names().collect();
    let mut arguments = vec!["import"];
    arguments.extend(names.iter().map(String::as_str).chain(options.iter().copied()));
    super::pingmap(folder, &arguments)
}

/// Imports the tables in the folder with further options, and returns the log `events.csv` and the messages.
pub fn import_tables(folder: &Path, options: &[&str]) -> (String, String) {
    let output = run_import(folder, &[&["--overwrite"], options].concat());
    assert!(output.status.success(), "{options:?}: {}", super::stderr(&output));
    (std::fs::read_to_string(folder.join("events.csv")).unwrap(), super::stderr(&output))
}

/// Imports the tables in the folder with further options that are refused with status 2, and returns the message.
pub fn refused_tables(folder: &Path, options: &[&str]) -> String {
    let output = run_import(folder, options);
    assert_eq!(output.status.code(), Some(2), "{options:?}: {}", super::stderr(&output));
    assert!(!folder.join("events.csv").exists());
    super::stderr(&output)
}
