//! The program of Chromium, if the machine has one.

use std::io::Write;
use std::process::Command;

/// Switches of a Chromium without a window, which connects to nothing by itself.
pub const HEADLESS: [&str; 8] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
];

/// Returns the program of Chromium, or prints that the test is skipped.
pub fn chromium() -> Option<&'static str> {
    let is_present = |name: &&str| Command::new(name).arg("--version").output().is_ok();
    let found = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(is_present);
    if found.is_none() {
        std::io::stderr().write_all(b"skipped: there is no Chromium\n").unwrap();
    }
    found
}
