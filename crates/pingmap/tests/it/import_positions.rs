//! Positions of recordings: missing and isolated ones, reference systems, and the antimeridian.

use std::path::Path;

use crate::common::tables::*;
use crate::common::*;

/// Returns the events of a log without its remark and header.
fn events(log: &str) -> Vec<&str> {
    log.lines().filter(|line| line.contains("ada")).collect()
}

/// Sets the position in rows of the navigation of ada.
fn set_positions(folder: &Path, rows: std::ops::Range<usize>, position: &str) {
    rewrite_lines(folder, "ada.nav.csv", |n, line| match rows.contains(&n) {
        true => format!("{},{position}", line.split(',').next().unwrap()),
        false => line.to_owned(),
    });
}

#[test]
fn zeros_before_the_first_fix_are_no_positions() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    let (plain, _) = import_tables(folder, &["--origin", "43.83,-70.32"]);
    for missing in ["0.0,0.0", "nan,nan", ","] {
        set_positions(folder, 1..10, missing);
        let (log, warnings) = import_tables(folder, &[]);
        assert!(log.starts_with("# reference system: 43.83,-70.32"), "{missing}: {}", &log[..60]);
        assert!(warnings.contains("9 lines of navigation without a position left out"), "{missing}: {warnings}");
        // The messages of the first 100 s have no position of ada.
        assert_eq!(events(&log), events(&plain)[events(&plain).len() - events(&log).len()..]);
        assert!((1..=6).contains(&(events(&plain).len() - events(&log).len())));
    }
}

#[test]
fn an_isolated_far_position_is_excluded_from_the_origin_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    set_positions(folder, 50..51, "43.9,-75.5");
    let (log, warnings) = import_tables(folder, &[]);
    assert!(log.starts_with("# reference system: 43.83,-70.32"), "{}", &log[..60]);
    let expected = "1 position of ada left out, the first at 43.9000, -75.5000, 2026-05-03T12:08:10Z, 414 km from its other positions";
    assert!(warnings.contains(expected), "{warnings}");
    assert!(events(&log).len() > TRANSMISSIONS - 10);
}

#[test]
fn longitudes_from_0_to_360_are_accepted_and_others_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    let (west, _) = import_tables(folder, &[]);
    write_tables(folder, 43.83, 289.67);
    let (east, _) = import_tables(folder, &[]);
    let numbers = |log: &str| -> Vec<f64> {
        log.lines().flat_map(|line| line.split(',')).filter_map(|field| field.parse().ok()).collect()
    };
    // The tables are rounded to a tenth of a metre.
    let (west, east) = (numbers(&west), numbers(&east));
    assert!(west.len() == east.len() && west.iter().zip(&east).all(|(a, b)| (a - b).abs() < 0.2));
    std::fs::remove_file(folder.join("events.csv")).unwrap();
    set_positions(folder, 5..6, "43.83,361.5");
    let error = refused_tables(folder, &[]);
    assert!(error.contains("line 6, column lon: found \"361.5\"; expected a longitude from -180 to 360"), "{error}");
}

#[test]
fn reference_systems_without_true_metres_are_refused_with_the_right_zone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.6, -70.3);
    for system in ["EPSG:3857", "EPSG:3395", "EPSG:3832"] {
        let error = refused_tables(folder, &["--crs", system]);
        assert!(
            error.contains("on the ground at 43.60, -70.30") && error.contains("EPSG:32619 (UTM zone 19 north)"),
            "{error}"
        );
    }
    // A log with metres of Web Mercator is refused, too.
    let (log, _) = import_tables(folder, &["--crs", "EPSG:32619"]);
    file(folder, "events.csv", log.replace("EPSG:32619", "EPSG:3857"));
    let output = pingmap(folder, &["map", "events.csv", "--at", "0,0", "-o", "map.geojson"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("on the ground"), "{}", stderr(&output));
}

#[test]
fn a_swapped_origin_and_bare_degrees_are_refused_with_the_corrected_option() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    let error = refused_tables(folder, &["--origin", "-70.33,43.83"]);
    assert!(error.contains("expected the latitude first: --origin 43.83,-70.33"), "{error}");
    let error = refused_tables(folder, &["--origin", "-170.33,43.83"]);
    assert!(error.contains("expected the latitude first: --origin 43.83,-170.33"), "{error}");
    let error = refused_tables(folder, &["--origin", "10,20"]);
    assert!(error.contains("expected at most 100 km"), "{error}");
    import_tables(folder, &[]);
    for (at, corrected) in [("43.8312,-70.325", "43.8312N,70.325W"), ("-70.325,43.8312", "43.8312N,70.325W")] {
        let at = format!("--at={at}");
        let output = pingmap(folder, &["map", "events.csv", &at, "-o", "map.geojson"]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains(&format!("expected --at {corrected}")), "{}", stderr(&output));
    }
}

/// Returns all lines and rings in a geometry.
fn lines(coordinates: &serde_json::Value) -> Vec<Vec<[f64; 2]>> {
    let Some(parts) = coordinates.as_array() else { return Vec::new() };
    let is_position = |value: &serde_json::Value| value.get(0).is_some_and(serde_json::Value::is_number);
    if parts.iter().all(is_position) {
        return vec![parts.iter().map(|part| [0, 1].map(|n| part[n].as_f64().unwrap())).collect()];
    }
    parts.iter().flat_map(lines).collect()
}

#[test]
fn maps_across_the_antimeridian_are_cut_there() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, -17.2, 179.995);
    let (log, _) = import_tables(folder, &[]);
    assert!(events(&log).len() > TRANSMISSIONS - 10);
    let map = |name: &str| {
        let output = pingmap(folder, &["map", "events.csv", "--at", "17.1955S,179.99918W", "-o", name]);
        assert!(output.status.success(), "{}", stderr(&output));
        std::fs::read_to_string(folder.join(name)).unwrap()
    };
    let geojson: serde_json::Value = serde_json::from_str(&map("map.geojson")).unwrap();
    let mut all = Vec::new();
    for feature in geojson["features"].as_array().unwrap() {
        let geometry = &feature["geometry"];
        if geometry["type"] != "Point" {
            all.extend(lines(&geometry["coordinates"]));
        }
    }
    let kml = map("map.kml");
    for coordinates in kml.split("<coordinates>").skip(1) {
        let text = coordinates.split('<').next().unwrap();
        let place = |place: &str| {
            let mut numbers = place.split(',').map(|number| number.parse().unwrap());
            [numbers.next().unwrap(), numbers.next().unwrap()]
        };
        all.push(text.split_whitespace().map(place).collect());
    }
    let is_torn = |line: &Vec<[f64; 2]>| line.windows(2).any(|pair| (pair[0][0] - pair[1][0]).abs() > 180.0);
    assert_eq!((all.iter().filter(|line| is_torn(line)).count(), all.len() > 20), (0, true));
    // Both sides of the antimeridian are drawn, up to the antimeridian.
    for edge_deg in [180.0, -180.0] {
        assert!(all.iter().flatten().any(|place| place[0] == edge_deg), "{edge_deg}");
    }
}

#[test]
fn a_vehicle_at_the_surface_is_named_with_its_span() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    for name in ["ada", "bob"] {
        let table = format!("{name}.nav.csv");
        rewrite_lines(folder, &table, |n, line| {
            let depth = match n {
                0 => "depth",
                60..90 if name == "ada" => "-1.5",
                _ => "20",
            };
            format!("{line},{depth}")
        });
    }
    let (log, warnings) = import_tables(folder, &[]);
    let span = "from 2026-05-03T12:09:50Z to 2026-05-03T12:14:40Z";
    assert!(warnings.contains(&format!("ada is above -0.5 m depth {span}: was it in the air?")), "{warnings}");
    let (shorter, warnings) = import_tables(folder, &["--surfaced-above-m", "1"]);
    assert!(
        warnings.contains(&format!("ada is above 1 m depth {span}: its messages in this time are left out")),
        "{warnings}"
    );
    assert!(events(&shorter).len() + 10 < events(&log).len());
}
