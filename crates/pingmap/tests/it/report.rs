//! The report page in a browser: screens of two sizes, dark mode, print. Without Chromium the tests are skipped with a
//! message.

use std::io::Write as _;
use std::path::Path;
use std::process::Command;

use crate::common::chromium::{self, HEADLESS};
use crate::common::{file, json, log, pingmap, stderr, stdout};

/// Writes a report of a small mission, and returns its page.
fn report(folder: &Path) -> String {
    let name = "a-vehicle-with-a-rather-long-name";
    file(folder, "events.csv", log(&[name, "b", "<c>"], 150));
    // Summaries have inducing points, so the page has all its figures.
    let command = "replay events.csv --frames 1,2,5 --share summaries --repeats 2 --compare --terms path --additions none \
                   --report report";
    let output = pingmap(folder, &command.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{}", stderr(&output));
    std::fs::read_to_string(folder.join("report/index.html")).unwrap()
}

/// Returns the output of Chromium, or prints that the test is skipped.
fn chromium(folder: &Path, arguments: &[&str]) -> Option<String> {
    let program = chromium::chromium()?;
    let profile = format!("--user-data-dir={}", folder.join("profile").display());
    let mut command = Command::new(program);
    let output =
        command.args(HEADLESS).args(["--virtual-time-budget=8000", &profile]).args(arguments).output().unwrap();
    assert!(output.status.success(), "{program} {arguments:?}: {}", stderr(&output));
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// A script that measures the page in a frame: its width, the number of elements that overflow, and its colours.
const PROBE: &str = "<script>addEventListener('load', () => {
  const wide = document.documentElement.scrollWidth, room = innerWidth;
  const out = [...document.querySelectorAll('svg, p, h1, h2, table, td, figcaption')].filter(e => e.getBoundingClientRect().right > room + 1).length;
  const inner = [...document.querySelectorAll('table')].filter(e => e.scrollWidth > e.parentElement.clientWidth + 1).length;
  const style = getComputedStyle(document.body);
  parent.postMessage([wide, room, out, inner, style.backgroundColor, style.color].join(';'), '*');
});</script>";

/// Returns the measurements of the page in a frame of this width. They are the widths of the page and of the frame,
/// the number of elements that overflow, the number of tables that are wider than the page, and two colours.
fn measured(folder: &Path, page: &str, width: u32, more: &[&str]) -> Option<Vec<String>> {
    file(folder, "probe.html", page.replace("</body>", &format!("{PROBE}</body>")));
    let frame = format!(
        "<!DOCTYPE html><meta name=\"color-scheme\" content=\"light dark\"><body><script>addEventListener('message', e => document.body.dataset.message = e.data);</script>\
         <iframe src=\"probe.html\" width=\"{width}\" height=\"900\" style=\"border:0\"></iframe></body>"
    );
    let path = file(folder, "frame.html", frame);
    let url = format!("file://{}", path.display());
    let dom = chromium(folder, &[more, &["--window-size=1600,1000", "--dump-dom", &url]].concat())?;
    let message = dom.split("data-message=\"").nth(1).unwrap_or_else(|| panic!("nothing was measured: {dom}"));
    Some(message.split('"').next().unwrap().split(';').map(str::to_owned).collect())
}

#[test]
fn the_page_fits_desktop_and_telephone_screens() {
    let folder = tempfile::tempdir().unwrap();
    let page = report(folder.path());
    for width in [1280, 980, 700, 400] {
        let Some(message) = measured(folder.path(), &page, width, &[]) else { return };
        assert_eq!(
            (message[0].as_str(), message[1].as_str()),
            (&*width.to_string(), &*width.to_string()),
            "{message:?}"
        );
        assert_eq!(message[2], "0", "something sticks out of {width} pixels");
        assert_eq!(message[3], "0", "a table is wider than {width} pixels");
        assert_eq!(message[4], "rgb(255, 255, 255)");
    }
}

#[test]
fn the_page_has_a_dark_mode() {
    let folder = tempfile::tempdir().unwrap();
    let page = report(folder.path());
    let dark = ["--blink-settings=preferredColorScheme=0"];
    let Some(message) = measured(folder.path(), &page, 800, &dark) else { return };
    assert_eq!((message[4].as_str(), message[5].as_str()), ("rgb(21, 24, 28)", "rgb(228, 228, 228)"), "{message:?}");
    let shot = format!("--screenshot={}", folder.path().join("dark.png").display());
    let url = format!("file://{}", folder.path().join("report/index.html").display());
    chromium(folder.path(), &[dark[0], "--window-size=800,1200", &shot, &url]);
    assert!(std::fs::read(folder.path().join("dark.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn the_page_prints_on_a_few_sheets() {
    let folder = tempfile::tempdir().unwrap();
    report(folder.path());
    let pdf = format!("--print-to-pdf={}", folder.path().join("report.pdf").display());
    let url = format!("file://{}", folder.path().join("report/index.html").display());
    if chromium(folder.path(), &[&pdf, "--no-pdf-header-footer", &url]).is_none() {
        return;
    }
    let bytes = std::fs::read(folder.path().join("report.pdf")).unwrap();
    assert!(bytes.starts_with(b"%PDF") && bytes.len() > 50_000);
    let path = folder.path().join("report.pdf");
    let Ok(output) = Command::new("pdftotext").args(["-layout", path.to_str().unwrap(), "-"]).output() else {
        std::io::stderr().write_all(b"skipped: there is no pdftotext\n").unwrap();
        return;
    };
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    for message in ["distance alone is right", "Provenance", "not known", "probability", "--compare"] {
        assert!(text.contains(message), "no {message:?} on paper: {text}");
    }
    let pages = text.matches('\u{c}').count();
    assert!((3..=14).contains(&pages), "{pages} pages");
}

#[test]
fn the_report_contains_conclusions_and_provenance() {
    let folder = tempfile::tempdir().unwrap();
    let page = report(folder.path());
    for message in [
        "distance alone is right in ",
        "&lt;c&gt;",
        "events.csv",
        "pingmap replay events.csv --frames 1,2,5",
        "perfect calibration",
        "predicted by the maps",
        "<th scope=\"col\">share heard</th>",
        "The map of b",
    ] {
        assert!(page.contains(message), "no {message:?}");
    }
    assert_eq!(page.matches("<svg").count(), 6, "three maps, calibration, success rate over range, inducing points");
    assert_eq!(page.matches("viewBox").count(), 6);
    assert!(
        !page.contains("src=\"") && !page.contains("<c>"),
        "the page needs nothing beside it, and names are no markup"
    );
    // Names within pictures are theirs alone.
    let ids: Vec<&str> = page.split(" id=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    let unique: std::collections::BTreeSet<&&str> = ids.iter().collect();
    assert_eq!(ids.len(), unique.len());
}

#[test]
fn the_report_of_an_online_replay_contains_conclusions_and_provenance() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    file(folder, "events.csv", log(&["a", "b"], 150));
    let command = "replay events.csv --online --piggyback-bytes 2 --terms path --report report";
    assert!(pingmap(folder, &command.split(' ').collect::<Vec<_>>()).status.success());
    let page = std::fs::read_to_string(folder.join("report/index.html")).unwrap();
    let digest = json(folder, &["check", "events.csv", "--json"])["log_digest"].as_str().unwrap().to_owned();
    for message in
        ["The NLL of coming events is ", "a → b", "Provenance", &digest, command, "<th scope=\"col\">share heard</th>"]
    {
        assert!(page.contains(message), "no {message:?}");
    }
}

#[test]
fn the_report_uses_the_whole_log_and_the_origin_of_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    file(folder, "events.csv", log(&["a", "b"], 150));
    let run = |command: &str| {
        let output = pingmap(folder, &command.split(' ').collect::<Vec<_>>());
        assert!(output.status.success(), "{command}: {}", stderr(&output));
        stdout(&output)
    };
    run("learn events.csv --origin 41.5,-70.6 --terms path --additions none -o model.toml");
    let replay =
        "replay events.csv --model model.toml --frames 1 --repeats 2 --events-max 100 --report report --overwrite";
    let printed: serde_json::Value = serde_json::from_str(&run(&format!("{replay} --json"))).unwrap();
    let whole = json(folder, &["check", "events.csv", "--json"]);
    assert_eq!(printed["log_digest"], whole["log_digest"]);
    assert_eq!((printed["events"].as_u64(), printed["events_used"].as_u64()), (Some(150), Some(100)));
    assert!(printed["calibration"].is_object(), "a report shows whether its maps can be believed");
    let page = std::fs::read_to_string(folder.join("report/index.html")).unwrap();
    for message in [whole["log_digest"].as_str().unwrap(), "100 of 150 events", "41.5", "70°"] {
        assert!(page.contains(message), "no {message:?}");
    }
    // The text output contains calibration only with --calibration.
    assert!(
        !run(replay).contains("calibration error")
            && run(&format!("{replay} --calibration")).contains("calibration error")
    );
}
