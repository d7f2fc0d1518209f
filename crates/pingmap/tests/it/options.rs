//! Every option of every command has an effect.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::common::*;
use rayon::prelude::*;

/// One option, its value, and the other options that it needs for an effect.
type Case = (&'static str, &'static str, &'static str);

/// Options of the model, for the commands that learn one as requested. All cases use a log of two vehicles.
const MODEL: &[Case] = &[
    ("--kernel", "matern52", ""),
    ("--inputs", "raw", ""),
    ("--reciprocal", "no", ""),
    ("--terms", "path-receiver-range", ""),
    ("--prior-mean", "constant", ""),
    ("--conservative-range-m", "300", ""),
    ("--conservative-slope-per-km", "20", "--conservative-range-m 300"),
    ("--length-scale-m", "200", ""),
    ("--variance", "9", ""),
    ("--fading", "0.9,1000,100", ""),
    ("--learn-events-max", "20", ""),
];

/// The largest number of events.
const EVENTS: &[Case] = &[("--events-max", "12", "")];

/// Options of the choice of events.
const THINNED: &[Case] = &[EVENTS[0], ("--seed", "9", "--events-max 12")];

const GIVEN: &[Case] = &[("--model", "other.toml", "")];

/// Bounds on a fit.
const WORK: &[Case] =
    &[("--dense-events-max", "10", "--inducing-points-max 5"), ("--inducing-points-max", "5", "--dense-events-max 10")];

const DEMO: &[Case] = &[("--out", "other.html", ""), ("--json", "", "")];

const REPLAY: &[Case] = &[
    ("--repeats", "3", ""),
    ("--test-share", "0.5", ""),
    ("--split-by", "time", ""),
    ("--whole-transmissions", "", ""),
    ("--write-splits", "written.csv", ""),
    ("--frames", "1,2,3", ""),
    ("--team", "team.toml", ""),
    ("--frame-bytes", "64", ""),
    ("--key-file", "key.hex", ""),
    ("--loss", "0.5", ""),
    ("--duplicate", "0.5", "--json"),
    ("--reorder", "0.5", "--json"),
    ("--share", "summaries", ""),
    ("--compare", "", ""),
    ("--calibration", "", ""),
    ("--report", "report.html", ""),
    ("--learn", "own", ""),
    ("--origin", "44,9", "--json"),
    ("--crs", "EPSG:32619", "--json"),
    ("--json", "", ""),
];

const ONLINE: &[Case] = &[
    ("--online", "", ""),
    ("--slot-every", "3", "--online"),
    ("--piggyback-bytes", "2", "--online"),
    ("--animate", "mission.html", "--online"),
    ("--splits", "splits.csv", "--frames 1"),
];

/// The option rarely changes the chosen model. All commands read it in one place.
const ADDITIONS: Case = ("--additions", "none", "");

const LEARN: &[Case] = &[
    ("--output", "elsewhere.toml", ""),
    ("--test-share", "0.3", ""),
    ("--site-prior", "8", ""),
    ("--update", "other.toml", "--site-prior 8"),
    ("--origin", "44,9", ""),
    ("--crs", "EPSG:32619", ""),
    ADDITIONS,
    ("--json", "", ""),
];

/// Options of queries, with a model of vehicles, times and kinds.
const ASKED: &[Case] = &[
    ("--transmitter", "bob", "--model offsets.toml"),
    ("--receiver", "new", "--model offsets.toml"),
    ("--time", "another-day", "--model offsets.toml"),
    ("--kind", "fast", "--model offsets.toml"),
];

const NO_CAP: &[Case] = &[("--no-range-cap", "", "--model short.toml")];

const PREDICT: &[Case] = &[
    ("--vehicle", "ada", ""),
    ("--crs", "EPSG:32632", "--json"),
    ("--links", "other-links.csv", ""),
    ("--output", "predicted.csv", ""),
    ("--json", "", ""),
];

const MAP: &[Case] = &[
    ("--vehicle", "ada", ""),
    ("--at", "300,300", ""),
    ("--as", "rx", "--model one-way.toml"),
    ("--output", "map.svg", ""),
    ("--origin", "44.1,9.8", "--output map.geojson --origin 44,9"),
    ("--crs", "EPSG:32619", "--output map.csv"),
    ("--join", "any", "--at 300,300 --at 100,100"),
    ("--bounds", "0,0,500,500", ""),
    ("--levels", "0.3", ""),
    ("--hatch-width", "0.2", ""),
    ("--layers", "upper", ""),
    ("--with-events", "", ""),
    ("--title", "A_map", ""),
    ("--width-mm", "90", ""),
    ("--cell-m", "77", ""),
    ("--heading", "90", "--model aspect.toml"),
    ("--json", "", ""),
];

/// Options for logs with depths.
const DEEP: &[Case] = &[("--depth", "100", "")];

/// Options of every plan.
const PLAN: &[Case] = &[
    ("--probability", "0.3", ""),
    ("--as", "tx", "--json"),
    ("--output", "plan.svg", ""),
    ("--json", "", ""),
    ("--width-mm", "90", "--output plan.svg"),
    ("--title", "A_plan", "--output plan.svg"),
    ("--with-events", "", "--output plan.svg"),
];

const STANDOFF: &[Case] = &[
    ("--at", "300,300", ""),
    ("--range-max-m", "200", ""),
    ("--vehicle", "ada", ""),
    ("--origin", "44.1,9.8", "--output plan.geojson --origin 44,9"),
    ("--crs", "EPSG:32619", "--json"),
];

const TRACK: &[Case] = &[
    ("--at", "300,300", ""),
    ("--along", "other-track.csv", ""),
    ("--join", "any", "--at 300,300 --at 100,100"),
    ("--speed-m-per-s", "3", ""),
    ("--every-s", "20", ""),
];

const GATEWAY: &[Case] = &[
    ("--among", "track.csv", ""),
    ("--along", "other-track.csv", ""),
    ("--speed-m-per-s", "3", ""),
    ("--every-s", "20", ""),
];

/// Options that all plans have, tried with one plan.
const OF_ALL_PLANS: [&[Case]; 5] = [STANDOFF, ASKED, GIVEN, WORK, THINNED];

const SELECT: &[Case] = &[
    ("--vehicle", "bob", ""),
    ("--centre", "400,200,500,100", ""),
    ("--radius-m", "200", ""),
    ("--points", "3", ""),
    ("--policy", "random", ""),
    ("--seed", "9", "--policy random"),
    ("--origin", "44,9", "--json"),
    ("--crs", "EPSG:32619", "--json"),
    ("--json", "", ""),
];

const SIMULATE: &[Case] = &[
    ("--vehicles", "4", ""),
    ("--slots", "301", ""),
    ("--slot-s", "7", ""),
    ("--area-m", "900", ""),
    ("--speed-m-per-s", "2", ""),
    ("--depth-m", "7", "--depths"),
    ("--seed", "9", ""),
    ("--output", "simulated.csv", ""),
    ("--depths", "", ""),
    ("--frequency-khz", "9", ""),
    ("--bandwidth-khz", "9", ""),
    ("--source-level-db", "150", ""),
    ("--spreading", "1.2", ""),
    ("--absorption", "thorp", ""),
    ("--temperature-c", "25", ""),
    ("--salinity", "5", ""),
    ("--ph", "7.7", "--frequency-khz 2"),
    ("--sea-state", "6", ""),
    ("--wind-m-per-s", "20", ""),
    ("--shipping", "1", "--frequency-khz 0.5 --bandwidth-khz 0.2"),
    ("--self-noise-db", "80", ""),
    ("--self-noise-spread-db", "20", ""),
    ("--threshold-db", "30", ""),
    ("--fading-db", "15", ""),
    ("--direction-loss-db", "8", ""),
    ("--favoured-bearing-deg", "90", "--direction-loss-db 8"),
    ("--noise-swing-db", "10", ""),
    ("--noise-period-s", "600", "--noise-swing-db 10"),
    ("--water-depth-m", "15", "--depths"),
    ("--ridge-m", "5", ""),
    ("--mound-m", "5", ""),
    ("--as-files", "folder", ""),
    ("--files", "alog", "--as-files folder"),
    ("--clock-off-s", "2", ""),
    ("--stops", "auv1=0.5", "--as-files folder"),
    ("--with-sent", "", "--as-files folder"),
    ("--origin", "10,10", "--as-files folder"),
    ("--start", "0", "--as-files folder"),
    ("--json", "", "--output simulated.csv"),
];

const IMPORT: &[Case] = &[
    ("--nav", "other-nav.csv", ""),
    ("--heard", "other-heard.csv", ""),
    ("--sent", "sent.csv", ""),
    ("--acomms-prefix", "MM_", "more.alog"),
    ("--fixed", "auv1=100,100", "--origin 41.5,-70.6"),
    ("--schedule", "listed.csv", ""),
    ("--ids", "other-ids.csv", ""),
    ("--listening", "auv3=0/1e10", "--always-transmits"),
    ("--not-listening", "auv3=2026-05-03T12:00:00Z/2026-05-03T12:10:00Z", "--always-transmits"),
    ("--column", "heard.source=from", ""),
    ("--columns", "columns.toml", ""),
    ("--origin", "41,-70", ""),
    ("--crs", "EPSG:32619", ""),
    ("--always-transmits", "", ""),
    ("--correct-clocks", "auv1", ""),
    ("--clock-offset-s-max", "0", ""),
    ("--match-s", "0.001", ""),
    ("--message-s", "11", ""),
    ("--nav-gap-s-max", "5", ""),
    ("--sound-m-per-s", "300", ""),
    ("--overhear", "", "--column heard.destination=addressee"),
    ("--any-frame", "", "--column heard.frame=part"),
    ("--surfaced-above-m", "9.9", ""),
    ("--output", "elsewhere.csv", ""),
    ("--json", "", ""),
];

const IMPORT_EVENTS: &[Case] = &[("--events", "other-table.csv", ""), ("--time-zone", "+02:00", "")];

const REPRODUCE: &[Case] = &[("--seed", "9", ""), ("--json", "", ""), ("--out", "page", "")];

const TEAM: &[Case] = &[
    ("--model", "other.toml", ""),
    ("--key-file", "key.hex", ""),
    ("--frame-bytes", "256", ""),
    ("--epoch", "7", ""),
    ("--cell-m", "33", ""),
    ("--start-s", "-100", ""),
    ("--duration-s", "5000", ""),
    ("--output", "other-team.toml", ""),
    ("--json", "", ""),
];

const DECODE: &[Case] = &[("--team", "team.toml", ""), ("--json", "", "")];

const ENCODE: &[Case] = &[("--team", "team.toml", ""), ("--json", "", "")];

const SCHEMA: &[Case] = &[
    ("--frame-bytes", "64", ""),
    ("--report", "", ""),
    ("--authenticated", "", ""),
    ("--depth", "", ""),
    ("--proto", "", ""),
    ("--json", "", ""),
];

const VEHICLE: &[Case] = &[("--config", "other-vehicle.toml", ""), ("--check", "", ""), ("--example", "", "")];

const STORE_CHECK: &[Case] = &[("--json", "", "")];

const STORE_EXPORT: &[Case] = &[("--team", "team-of-another.toml", ""), ("--output", "exported.csv", "")];

/// Every command, and its options.
fn commands() -> Vec<(&'static str, Vec<&'static [Case]>)> {
    vec![
        ("demo", vec![DEMO]),
        ("replay events.csv --repeats 1 --frames 1", vec![REPLAY, GIVEN, MODEL, WORK, THINNED]),
        ("replay events.csv --model model.toml", vec![ONLINE]),
        (
            "check events.csv",
            vec![&[
                ("--json", "", ""),
                ("--schedule", "own-slots.csv", ""),
                ("--ids", "own-ids.csv", "--schedule own-slots.csv"),
            ]],
        ),
        ("learn events.csv --output learned.toml", vec![LEARN, MODEL, WORK, THINNED]),
        ("predict events.csv --links links.csv", vec![PREDICT, ASKED, NO_CAP, GIVEN, WORK, THINNED]),
        ("map events.csv --at 500,200 --cell-m 150", vec![MAP, ASKED, NO_CAP, GIVEN, WORK, THINNED]),
        ("map deep.csv --at 500,200 --cell-m 150 --model deep.toml", vec![DEEP]),
        ("predict events.csv --links places.csv --origin 44,9", vec![&[("--origin", "44.001,9", "")]]),
        ("plan standoff deep.csv --at 500,200 --probability 0.4 --model deep.toml", vec![DEEP]),
        ("plan standoff events.csv --at 500,200", [&[PLAN][..], &OF_ALL_PLANS].concat()),
        ("plan track events.csv --at 9000,200 --along track.csv", vec![NO_CAP]),
        ("plan track events.csv --at 500,200 --along track.csv --model model.toml", vec![PLAN, TRACK]),
        ("plan gateway events.csv --among other-track.csv --along track.csv --model model.toml", vec![PLAN, GATEWAY]),
        ("select events.csv --vehicle ada --radius-m 400", vec![SELECT, GIVEN, EVENTS]),
        ("simulate --slots 300", vec![SIMULATE]),
        (
            "import --nav nav.csv --heard heard.csv --schedule schedule.toml --ids ids.csv --output imported.csv --accept-bad-log",
            vec![IMPORT],
        ),
        ("import --events table.csv --output imported.csv", vec![IMPORT_EVENTS]),
        ("reproduce local --permutations 1", vec![&[("--data", "events.csv", ""), ("--permutations", "2", "")]]),
        ("reproduce points --permutations 2", vec![REPRODUCE]),
        ("team events.csv --output new-team.toml", vec![TEAM]),
        ("packet decode PACKET", vec![DECODE]),
        ("packet encode packet.json", vec![ENCODE]),
        ("packet schema", vec![SCHEMA]),
        ("vehicle", vec![VEHICLE]),
        ("store check ada.redb", vec![STORE_CHECK]),
        ("store export ada.redb", vec![STORE_EXPORT]),
    ]
}

/// Writes the files that options name.
fn prepare(folder: &Path) {
    let log = log(&["ada", "bob"], 40);
    let kinds = ["kind", "fast", "slow"].into_iter().chain(["fast", "slow"].into_iter().cycle());
    let of_kinds: String = log.lines().zip(kinds).map(|(line, kind)| format!("{line},{kind}\n")).collect();
    file(folder, "events.csv", of_kinds);
    file(folder, "other.csv", log.replace("200,500", "210,480"));
    let table = "time,tx,rx,tx_x,tx_y,rx_x,rx_y,heard\n2026-05-03 12:00:00,ada,bob,0,0,50,90,yes\n2026-05-03 12:01:00,bob,ada,50,90,0,0,no\n";
    file(folder, "own-slots.csv", "time_s,source\n0,ada\n");
    file(folder, "own-ids.csv", "id,name\nada,bob\n");
    file(folder, "table.csv", table);
    file(folder, "other-table.csv", table.replace("12:00", "13:00"));
    let splits: String = (0..40).map(|n| if n % 4 == 0 { "1\n" } else { "0\n" }).collect();
    file(folder, "splits.csv", format!("split_0\n{splits}"));
    let links = "tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m\n100,200,500,300\n9000,200,500,300\n";
    file(folder, "links.csv", links);
    file(folder, "other-links.csv", links.replace("100,", "900,"));
    let places = "tx_latitude_deg,tx_longitude_deg,rx_latitude_deg,rx_longitude_deg\n44.001,9.001,44.004,9.006\n";
    file(folder, "places.csv", places);
    file(folder, "track.csv", "x,y\n100,100\n500,400\n");
    file(folder, "other-track.csv", "x,y\n100,100\n500,900\n");
    let deep = ["tx_depth_m,rx_depth_m", "3,9", "9,3"].into_iter().chain(["2,7", "8,5"].into_iter().cycle());
    file(folder, "deep.csv", log.lines().zip(deep).map(|(line, deep)| format!("{line},{deep}\n")).collect::<String>());
    file(folder, "key.hex", "0123456789abcdef".repeat(4));
    for arguments in [
        "learn events.csv",
        "learn events.csv --kernel rational-quadratic --output other.toml",
        "learn events.csv --reciprocal no --output one-way.toml",
        "learn events.csv --prior-mean zero --kernel squared-exponential --length-scale-m 100 --output short.toml",
        "learn deep.csv --output deep.toml",
        "team events.csv --epoch 3 --frame-bytes 64",
    ] {
        let output = pingmap(folder, &arguments.split(' ').collect::<Vec<_>>());
        assert!(output.status.success(), "{arguments}: {}", stderr(&output));
    }
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    file(folder, "offsets.toml", read("model.toml") + OFFSETS);
    file(folder, "aspect.toml", read("model.toml") + ASPECT);
    prepare_mission(folder, &read);
    for (name, vehicle) in [("vehicle.toml", "ada"), ("other-vehicle.toml", "bob")] {
        file(folder, name, format!("schema = 1\nvehicle = \"{vehicle}\"\nteam = \"team.toml\"\n"));
    }
    // The vehicle ends with its input, and leaves a store.
    for arguments in [&["vehicle"][..], &["team", "events.csv", "--output", "team-of-another.toml"]] {
        let output = pingmap(folder, arguments);
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    }
    file(folder, "packet.json", stdout(&pingmap(folder, &["packet", "decode", PACKET, "--json"])));
}

/// Writes the records of three vehicles, one table for each kind.
fn prepare_mission(folder: &Path, read: &dyn Fn(&str) -> String) {
    let simulate = "simulate --slots 90 --clock-off-s 2 --with-sent --as-files . --overwrite -o recorded.csv";
    let output = pingmap(folder, &simulate.split(' ').collect::<Vec<_>>());
    assert!(output.status.success(), "{}", stderr(&output));
    for (kind, header, more) in [
        ("nav", "vehicle,time,latitude,longitude,depth_m", ""),
        ("heard", "vehicle,time,source,destination,from,addressee,part", ",3,1,2"),
        ("sent", "vehicle,time,destination", ""),
    ] {
        let mut all = format!("{header}\n");
        for id in ["auv1", "auv2", "auv3"] {
            let name = format!("{id}.{kind}.csv");
            // The records have a gap of ten seconds.
            let text = read(&name);
            let lines = text.lines().skip(1).filter(|line| !line.contains("T12:05:1"));
            all.extend(lines.map(|line| format!("{id},{line}{more}\n")));
            std::fs::remove_file(folder.join(name)).unwrap();
        }
        file(folder, &format!("{kind}.csv"), all);
    }
    file(folder, "other-nav.csv", read("nav.csv").replace("-70.66", "-70.65"));
    file(folder, "other-heard.csv", read("heard.csv").replacen("\nauv1", "\nauv2", 1));
    file(folder, "listed.csv", "time_s,source\n2026-05-03T12:00:10Z,auv1\n2026-05-03T12:00:20Z,auv2\n");
    file(folder, "other-ids.csv", "id,name\n1,auv2\n2,auv1\n3,auv3\n63,broadcast\n");
    let row = "%% LOGSTART 1777809600\n1 NODE_REPORT_LOCAL p NAME=auv1\n140 MM_NMEA_IN p $CAMUA,2,63,00\n";
    file(folder, "more.alog", format!("%% LOG FILE: more\n{row}"));
    file(folder, "columns.toml", "[heard]\nsource = \"from\"\n");
}

/// A term of the aspect of the receiver.
const ASPECT: &str = "
[[kernel]]
shape = \"matern32\"
variance = 2.0
columns = [\"rx_ahead\", \"rx_starboard\"]
length_scale = 1.0

[[kernel.times]]
shape = \"label\"
columns = [\"rx_heading\"]
";

/// Terms of a model for vehicles, kinds of messages and times.
const OFFSETS: &str = "
[[kernel]]
shape = \"label\"
variance = 2.0
columns = [\"rx_vehicle\"]

[[kernel]]
shape = \"label\"
variance = 2.0
columns = [\"tx_vehicle\"]

[[kernel]]
shape = \"label\"
variance = 2.0
columns = [\"kind\"]

[[kernel]]
shape = \"matern12\"
variance = 1.0
columns = [\"time\"]
length_scale_s = 300.0

[[kernel.times]]
shape = \"label\"
columns = [\"water\"]
";

/// A packet of another team.
const PACKET: &str = "f8033412a5427a3815372e56c8decca4852877ca3d0286490c10c42044678508";

/// Exit status, standard output, and all files of the folder by name.
type Outcome = (Option<i32>, String, BTreeMap<PathBuf, Vec<u8>>);

/// Runs a command in its own folder, and returns its output and files. Measured times are ignored.
fn outcome(template: &Path, arguments: &str) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(template).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let arguments = arguments.replace("PACKET", PACKET);
    let output = pingmap(folder.path(), &arguments.split_whitespace().collect::<Vec<_>>());
    let timed = |line: &&str| !line.contains("seconds");
    let message = without_command(stdout(&output));
    let message = message.lines().filter(timed).collect::<Vec<_>>().join("\n");
    let mut files = BTreeMap::new();
    collect(folder.path(), Path::new(""), &mut files);
    (output.status.code(), message, files)
}

fn collect(folder: &Path, name: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let (path, name) = entry.map(|entry| (entry.path(), name.join(entry.file_name()))).unwrap();
        if path.is_dir() {
            collect(&path, &name, files);
        } else {
            files.insert(name, std::fs::read(&path).unwrap());
        }
    }
}

/// Returns the command with an option. It replaces the same option of the command.
fn given(base: &str, option: &str, value: &str) -> String {
    let mut words: Vec<&str> = base.split(' ').collect();
    if let Some(place) = words.iter().position(|word| *word == option) {
        words.drain(place..words.len().min(place + 2));
    }
    format!("{} {option} {value}", words.join(" "))
}

#[test]
fn every_option_changes_the_result() {
    let folder = tempfile::tempdir().unwrap();
    prepare(folder.path());
    let cases = |(command, parts): (&str, Vec<&'static [Case]>)| {
        let case = |&(option, value, with): &Case| {
            let base = format!("{command} {with}").trim().to_owned();
            (given(&base, option, value), base)
        };
        parts.into_iter().flatten().map(case).collect::<Vec<_>>()
    };
    let cases: Vec<(String, String)> = commands().into_iter().flat_map(cases).collect();
    let all: BTreeSet<&String> = cases.iter().flat_map(|(given, base)| [given, base]).collect();
    let outcomes: BTreeMap<&String, Outcome> =
        all.into_par_iter().map(|arguments| (arguments, outcome(folder.path(), arguments))).collect();
    // Packet and store belong to another team than the file.
    let is_of_team = |arguments: &str| arguments.starts_with("packet") || arguments.starts_with("store");
    let may_be_refused = |arguments: &str| is_of_team(arguments) && arguments.contains("--team");
    let refused = outcomes.iter().filter(|(_, outcome)| outcome.0 != Some(0)).map(|(arguments, _)| *arguments);
    let refused: Vec<&String> = refused.filter(|arguments| !may_be_refused(arguments)).collect();
    assert_eq!(refused, [""; 0], "refused: choose other values");
    let unused = cases.iter().filter(|(given, base)| outcomes[given] == outcomes[base]).map(|(given, _)| given);
    assert_eq!(unused.collect::<Vec<_>>(), [""; 0], "no effect");
}

#[test]
fn the_cases_contain_every_option() {
    let mut known: BTreeMap<Vec<&str>, BTreeSet<String>> = BTreeMap::new();
    for (command, parts) in commands() {
        let words: Vec<&str> = command.split(' ').collect();
        let name = if ["packet", "plan", "store"].contains(&words[0]) { &words[..2] } else { &words[..1] };
        let options = parts.into_iter().flatten();
        known.entry(name.to_vec()).or_default().extend(options.map(|case| case.0.to_owned()));
        if words[0] == "plan" {
            let of_one = ["--at", "--probability", "--range-max-m"];
            let of_all = OF_ALL_PLANS.into_iter().chain([DEEP, NO_CAP]).flatten().map(|case| case.0.to_owned());
            known.entry(name.to_vec()).or_default().extend(of_all.filter(|option| !of_one.contains(&option.as_str())));
        }
    }
    for (name, known) in known {
        let folder = tempfile::tempdir().unwrap();
        let help = stdout(&pingmap(folder.path(), &[name.as_slice(), &["--help"]].concat()));
        let is_option = |word: &&str| word.starts_with("--") && word.len() > 2;
        let listed = help.lines().map(str::trim_start).filter(|line| line.starts_with('-'));
        let options: BTreeSet<String> = listed
            .filter_map(|line| line.split([' ', ',', '[']).find(is_option).map(str::to_owned))
            // The number of threads must have no effect. The other options here have their own tests.
            .filter(|option| {
                ![
                    "--help",
                    "--threads",
                    "--overwrite",
                    "--accept-bad-log",
                    "--strict",
                    "--quiet",
                    "--unpacked-max",
                    "--adopt-store",
                ]
                .contains(&option.as_str())
            })
            .filter(|option| option != ADDITIONS.0 || known.contains(option))
            .collect();
        assert_eq!(options, known, "{name:?}");
    }
}
