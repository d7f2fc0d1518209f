//! Tables as people have them: decimal commas, encodings, dates, epochs, units, names of columns, and events.

use std::path::Path;

use crate::common::tables::*;
use crate::common::*;

/// Writes the six tables, changes each line of a kind of table, and compares the imported log with that of the plain
/// tables. Returns the messages.
fn same_log(kinds: &[&str], change: impl Fn(usize, &str) -> String, options: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    let (plain, _) = import_tables(folder, &[]);
    for name in table_names().filter(|name| kinds.iter().any(|kind| name.contains(kind))) {
        rewrite_lines(folder, &name, &change);
    }
    let (log, messages) = import_tables(folder, options);
    assert_eq!(numbers(&log), numbers(&plain));
    messages
}

/// Returns all fields of a log, with numbers rounded to a millimetre and a millisecond.
fn numbers(log: &str) -> Vec<String> {
    let round = |field: &str| match field.parse::<f64>() {
        Ok(number) => format!("{number:.3}"),
        Err(_) => field.to_owned(),
    };
    log.lines().flat_map(|line| line.split(',')).map(round).collect()
}

/// Replaces the time in the first field of a line, except in the header.
fn with_time(n: usize, line: &str, format: impl Fn(f64) -> String) -> String {
    let (time, rest) = line.split_once(',').unwrap();
    if n == 0 { line.to_owned() } else { format!("{},{rest}", format(time.parse().unwrap())) }
}

/// Formats a time of the mission day as hours, minutes and seconds, some hours later.
fn time_of_day(time_s: f64, hours: f64, separator: &str) -> String {
    let second = time_s - (START_S - 12.0 * 3600.0) + 3600.0 * hours;
    let (hour, minute) = ((second / 3600.0) as u32, (second / 60.0) as u32 % 60);
    format!("{hour:02}:{minute:02}:{:06.3}", second % 60.0).replace('.', separator)
}

#[test]
fn decimal_commas_are_read_where_the_delimiter_is_a_semicolon() {
    let messages = same_log(&["nav", "heard", "sent"], |_, line| line.replace(',', ";").replace('.', ","), &[]);
    assert!(messages.contains("ada.nav.csv: decimal commas"), "{messages}");
}

#[test]
fn dates_with_the_day_first_and_zones_are_read() {
    let local =
        |n: usize, line: &str| with_time(n, line, |time_s| format!("03.05.2026 {}", time_of_day(time_s, 2.0, ".")));
    same_log(&["nav", "heard", "sent"], local, &["--time-zone", "Europe/Berlin"]);
    let iso =
        |n: usize, line: &str| with_time(n, line, |time_s| format!("2026-05-03T{}", time_of_day(time_s, -3.5, ".")));
    same_log(&["nav", "heard", "sent"], iso, &["--time-zone", "-03:30"]);
    // The date has a column of its own, and the seconds have a decimal comma.
    let split = |n: usize, line: &str| match n {
        0 => format!("Datum;{}", line.replace(',', ";")),
        n => format!(
            "3.5.2026;{}",
            with_time(n, line, |time_s| time_of_day(time_s, 0.0, "|")).replace(',', ";").replace('|', ",")
        ),
    };
    same_log(&["heard", "sent"], split, &[]);
}

#[test]
fn epochs_in_milliseconds_and_nanoseconds_are_recognised_and_reported() {
    for (parts, unit) in [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")] {
        let change = |n: usize, line: &str| with_time(n, line, |time_s| format!("{:.0}", time_s * parts));
        let messages = same_log(&["heard", "sent"], change, &[]);
        assert!(messages.contains(&format!("bob.sent.csv: times in {unit} since 1970")), "{messages}");
    }
}

#[test]
fn headers_may_have_units_and_columns_of_one_vehicle_their_own_names() {
    let change = |n: usize, line: &str| {
        if n == 0 { line.replace("time,lat,lon", "Zeit [s],Breite [deg],Länge (°)") } else { line.to_owned() }
    };
    let columns = ["--column", "nav.time=zeit", "nav.latitude=breite", "nav.longitude=länge"];
    same_log(&["nav"], change, &columns);
    let only_ada = |scope: &str| {
        let columns = ["time=Zeit", "latitude=Breite", "longitude=Länge"].map(|column| format!("{scope}:nav.{column}"));
        let change = |n: usize, line: &str| match line {
            "time,lat,lon" if n == 0 => "Zeit [s],Breite [deg],Länge (°)".to_owned(),
            line => line.to_owned(),
        };
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        write_tables(folder, 43.83, -70.33);
        let (plain, _) = import_tables(folder, &[]);
        rewrite_lines(folder, "ada.nav.csv", change);
        let (log, _) = import_tables(folder, &["--column", &columns[0], &columns[1], &columns[2]]);
        assert_eq!(log, plain);
    };
    only_ada("ada");
    only_ada("ada.nav.csv");
    let folder = tempfile::tempdir().unwrap();
    write_tables(folder.path(), 43.83, -70.33);
    let error = refused_tables(folder.path(), &["--column", "bob:nav.time=zeit"]);
    assert!(error.contains("bob.nav.csv: line 1: the header lacks the column zeit"), "{error}");
    let error = refused_tables(folder.path(), &["--column", "eve:nav.time=Zeit"]);
    assert!(error.contains("eve") && error.contains("expected the name of one"), "{error}");
    rewrite_lines(folder.path(), "ada.nav.csv", |_, line| line.replace("lat", "lat [rad]"));
    let error = refused_tables(folder.path(), &[]);
    assert!(error.contains("unit rad; expected"), "{error}");
}

#[test]
fn text_in_windows_1252_is_read_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    let (plain, _) = import_tables(folder, &[]);
    let text = std::fs::read_to_string(folder.join("ada.nav.csv")).unwrap();
    let text = text.replace("time,lat,lon", "Zeit,Breite,L\u{e4}nge");
    file(folder, "ada.nav.csv", text.chars().map(|character| character as u32 as u8).collect::<Vec<u8>>());
    let columns = ["--column", "ada:nav.time=zeit", "ada:nav.latitude=breite", "ada:nav.longitude=länge"];
    let (log, messages) = import_tables(folder, &columns);
    assert_eq!(log, plain);
    assert!(messages.contains("ada.nav.csv: text in Windows-1252"), "{messages}");
}

#[test]
fn a_column_that_looks_like_an_outcome_is_used_or_asked_about() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    write_tables(folder, 43.83, -70.33);
    let (plain, _) = import_tables(folder, &[]);
    let with_column = |header: &str, bad: &str| {
        write_tables(folder, 43.83, -70.33);
        rewrite_lines(folder, "ada.heard.csv", |n, line| {
            let value = match n {
                0 => header,
                3 => bad,
                _ => "ok",
            };
            format!("{line},{value}")
        });
    };
    for (header, bad) in [("rx_ok", "failed"), ("status", "bad"), ("decoded", "no")] {
        with_column(header, bad);
        let (log, _) = import_tables(folder, &[]);
        let heard = |log: &str| log.lines().filter(|line| line.ends_with(",1")).count();
        assert_eq!(heard(&log) + 1, heard(&plain), "{header}");
    }
    with_column("modem_result", "weak");
    std::fs::remove_file(folder.join("events.csv")).unwrap();
    let error = refused_tables(folder, &[]);
    for option in ["--column ada.heard.csv:heard.good=modem_result", "--column ada.heard.csv:heard.good= "] {
        assert!(error.contains(option), "{error}");
    }
    assert_eq!(import_tables(folder, &["--column", "heard.good="]).0, plain);
    std::fs::remove_file(folder.join("events.csv")).unwrap();
    let error = refused_tables(folder, &["--column", "ada:heard.good=modem_result"]);
    assert!(error.contains("line 4, column modem_result: found \"weak\"; expected 0 or 1"), "{error}");
}

/// Imports `my.csv` as a table of events.
fn import_events(folder: &Path, options: &[&str]) -> std::process::Output {
    let mut arguments = vec!["import", "--events", "my.csv", "--overwrite"];
    arguments.extend(options);
    pingmap(folder, &arguments)
}

#[test]
fn tables_of_events_are_imported_with_their_outcomes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut text = String::from("Datum;Zeit;von;an;tx lat;tx lon;rx lat;rx lon;Ergebnis\n");
    for n in 0..40 {
        let outcome = if n % 4 == 0 { "lost" } else { "received" };
        text += &format!("03.05.2026;14:{n:02}:00;ada;bob;43,83{n:02};-70,33;43,84;-70,32{n:02};{outcome}\n");
    }
    text += "03.05.2026;14:50:00;ada;bob;0;0;43,84;-70,32;lost\n";
    file(folder, "my.csv", &text);
    let columns = [
        "--time-zone",
        "+02:00",
        "--column",
        "events.time=Zeit",
        "events.transmitter=von",
        "events.receiver=an",
        "events.success=ergebnis",
    ];
    let output = import_events(folder, &columns);
    assert!(output.status.success(), "{}", stderr(&output));
    let found = stdout(&output);
    assert!(found.contains("40 events (30 heard, 10 missed)") && !found.contains("Clocks"), "{found}");
    assert!(stderr(&output).contains("1 line without a position left out"), "{}", stderr(&output));
    let log = std::fs::read_to_string(folder.join("events.csv")).unwrap();
    assert!(
        log.starts_with("# reference system: 43.84,-70.33") && log.contains(&format!("\n{},ada,bob,", START_S)),
        "{log}"
    );
    let output = import_events(folder, &[&columns[..], &["--json"]].concat());
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!((json["events"].as_u64(), json["pairs"][0]["heard"].as_u64()), (Some(40), Some(30)));
    // The table of events that the program writes itself is read back.
    std::fs::copy(folder.join("events.csv"), folder.join("my.csv")).unwrap();
    assert!(import_events(folder, &["--crs", "EPSG:32619"]).status.success());
}

#[test]
fn tables_of_events_without_a_clear_outcome_or_position_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let header = "time,tx,rx,tx_x,tx_y,rx_x,rx_y,heard";
    for (text, expected) in [
        (format!("{header}\n1,a,b,0,0,9,9,\n"), "column heard: found \"\"; expected an outcome"),
        (format!("{header}\n1,a,b,0,0,9,9,perhaps\n"), "expected 0 or 1, false or true"),
        (format!("{header}\n"), "no events; expected at least one line"),
        (format!("{header}\n1,,b,0,0,9,9,1\n"), "column tx: found \"\"; expected one vehicle"),
        (header.replace("heard", "color") + "\n", "one of success, heard, received"),
        (header.replace("rx_y", "rx_q") + "\n", "for events.rx_northing"),
        (format!("{header}\nnoon,a,b,0,0,9,9,1\n"), "found \"noon\"; expected seconds"),
    ] {
        file(folder, "my.csv", &text);
        let output = import_events(folder, &[]);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(stderr(&output).contains(expected), "{expected}: {}", stderr(&output));
    }
}
