//! The film of a mission: its data, its page in a browser, and refusals. Without Chromium the tests of the page are
//! skipped with a message.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pingmap_agent::*;
use pingmap_trial::{EventLog, Plan, record_and_refit};
use serde_json::Value;

use crate::common::{file, log, pingmap, stderr, stdout};

/// A name that would end the script of the page.
const HOSTILE: &str = "</script><b>";

/// Writes a log and its film without packets, and returns the path of the film.
fn film(folder: &Path, vehicles: &[&str]) -> PathBuf {
    file(folder, "events.csv", log(vehicles, 70));
    let output =
        pingmap(folder, &["replay", "events.csv", "--online", "--slot-every", "1000", "--animate", "film.html"]);
    assert!(output.status.success() && stderr(&output).contains("film: film.html"), "{}", stderr(&output));
    folder.join("film.html")
}

/// Returns the data of a film.
fn data(path: &Path) -> Value {
    let page = std::fs::read_to_string(path).unwrap();
    let data = page.split("id=\"film-data\">").nth(1).unwrap().split("</script>").next().unwrap();
    serde_json::from_str(data).unwrap()
}

fn pair(value: &Value) -> (f64, f64) {
    (value[0].as_f64().unwrap(), value[1].as_f64().unwrap())
}

/// Returns the centres of the cells in rows from the south.
fn centres(area: &Value) -> Vec<Position> {
    let (columns, rows) = (area["columns"].as_u64().unwrap(), area["rows"].as_u64().unwrap());
    let (east, north) = (pair(&area["east"]), pair(&area["north"]));
    let middle = |(low, high): (f64, f64), n: u64, count: u64| low + (high - low) * (n as f64 + 0.5) / count as f64;
    let cell = |n: u64| Position::new(middle(east, n % columns, columns), middle(north, n / columns, rows));
    (0..columns * rows).map(cell).collect()
}

/// Returns the probability of each cell, and whether it is marked as not known.
fn cells(map: &Value) -> Vec<(f64, bool)> {
    let digits = map["cells"].as_str().unwrap();
    let byte = |n: usize| u8::from_str_radix(&digits[n..n + 2], 16).unwrap();
    (0..digits.len()).step_by(2).map(byte).map(|byte| (f64::from(byte & 127) / 127.0, byte > 127)).collect()
}

/// Checks the map of a vehicle with this knowledge at this position and time.
fn check_map(agent: &mut Agent, at: Position, time_s: f64, area: &Value, map: &Value) {
    let query = |receiver| {
        let query = LinkQuery::from(Link { transmitter: at, receiver });
        LinkQuery { transmitter: agent.id().into(), when: Time::At(time_s), ..query }
    };
    let queries: Vec<LinkQuery> = centres(area).into_iter().map(query).collect();
    let predictions = agent.predict_intervals(queries).unwrap();
    assert_eq!(predictions.len(), cells(map).len());
    let is_narrow = |interval: &Option<Interval>| interval.is_some_and(|Interval { low, high, .. }| high - low < 0.5);
    let narrow = predictions.iter().filter(|prediction| is_narrow(&prediction.interval)).count();
    // Places far from all data are not known, either.
    let known = cells(map).iter().filter(|(_, is_unknown)| !is_unknown).count();
    assert!(known <= narrow && 2 * known >= narrow, "{known} {narrow}");
    for (prediction, (probability, is_unknown)) in predictions.iter().zip(cells(map)) {
        assert!((prediction.probability - probability).abs() < 0.5 / 127.0 + 1e-6, "{prediction:?}: {probability}");
        let interval = prediction.interval.unwrap();
        let width = interval.high - interval.low;
        assert!(is_unknown || width < 0.5 + 1e-6, "{interval:?}: {is_unknown}");
    }
}

#[test]
fn the_cells_are_predictions_from_the_events_up_to_their_time() {
    let folder = tempfile::tempdir().unwrap();
    let data = data(&film(folder.path(), &["a", "b"]));
    let log = EventLog::open(&folder.path().join("events.csv")).unwrap();
    let (team, _) = Plan::new(Learning::default(), 1).team(&log, None).unwrap();
    let id = VehicleId::new("a");
    let mut agent = Agent::new(id.clone(), Arc::new(team), AgentOptions::default());
    let mut own = log.events.iter().filter(|event| event.receiver_id == id).cloned().peekable();
    let moments = data["moments"].as_array().unwrap();
    assert_eq!((moments.len(), &moments[0]["time_s"], &moments[23]["time_s"]), (24, &0.0.into(), &69.0.into()));
    let mut known = 0;
    for moment in [&moments[8], &moments[23]] {
        let time_s = moment["time_s"].as_f64().unwrap();
        while let Some(event) = own.next_if(|event| event.time_s <= time_s) {
            agent.probability(event.query()).unwrap();
            record_and_refit(&mut agent, [event]).unwrap();
            known += 1;
        }
        let map = &moment["maps"][0];
        assert_eq!((map["own"].as_u64(), map["received"].as_u64()), (Some(known), Some(0)));
        // The times of the film are those of events. Vehicle a sends or receives every message.
        let here = log.events.iter().min_by_key(|event| ((event.time_s - time_s).abs() * 1e6) as u64).unwrap();
        let at = if here.receiver_id == id { here.link.receiver } else { here.link.transmitter };
        assert_eq!(pair(&moment["places"][0]), (at.east_m, at.north_m));
        check_map(&mut agent.clone(), at, time_s, &data["area"], map);
    }
    assert_eq!(known, 35);
}

#[test]
fn the_film_contains_every_message_and_changes_no_score() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = data(&film(folder, &["a", "b", HOSTILE]));
    let log = EventLog::open(&folder.join("events.csv")).unwrap();
    let vehicles = data["vehicles"].as_array().unwrap();
    let id = |place: &Value| vehicles[place.as_u64().unwrap() as usize]["name"].as_str().unwrap();
    let messages = data["messages"].as_array().unwrap();
    assert_eq!(messages.len(), log.events.len());
    for (event, message) in log.events.iter().zip(messages) {
        assert_eq!(message[0], event.time_s);
        assert_eq!((id(&message[1]), id(&message[2])), (event.transmitter_id.as_str(), event.receiver_id.as_str()));
        let [from, to] = event.link.ends().map(|end| (end.east_m, end.north_m));
        assert_eq!((pair(&message[3]), pair(&message[4]), &message[5]), (from, to, &event.success.into()));
    }
    let replay = ["replay", "events.csv", "--online", "--piggyback-bytes", "2"];
    let [with, without] =
        [&["--animate", "other.html"][..], &[]].map(|more| pingmap(folder, &[&replay, more].concat()));
    assert_eq!(stdout(&with), stdout(&without));
    let received = |path| self::data(path)["moments"][23]["maps"][0]["received"].as_u64().unwrap();
    assert!(received(&folder.join("other.html")) > 0, "piggybacked outcomes count");
}

#[test]
fn the_page_refers_to_nothing_outside() {
    let folder = tempfile::tempdir().unwrap();
    let page = std::fs::read_to_string(film(folder.path(), &["a", HOSTILE])).unwrap();
    for reference in ["http", "src=", "href", "url(", "@import", "import(", "fetch(", "XMLHttp", "<link", "<b>"] {
        assert!(!page.contains(reference), "{reference}");
    }
    assert_eq!(page.matches("<script").count(), 2);
    assert_eq!(page.matches("</script>").count(), 2);
    assert!(page.contains("<td>events.csv</td>") && page.contains("<td>70</td>"), "provenance");
}

#[test]
fn films_that_cannot_be_written_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    file(folder, "events.csv", log(&["a", "b"], 30));
    file(folder, "old.html", "old");
    for (arguments, expected) in [
        ("--animate film.html", "--online"),
        ("--online --animate -", "expected another file, such as mission.html"),
        ("--online --report . --animate index.html", "that is the page of the report"),
        ("--online --animate old.html", "or --overwrite to replace the file"),
        ("--online --animate events.csv --overwrite", "is read and would be written"),
    ] {
        let arguments: Vec<&str> = ["replay", "events.csv"].into_iter().chain(arguments.split(' ')).collect();
        let output = pingmap(folder, &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(expected) && stdout(&output).is_empty(), "{arguments:?}: {}", stderr(&output));
    }
    assert_eq!(std::fs::read_to_string(folder.join("old.html")).unwrap(), "old");
}

#[cfg(unix)]
mod page {
    use super::*;
    use crate::common::browser::Browser;

    const STATUS: &str = "document.getElementById('film-status').textContent";
    const TIME: &str = "document.getElementById('film-time').value";
    const BUTTON: &str = "document.getElementById('film-play').textContent";

    const ARROW_LEFT: (&str, u32) = ("ArrowLeft", 37);
    const ARROW_RIGHT: (&str, u32) = ("ArrowRight", 39);
    const ARROW_DOWN: (&str, u32) = ("ArrowDown", 40);
    const SPACE: (&str, u32) = (" ", 32);

    /// Opens a film in a browser that prefers reduced motion.
    fn opened(folder: &Path) -> Option<Browser> {
        let path = film(folder, &["a", "b", HOSTILE]);
        let mut browser = Browser::start(folder)?;
        browser.emulate(&[("prefers-reduced-motion", "reduce")]);
        browser.open(&path);
        Some(browser)
    }

    #[test]
    fn keys_and_touch_control_the_film() {
        let folder = tempfile::tempdir().unwrap();
        let Some(mut browser) = opened(folder.path()) else { return };
        let start = browser.text(STATUS);
        assert!(
            start.starts_with(&format!("events.csv, 0:00:00 after the first event (0.0 s): {HOSTILE} knows ")),
            "{start}"
        );
        let press = |browser: &mut Browser, (key, code): (&str, u32)| browser.press(key, code);
        // The slider has its own keys.
        browser.value("document.getElementById('film-time').focus()");
        press(&mut browser, ARROW_RIGHT);
        assert_eq!(browser.text(TIME), "1");
        assert!(
            browser.text(STATUS).starts_with("events.csv, 0:00:03 after the first event"),
            "{}",
            browser.text(STATUS)
        );
        // Elsewhere the arrows go from time to time.
        browser.value("document.activeElement.blur()");
        for (key, time) in [(ARROW_RIGHT, "2"), (ARROW_RIGHT, "3"), (ARROW_LEFT, "2")] {
            press(&mut browser, key);
            assert_eq!(browser.text(TIME), time, "{key:?}");
        }
        press(&mut browser, SPACE);
        assert_eq!(browser.text(BUTTON), "Pause");
        browser.wait_until(&format!("Number({TIME}) > 3"));
        press(&mut browser, SPACE);
        assert_eq!(browser.text(BUTTON), "Play");
        browser.value("document.getElementById('film-viewer').focus()");
        press(&mut browser, ARROW_DOWN);
        assert!(browser.text(STATUS).contains("): a knows "), "{}", browser.text(STATUS));
        let middle = "(box => [box.x + box.width / 2, box.y + box.height / 2])(document.getElementById('film-map').getBoundingClientRect())";
        let (x, y) = pair(&browser.value(middle));
        browser.touch(x, y);
        let here = browser.text("document.getElementById('film-here').textContent");
        assert!(here.contains(" m east, ") && here.contains(" %"), "{here}");
        assert!(browser.problems().is_empty(), "{:?}", browser.problems());
        let page = format!("file://{}", folder.path().join("film.html").display());
        assert!(browser.loaded().iter().all(|address| *address == page), "{:?}", browser.loaded());
    }

    #[test]
    fn the_film_starts_by_itself_unless_the_reader_prefers_reduced_motion() {
        let folder = tempfile::tempdir().unwrap();
        let Some(mut browser) = opened(folder.path()) else { return };
        assert_eq!(browser.text(BUTTON), "Play");
        browser.emulate(&[("prefers-reduced-motion", "no-preference")]);
        browser.value("location.reload()");
        browser
            .wait_until(&format!("document.readyState === 'complete' && Number({TIME}) > 0 && {BUTTON} === 'Pause'"));
        assert!(browser.problems().is_empty(), "{:?}", browser.problems());
    }

    #[test]
    fn the_film_fits_screens_and_has_a_dark_mode() {
        let folder = tempfile::tempdir().unwrap();
        let Some(mut browser) = opened(folder.path()) else { return };
        for width in [1280, 400] {
            browser.resize(width, 900);
            browser.wait_until(
                "document.getElementById('film-map').width === document.getElementById('film-map').clientWidth",
            );
            assert_eq!(browser.value("document.documentElement.scrollWidth"), width);
            let sticks_out = "[...document.querySelectorAll('#film *')].filter(e => e.getBoundingClientRect().right > innerWidth).length";
            assert_eq!(browser.value(sticks_out), 0, "something sticks out of {width} pixels");
        }
        browser.emulate(&[("prefers-color-scheme", "dark"), ("prefers-reduced-motion", "reduce")]);
        assert_eq!(browser.text("getComputedStyle(document.body).backgroundColor"), "rgb(21, 24, 28)");
    }
}
