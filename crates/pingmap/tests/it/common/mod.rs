//! Runs the program, and writes logs for it.

#[cfg(unix)]
pub mod browser;
pub mod chromium;
pub mod mission;
pub mod tables;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

pub const HEADER: &str = "time_s,tx_id,rx_id,tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m,success";

/// Runs `pingmap` in a folder.
pub fn pingmap(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pingmap"));
    command.current_dir(folder).args(arguments).output().expect("the program can be started")
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("text on standard output")
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("text on standard error")
}

/// Runs `pingmap`, which must succeed, and parses the one JSON object that it prints.
pub fn json(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    let output = pingmap(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    serde_json::from_str(&stdout(&output)).expect("one JSON object on standard output")
}

/// Removes the command line from a JSON object.
pub fn without_command(message: String) -> String {
    match serde_json::from_str::<serde_json::Value>(&message) {
        Ok(mut object) => {
            object.as_object_mut().map(|object| object.remove("command"));
            serde_json::to_string_pretty(&object).expect("it is JSON")
        }
        Err(_) => message,
    }
}

/// Options of learning that make it fast: one structure without optional terms.
pub const QUICK: &[&str] = &["--terms", "path", "--additions", "none", "--kernel", "matern32", "--inputs", "link"];

/// Learns a model of `events.csv` with these options, and writes it to a file.
pub fn learn(folder: &Path, options: &[&str], model: &str) {
    let output = pingmap(folder, &[&["learn", "events.csv", "--overwrite", "-o", model], options].concat());
    assert!(output.status.success(), "{options:?}: {}", stderr(&output));
}

/// Writes a file to a folder and returns its path.
pub fn file(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).expect("the folder can be written to");
    path
}

/// Returns a log of `count` events between the named vehicles on two crossing tracks: received within 500 m, missed
/// beyond.
pub fn log(vehicles: &[&str], count: usize) -> String {
    let mut text = format!("{HEADER}\n");
    for n in 0..count {
        let (tx, rx) =
            (n % vehicles.len(), (n + 1 + n / vehicles.len() % (vehicles.len() - 1).max(1)) % vehicles.len());
        let along = (n * 37 % 101) as f64 * 10.0;
        let (tx_east, rx_north) = (along, (n * 53 % 97) as f64 * 10.0);
        let range = (tx_east - 500.0).hypot(rx_north - 200.0);
        let success = u8::from(range < 500.0);
        let (tx, rx) = (vehicles[tx], vehicles[rx]);
        writeln!(text, "{n},{tx},{rx},{tx_east},200,500,{rx_north},{success}").expect("writing to a String");
    }
    text
}

/// Returns the path of a file in the shared data folder, or prints that the test is skipped.
pub fn shared_data(file: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("PINGMAP_SHARED") else {
        // The test harness hides the output of the macros.
        let message = format!("skipped: PINGMAP_SHARED is not set, so there is no {file}\n");
        std::io::stderr().write_all(message.as_bytes()).expect("standard error can be written to");
        return None;
    };
    let path = Path::new(&root).join("data").join(file);
    assert!(path.exists(), "PINGMAP_SHARED is set, but {} does not exist", path.display());
    Some(path)
}

/// Returns the results of GDAL, PROJ and the KML schema for these files, by `geo.py`. Prints that the check is skipped
/// without a Python installation that has them; `.ci/run` makes one.
pub fn opened_by_others(folder: &Path, names: &[&str]) -> Option<serde_json::Value> {
    let Some(python) = std::env::var_os("PINGMAP_GEO_PYTHON") else {
        let message =
            format!("skipped: PINGMAP_GEO_PYTHON is not set, so no other program opens {}\n", names.join(", "));
        std::io::stderr().write_all(message.as_bytes()).expect("standard error can be written to");
        return None;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/geo.py");
    let output = Command::new(python).arg(script).args(names).current_dir(folder).output().expect("Python runs");
    assert!(output.status.success(), "{names:?}: {}", stderr(&output));
    Some(serde_json::from_str(&stdout(&output)).expect("one JSON object"))
}

/// Returns the log of a field trial, and writes two of its ten splits to `splits.csv` of a folder to save time.
pub fn two_splits(folder: &Path, trial: &str) -> Option<String> {
    let events = shared_data(&format!("trials/{trial}.csv"))?;
    let splits = std::fs::read_to_string(shared_data(&format!("trials/{trial}.splits.csv"))?).expect("splits are text");
    let two = splits.lines().map(|line| line.splitn(3, ',').take(2).collect::<Vec<_>>().join(",") + "\n");
    file(folder, "splits.csv", two.collect::<String>());
    Some(events.to_str().expect("a path in UTF-8").to_owned())
}
