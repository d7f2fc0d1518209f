//! `pingmap simulate`: reproducibility, outcomes that follow the true probabilities, and agreement with published
//! formulas.

use crate::common::{HEADER, file, json, pingmap, stderr, stdout};
use std::collections::BTreeMap;
use std::path::Path;

/// One line of a simulated log. Depths are 0 where it has none.
struct Row {
    time_s: f64,
    tx: String,
    rx: String,
    /// East, north and depth.
    from: [f64; 3],
    to: [f64; 3],
    success: bool,
    /// The true probability.
    p: f64,
}

/// Simulates a trial, and returns the text of the log.
fn simulate(options: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let output = pingmap(folder.path(), &[&["simulate", "--overwrite"], options].concat());
    assert!(output.status.success(), "{options:?}: {}", stderr(&output));
    std::fs::read_to_string(folder.path().join("trial.csv")).unwrap()
}

fn rows(options: &[&str]) -> Vec<Row> {
    let text = simulate(options);
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    text.lines().skip(1).map(|line| row(&header.iter().copied().zip(line.split(',')).collect())).collect()
}

fn row(fields: &BTreeMap<&str, &str>) -> Row {
    let number = |name: &str| fields.get(name).map_or(0.0, |text| text.parse::<f64>().unwrap());
    let end = |end: &str| ["easting_m", "northing_m", "depth_m"].map(|what| number(&format!("{end}_{what}")));
    Row {
        time_s: number("time_s"),
        tx: fields["tx_id"].to_owned(),
        rx: fields["rx_id"].to_owned(),
        from: end("tx"),
        to: end("rx"),
        success: fields["success"] == "1",
        p: number("true_probability"),
    }
}

fn heard(rows: &[Row]) -> usize {
    rows.iter().filter(|row| row.success).count()
}

#[test]
fn a_seed_determines_the_trial() {
    let once = simulate(&["--slots", "60", "--seed", "7"]);
    assert_eq!(once, simulate(&["--slots", "60", "--seed", "7"]));
    assert_ne!(once, simulate(&["--slots", "60", "--seed", "8"]));
    // Additional slots do not change earlier ones.
    assert!(simulate(&["--slots", "90", "--seed", "7"]).starts_with(&once));
}

#[test]
fn depths_are_written_only_when_asked_for() {
    let flat = simulate(&["--slots", "20"]);
    assert_eq!(flat.lines().next().unwrap(), format!("{HEADER},true_probability"));
    let deep = simulate(&["--slots", "20", "--depths"]);
    assert_eq!(deep.lines().next().unwrap(), format!("{HEADER},tx_depth_m,rx_depth_m,true_probability"));
    // Without the two columns the trial is the same.
    let without = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        [&fields[..8], &fields[10..]].concat().join(",")
    };
    assert!(deep.lines().map(without).eq(flat.lines().map(str::to_owned)));
}

#[test]
fn json_describes_the_trial_and_its_limits() {
    let folder = tempfile::tempdir().unwrap();
    let command = ["simulate", "--vehicles", "4", "--slots", "50", "--seed", "3", "-o", "own.csv", "--json"];
    let object = json(folder.path(), &command);
    assert_eq!((&object["schema"], &object["seed"], &object["events"]), (&1.into(), &3.into(), &150.into()));
    assert!(object["note"].as_str().unwrap().contains("stand-in"), "{object}");
    let text = std::fs::read_to_string(folder.path().join("own.csv")).unwrap();
    let vehicles = object["vehicles"].as_array().unwrap();
    assert_eq!(vehicles.len(), 4);
    for vehicle in vehicles {
        let received = text.lines().filter(|line| line.split(',').nth(2) == vehicle["vehicle"].as_str());
        let heard: Vec<bool> = received.map(|line| line.split(',').nth(7) == Some("1")).collect();
        assert_eq!(vehicle["events"], heard.len(), "{vehicle}");
        assert_eq!(vehicle["successes"], heard.iter().filter(|&&heard| heard).count(), "{vehicle}");
        assert!(vehicle["even_odds_range_m"].as_f64().unwrap() > 0.0, "{vehicle}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "one file, the log");
}

#[test]
fn the_summary_states_that_the_log_is_a_stand_in() {
    let folder = tempfile::tempdir().unwrap();
    let output = pingmap(folder.path(), &["simulate", "--slots", "20"]);
    let text = stdout(&output);
    for expected in ["trial.csv: 40 events of 3 vehicles", "auv1", "auv3", "stand-in for a field trial"] {
        assert!(text.contains(expected), "{expected:?} is missing: {text}");
    }
}

#[test]
fn outcomes_are_drawn_from_the_true_probability() {
    let rows = rows(&["--slots", "2500", "--seed", "5"]);
    assert_eq!(rows.len(), 5000);
    // Tenths of the range are tested in addition to all events, so opposite errors do not cancel.
    let standardised = |low: f64, high: f64| {
        let within: Vec<&Row> = rows.iter().filter(|row| (low..high).contains(&row.p)).collect();
        let surprise: f64 = within.iter().map(|row| f64::from(u8::from(row.success)) - row.p).sum();
        let variance: f64 = within.iter().map(|row| row.p * (1.0 - row.p)).sum();
        if variance > 1.0 { surprise / variance.sqrt() } else { 0.0 }
    };
    assert!(standardised(0.0, 2.0).abs() < 4.0, "{}", standardised(0.0, 2.0));
    for tenth in 0..10 {
        let (low, high) = (0.1 * f64::from(tenth), 0.1 * f64::from(tenth + 1));
        assert!(standardised(low, high).abs() < 4.0, "{low} to {high}: {}", standardised(low, high));
    }
    // Events with probability 1 succeed, and events with probability 0 fail.
    assert!(rows.iter().all(|row| (row.p < 1.0 || row.success) && (row.p > 0.0 || !row.success)));
}

#[test]
fn vehicles_send_in_turn_and_all_others_listen() {
    let vehicles = 4;
    let rows = rows(&["--vehicles", "4", "--slots", "30", "--slot-s", "2.5"]);
    for (slot, listeners) in rows.chunks(vehicles - 1).enumerate() {
        let turn = slot % vehicles;
        let others: Vec<String> =
            (0..vehicles).filter(|&other| other != turn).map(|other| format!("auv{}", other + 1)).collect();
        assert!(listeners.iter().map(|row| &row.rx).eq(&others), "slot {slot}");
        for row in listeners {
            assert_eq!(row.tx, format!("auv{}", turn + 1), "slot {slot}");
            assert_eq!(row.time_s, 2.5 * (slot + 1) as f64, "slot {slot}");
        }
    }
}

#[test]
fn tracks_are_continuous_and_bounded_by_the_speed() {
    let rows =
        rows(&["--vehicles", "5", "--slots", "200", "--speed-m-per-s", "2", "--depths", "--water-depth-m", "40"]);
    let mut seen: BTreeMap<&str, (f64, [f64; 3])> = BTreeMap::new();
    for row in &rows {
        for (vehicle, place) in [(&row.tx, row.from), (&row.rx, row.to)] {
            assert!(place[..2].iter().all(|x| (0.0..=1400.0).contains(x)), "{vehicle} is outside: {place:?}");
            assert!((0.5..=10.0).contains(&place[2]), "{vehicle} is at a depth of {}", place[2]);
            if let Some((before_s, before)) = seen.insert(vehicle, (row.time_s, place)) {
                let moved = (place[0] - before[0]).hypot(place[1] - before[1]);
                // Positions are rounded to a tenth of a metre.
                assert!(moved <= 2.0 * (row.time_s - before_s) + 0.15, "{vehicle} moved {moved} m");
                assert!(row.time_s > before_s || place == before, "{vehicle} is in two places");
            }
        }
    }
}

#[test]
fn other_commands_accept_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let run = |command: &str| {
        let output = pingmap(folder.path(), &command.split(' ').collect::<Vec<_>>());
        assert!(output.status.success(), "{command}: {}", stderr(&output));
        assert!(!stderr(&output).contains("ignoring"), "{command}: {}", stderr(&output));
        stdout(&output)
    };
    for depths in ["", " --depths"] {
        run(&format!("simulate --slots 40{depths} --overwrite"));
        assert!(run("replay trial.csv --repeats 1 --frames 1").contains("true probability"));
        run("map --events trial.csv --at 700,700 --cell-m 200 -o map.csv --overwrite");
        run("select trial.csv --vehicle auv1");
        run("learn trial.csv --overwrite");
        // The log itself contains links to predict.
        let text = run("predict --events trial.csv --links trial.csv");
        assert_eq!(text.lines().count(), 81, "{text}");
    }
}

#[test]
fn more_noise_or_a_weaker_source_only_loses_messages() {
    // All options are given, so the wind exceeds the noise of the vehicles and the test does not depend on defaults.
    let options = |change: &str| {
        let (name, _) = change.split_once(' ').unwrap();
        let all =
            "--sea-state 1,--source-level-db 160,--self-noise-db 40,--threshold-db 12,--bandwidth-khz 4,--slots 400";
        let kept: Vec<&str> = all.split(',').filter(|option| !option.starts_with(name)).chain([change]).collect();
        kept.iter().flat_map(|option| option.split(' ')).map(str::to_owned).collect::<Vec<String>>()
    };
    let run = |change: &str| rows(&options(change).iter().map(String::as_str).collect::<Vec<_>>());
    let reference = run("--sea-state 1");
    for harder in
        ["--sea-state 6", "--source-level-db 150", "--self-noise-db 60", "--threshold-db 20", "--bandwidth-khz 16"]
    {
        let harder_rows = run(harder);
        assert!(heard(&harder_rows) + 20 < heard(&reference), "{harder}");
        // The random numbers are the same, so no event becomes easier.
        for (easy, hard) in reference.iter().zip(&harder_rows) {
            assert_eq!((easy.from, easy.to), (hard.from, hard.to), "{harder}");
            assert!(hard.p <= easy.p && (easy.success || !hard.success), "{harder}: {} {}", easy.p, hard.p);
        }
    }
}

#[test]
fn a_ridge_lowers_and_fresh_water_raises_the_success_rate() {
    let share = |ridge: &str, mound: &str, salinity: &str| {
        let options = ["--slots", "500", "--ridge-m", ridge, "--mound-m", mound, "--salinity", salinity];
        heard(&rows(&options))
    };
    let open = share("0", "0", "35");
    let (ridge, mound, lake) = (share("26", "0", "35"), share("0", "26", "35"), share("0", "0", "0"));
    assert!(ridge < open - 50, "a ridge across all: {ridge} and {open}");
    assert!(mound < open, "a mound in places: {mound} and {open}");
    assert!(lake > open + 50, "without salt little is absorbed at 25 kHz: {lake} and {open}");
}

/// Parameters of the independent computation.
struct Water {
    khz: f64,
    celsius: f64,
    salinity: f64,
    ph: f64,
    depth_m: f64,
    wind_m_per_s: f64,
    shipping: f64,
    spreading: f64,
    thorp: bool,
}

/// The defaults of the command: sea state 3 is the middle of Beaufort 4, 11 to 16 knots.
const BAY: Water = Water {
    khz: 25.0,
    celsius: 10.0,
    salinity: 35.0,
    ph: 8.0,
    depth_m: 10.0,
    wind_m_per_s: 13.5 * 1.852 / 3.6,
    shipping: 0.5,
    spreading: 2.0,
    thorp: false,
};

/// Francois and Garrison (1982), part II, equations as in their summary: A₁P₁f₁f²/(f₁² + f²) + A₂P₂f₂f²/(f₂² + f²) +
/// A₃P₃f².
fn francois_garrison_db_per_km(water: &Water) -> f64 {
    let (t, s, d, f) = (water.celsius, water.salinity, water.depth_m, water.khz);
    let kelvin = t + 273.0;
    let speed = 1412.0 + 3.21 * t + 1.19 * s + 0.0167 * d;
    let f1 = 2.8 * (s / 35.0).powf(0.5) * 10f64.powf(4.0 - 1245.0 / kelvin);
    let f2 = 8.17 * 10f64.powf(8.0 - 1990.0 / kelvin) / (1.0 + 0.0018 * (s - 35.0));
    let a1 = 8.86 / speed * 10f64.powf(0.78 * water.ph - 5.0);
    let a2 = 21.44 * s / speed * (1.0 + 0.025 * t);
    let p2 = 1.0 - 1.37e-4 * d + 6.2e-9 * d.powi(2);
    let cold = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t.powi(2) - 1.50e-8 * t.powi(3);
    let warm = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t.powi(2) - 6.5e-10 * t.powi(3);
    let a3 = if t > 20.0 { warm } else { cold };
    let p3 = 1.0 - 3.83e-5 * d + 4.9e-10 * d.powi(2);
    // Without salt there is no boric acid.
    let boric = if s > 0.0 { a1 * f1 * f * f / (f1 * f1 + f * f) } else { 0.0 };
    boric + a2 * p2 * f2 * f * f / (f2 * f2 + f * f) + a3 * p3 * f * f
}

/// Thorp (1967) in Urick's form for kilometres and kHz.
fn thorp_db_per_km(f: f64) -> f64 {
    let squared = f.powi(2);
    0.11 * squared / (1.0 + squared) + 44.0 * squared / (4100.0 + squared) + 0.000275 * squared + 0.003
}

/// Coates (1990): turbulence, shipping, wind and thermal noise, as powers; and the vehicle's own.
fn noise_db(water: &Water, own_db: f64, bandwidth_khz: f64) -> f64 {
    let f = water.khz;
    let power = |level_db: f64| 10f64.powf(0.1 * level_db);
    let turbulence = power(17.0) / f.powi(3);
    let ships = power(40.0 + 20.0 * (water.shipping - 0.5)) * f.powf(2.6) / (f + 0.03).powi(6);
    let wind = power(50.0 + 7.5 * water.wind_m_per_s.sqrt()) * f.powi(2) / (f + 0.4).powi(4);
    let thermal = power(-15.0) * f.powi(2);
    10.0 * ((turbulence + ships + wind + thermal + power(own_db)) * 1000.0 * bandwidth_khz).log10()
}

/// The Gaussian distribution function, as ½ plus the area under the density by Simpson's rule.
fn gaussian_cdf(x: f64) -> f64 {
    let density = |x: f64| (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
    let (intervals, x) = (2000, x.clamp(-9.0, 9.0));
    let weight = |n: usize| if n == 0 || n == intervals { 1.0 } else { 2.0 + 2.0 * (n % 2) as f64 };
    let step = x / intervals as f64;
    0.5 + step / 3.0 * (0..=intervals).map(|n| weight(n) * density(n as f64 * step)).sum::<f64>()
}

/// The sonar equation over open water for the numbers of [`OPEN_WATER`].
fn expected_probability(row: &Row, water: &Water) -> f64 {
    let squares: f64 = row.from.iter().zip(row.to).map(|(from, to)| (from - to).powi(2)).sum();
    let range_m = squares.sqrt().max(1.0);
    let absorption = if water.thorp { thorp_db_per_km(water.khz) } else { francois_garrison_db_per_km(water) };
    let loss_db = water.spreading * 10.0 * range_m.log10() + absorption * range_m / 1000.0;
    gaussian_cdf((168.0 - loss_db - noise_db(water, 50.0, 5.0) - 10.0) / 7.0)
}

/// Options of open water with equal vehicles. All other values are those of [`BAY`].
const OPEN_WATER: &str = "--ridge-m 0 --mound-m 0 --self-noise-spread-db 0 --self-noise-db 50 --source-level-db 168 \
    --bandwidth-khz 5 --threshold-db 10 --fading-db 7 --area-m 2400 --slots 100 --depths";

fn follows_the_literature(options: &str, water: &Water) {
    let rows =
        rows(&OPEN_WATER.split(' ').chain(options.split(' ').filter(|word| !word.is_empty())).collect::<Vec<_>>());
    for row in &rows {
        let expected = expected_probability(row, water);
        assert!((row.p - expected).abs() < 5.01e-5, "{options:?}: {} and not {expected}", row.p);
    }
    let span = |low: f64, high: f64| rows.iter().any(|row| (low..high).contains(&row.p));
    assert!(span(0.02, 0.98), "{options:?}: a comparison of certainties says nothing");
}

#[test]
fn true_probabilities_match_the_published_formulas() {
    assert!((gaussian_cdf(1.0) - 0.841_344_746_068_543).abs() < 1e-12);
    follows_the_literature("", &BAY);
    follows_the_literature("--absorption thorp", &Water { thorp: true, ..BAY });
    follows_the_literature("--frequency-khz 40 --temperature-c -1", &Water { khz: 40.0, celsius: -1.0, ..BAY });
    // Beaufort 7, 28 to 33 knots, is sea state 6.
    let storm = Water { wind_m_per_s: 30.5 * 1.852 / 3.6, shipping: 1.0, ..BAY };
    follows_the_literature("--sea-state 6 --shipping 1", &storm);
}

#[test]
fn true_probabilities_of_a_lake_and_of_the_deep_sea_match_the_formulas() {
    let lake = Water { khz: 60.0, celsius: 22.0, salinity: 0.0, ph: 7.0, wind_m_per_s: 4.0, shipping: 0.0, ..BAY };
    let options = "--frequency-khz 60 --temperature-c 22 --salinity 0 --ph 7 --wind-m-per-s 4 --shipping 0";
    follows_the_literature(options, &lake);
    let deep = Water { khz: 30.0, celsius: 3.0, depth_m: 2000.0, spreading: 1.9, ..BAY };
    let options = "--frequency-khz 30 --temperature-c 3 --water-depth-m 2500 --depth-m 2000 --spreading 1.9";
    follows_the_literature(options, &deep);
}

/// Vehicles climb over a steep ridge. The range is that of a slanted line, and the ridge only lowers probabilities.
#[test]
fn a_ridge_never_raises_a_probability() {
    let ridge = "--water-depth-m 60 --depth-m 50 --ridge-m 50 --vehicles 6";
    let rows = rows(&OPEN_WATER.replace("--ridge-m 0", ridge).split_whitespace().collect::<Vec<_>>());
    let water = Water { depth_m: 50.0, ..BAY };
    let (mut slanted, mut hidden) = (0, 0);
    for row in &rows {
        let open = expected_probability(row, &water);
        assert!(row.p < open + 5.01e-5, "{} and over open water {open}", row.p);
        let clear = row.p > open - 5.01e-5 && open < 0.99;
        slanted += usize::from(clear && (row.from[2] - row.to[2]).abs() > 5.0);
        hidden += usize::from(row.p < open - 0.2);
    }
    assert!(slanted > 3 && hidden > 3, "{slanted} in sight at another depth, {hidden} hidden, of {}", rows.len());
}

#[test]
fn extreme_allowed_values_give_probabilities() {
    for options in [
        "--area-m 1e6 --slots 6",
        "--area-m 10",
        "--fading-db 1e-6",
        "--fading-db 100",
        "--threshold-db 200",
        "--threshold-db=-100",
        "--source-level-db 0",
        "--source-level-db 300",
        "--frequency-khz 1000",
        "--frequency-khz 1 --bandwidth-khz 0.001",
        "--vehicles 64 --slots 20",
        "--water-depth-m 11000 --depth-m 10997 --ridge-m 10996.5",
        "--water-depth-m 3.5 --depth-m 0.5 --ridge-m 0 --mound-m 0",
        "--self-noise-db 250 --self-noise-spread-db 50",
        "--self-noise-db=-100 --self-noise-spread-db 50 --wind-m-per-s 0 --shipping 0",
        "--salinity 0 --temperature-c=-2 --ph 5",
        "--salinity 45 --temperature-c 40 --ph 10",
        "--speed-m-per-s 0",
        "--speed-m-per-s 100 --slot-s 1e6",
        "--slots 1 --seed 18446744073709551615",
    ] {
        let mut arguments = vec!["--depths", "--slots", "30"];
        let options: Vec<&str> = options.split(' ').collect();
        arguments.truncate(if options.contains(&"--slots") { 1 } else { 3 });
        for row in rows(&[&arguments[..], &options].concat()) {
            assert!((0.0..=1.0).contains(&row.p), "{options:?}: {}", row.p);
            let numbers = row.from.iter().chain(&row.to).chain([&row.time_s]);
            assert!(numbers.into_iter().all(|number| number.is_finite()), "{options:?}: {:?} {:?}", row.from, row.to);
        }
    }
}

/// An earlier log.
const OLDER: &str = "time_s,tx_id,rx_id,tx_easting_m,older";

/// Asserts that the command refuses these options with a message that contains all of `expected`, and changes no file.
fn refused(options: &[&str], expected: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "trial.csv", OLDER);
    let output = pingmap(folder.path(), &[&["simulate", "--overwrite"], options].concat());
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{options:?}: {message}");
    assert_eq!(stdout(&output), "", "{options:?}");
    assert!(!message.contains("panicked"), "{options:?}: {message}");
    for expected in expected {
        assert!(message.contains(expected), "{options:?} should say {expected:?}: {message}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "{options:?} left a file behind");
    assert_eq!(std::fs::read_to_string(folder.path().join("trial.csv")).unwrap(), OLDER, "{options:?}");
}

#[test]
fn parameters_out_of_range_are_refused() {
    // The option, a word of the message, and a number that is too low.
    for (option, name, low) in [
        ("--slot-s", "slot", "-5"),
        ("--area-m", "area", "-5"),
        ("--speed-m-per-s", "speed", "-5"),
        ("--depth-m", "depth", "-5"),
        ("--frequency-khz", "frequency", "-5"),
        ("--bandwidth-khz", "bandwidth", "-5"),
        ("--source-level-db", "source level", "-5"),
        ("--spreading", "spreading", "-5"),
        ("--temperature-c", "temperature", "-5"),
        ("--salinity", "salinity", "-5"),
        ("--ph", "acidity", "-5"),
        ("--sea-state", "sea-state", "-5"),
        ("--wind-m-per-s", "wind", "-5"),
        ("--shipping", "shipping", "-5"),
        ("--self-noise-db", "own noise", "-500"),
        ("--self-noise-spread-db", "spread", "-5"),
        ("--threshold-db", "threshold", "-500"),
        ("--fading-db", "fading", "-5"),
        ("--noise-swing-db", "swing", "-5"),
        ("--noise-period-s", "period", "-5"),
        ("--water-depth-m", "water depth", "-5"),
        ("--ridge-m", "ridge", "-5"),
        ("--mound-m", "mound", "-5"),
    ] {
        // Negative numbers are accepted with an equals sign or without.
        refused(&[option, low], &[name, low, "expected a number"]);
        for value in ["NaN", "inf", "-inf", low] {
            refused(&[&format!("{option}={value}")], &[name, value, "expected a number"]);
        }
        for value in ["", "ten", "1e999"] {
            refused(&[&format!("{option}={value}")], &[]);
        }
    }
}

#[test]
fn numbers_of_vehicles_and_slots_out_of_range_are_refused() {
    for vehicles in ["0", "1", "65"] {
        refused(&["--vehicles", vehicles], &["vehicles", vehicles, "expected", "from 2 to 64"]);
    }
    refused(&["--slots", "0"], &["slots", "expected", "1"]);
    for option in ["--vehicles", "--slots", "--seed"] {
        for value in ["-5", "NaN", "inf", "1.5", "99999999999999999999999"] {
            refused(&[&format!("{option}={value}")], &[option, value]);
        }
    }
    // The largest number of events is a million.
    refused(&["--slots", "600000"], &["slots", "600000", "expected", "500000"]);
    refused(&["--vehicles", "64", "--slots", "18446744073709551615"], &["slots", "expected", "15873"]);
}

#[test]
fn a_sea_floor_without_room_for_vehicles_is_refused() {
    // 30 m of water, 3 m of them below a vehicle and half a metre above it.
    refused(&["--depth-m", "31"], &["depth of the vehicles", "31", "from 0.5 to 27"]);
    refused(&["--ridge-m", "30"], &["ridge", "30", "from 0 to 26.5"]);
    refused(&["--mound-m", "27"], &["mound", "27", "from 0 to 26.5"]);
    refused(&["--water-depth-m", "3"], &["water depth", "3", "from 3.5"]);
    // If the water is shallower than the depth of the vehicles, the error names that depth.
    refused(&["--water-depth-m", "8"], &["depth of the vehicles", "10", "from 0.5 to 5"]);
}

#[test]
fn a_missing_output_folder_exits_with_status_1() {
    let folder = tempfile::tempdir().unwrap();
    let output = pingmap(folder.path(), &["simulate", "--slots", "5", "-o", "nowhere/trial.csv"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("nowhere/trial.csv"), "{}", stderr(&output));
    assert_eq!(stdout(&output), "", "no summary of a log that is not there");
    assert!(is_empty(folder.path()));
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).unwrap().next().is_none()
}
