//! Every option of every command does something, or is refused: none is read and forgotten.

#![allow(clippy::unwrap_used)]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use common::*;
use rayon::prelude::*;

/// One option: its value, and what else must be given for it to matter.
type Case = (&'static str, &'static str, &'static str);

/// What decides how a model is had, for all commands that have one. All cases run on a log of two vehicles.
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
    ("--events-max", "12", ""),
];

/// Which events are left out.
const THINNED: &[Case] = &[("--seed", "9", "--events-max 12")];

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
    ("--repeat", "1", "--frames 60 --loss 0.5"),
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
    ("--spare-bytes", "2", "--online"),
    ("--splits", "splits.csv", "--frames 1"),
];

/// What it decides is the same for most logs; only `learn` says how. It is read in one place for all commands.
const CRITERION: Case = ("--criterion", "evidence", "");

/// The same: few logs ask for any.
const ADDITIONS: Case = ("--additions", "none", "");

const LEARN: &[Case] = &[
    ("--output", "other.toml", ""),
    ("--test-share", "0.3", ""),
    ("--place", "8", ""),
    ("--onto", "other.toml", "--place 8"),
    ("--origin", "44,9", ""),
    ("--crs", "EPSG:32619", ""),
    CRITERION,
    ADDITIONS,
    ("--json", "", ""),
];

/// Who and when, where the model tells them apart.
const ASKED: &[Case] = &[
    ("--transmitter", "bob", "--model offsets.toml"),
    ("--receiver", "new", "--model offsets.toml"),
    ("--time", "another-day", "--model offsets.toml"),
    ("--kind", "fast", "--model offsets.toml"),
];

const RISING: &[Case] =
    &[("--rising-beyond", "", "--prior-mean zero --kernel squared-exponential --length-scale-m 100")];

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
    ("--as", "rx", "--reciprocal no"),
    ("--output", "map.svg", ""),
    ("--origin", "44.1,9.8", "--output map.geojson --origin 44,9"),
    ("--crs", "EPSG:32619", "--output map.csv"),
    ("--join", "any", "--at 300,300 --at 100,100"),
    ("--bounds", "0,0,500,500", ""),
    ("--levels", "0.3", ""),
    ("--layers", "upper", ""),
    ("--with-events", "", ""),
    ("--title", "A_map", ""),
    ("--width-mm", "90", ""),
    ("--cell-m", "77", ""),
    ("--json", "", ""),
];

/// Where depths are known.
const DEEP: &[Case] = &[("--depth", "100", "")];

/// What every plan has of its own.
const PLAN: &[Case] = &[
    ("--as", "tx", "--json"),
    ("--output", "plan.svg", ""),
    ("--json", "", ""),
    ("--width-mm", "90", "--output plan.svg"),
    ("--title", "A_plan", "--output plan.svg"),
    ("--with-events", "", "--output plan.svg"),
];

const STANDOFF: &[Case] = &[
    ("--at", "300,300", ""),
    ("--probability", "0.3", ""),
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

/// What all plans learn from, tried with one of them.
const OF_ALL_PLANS: [&[Case]; 6] = [STANDOFF, ASKED, GIVEN, MODEL, WORK, THINNED];

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
    ("--listening", "auv3=0/1e10", "--always-sends"),
    ("--column", "heard.source=from", ""),
    ("--columns", "columns.toml", ""),
    ("--origin", "41,-70", ""),
    ("--crs", "EPSG:32619", ""),
    ("--always-sends", "", ""),
    ("--correct-clocks", "auv1", ""),
    ("--clock-off-s-max", "0", ""),
    ("--match-s", "0.001", ""),
    ("--message-s", "11", ""),
    ("--nav-gap-s-max", "5", ""),
    ("--sound-m-per-s", "300", ""),
    ("--overhear", "", "--column heard.destination=addressee"),
    ("--any-frame", "", "--column heard.frame=part"),
    ("--surfaced-above-m", "9.9", ""),
    ("--output", "imported.csv", ""),
    ("--json", "", ""),
];

const REPRODUCE: &[Case] =
    &[("--data", "events.csv", ""), ("--permutations", "3", ""), ("--seed", "9", ""), ("--json", "", "")];

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
    ("--sealed", "", ""),
    ("--depth", "", ""),
    ("--proto", "", ""),
    ("--json", "", ""),
];

/// Every command as it runs without options, and its options.
fn commands() -> Vec<(&'static str, Vec<&'static [Case]>)> {
    vec![
        ("demo", vec![DEMO]),
        ("replay events.csv --repeats 1 --frames 1", vec![REPLAY, GIVEN, MODEL, WORK, THINNED]),
        ("replay events.csv --model model.toml", vec![ONLINE]),
        ("check events.csv", vec![&[("--json", "", "")]]),
        ("learn events.csv", vec![LEARN, MODEL, WORK, THINNED]),
        ("predict events.csv --links links.csv", vec![PREDICT, ASKED, RISING, GIVEN, MODEL, WORK, THINNED]),
        ("map events.csv --at 500,200 --cell-m 150", vec![MAP, ASKED, RISING, GIVEN, MODEL, WORK, THINNED]),
        ("map deep.csv --at 500,200 --cell-m 150 --model deep.toml", vec![DEEP]),
        ("predict events.csv --links places.csv --origin 44,9", vec![&[("--origin", "44.001,9", "")]]),
        ("plan standoff deep.csv --at 500,200 --probability 0.4 --model deep.toml", vec![DEEP]),
        ("plan standoff events.csv --at 500,200", [&[PLAN][..], &OF_ALL_PLANS].concat()),
        ("plan track events.csv --at 9000,200 --along track.csv", vec![RISING]),
        ("plan track events.csv --at 500,200 --along track.csv --model model.toml", vec![PLAN, TRACK]),
        ("plan gateway events.csv --among other-track.csv --along track.csv --model model.toml", vec![PLAN, GATEWAY]),
        ("select events.csv --vehicle ada --radius-m 400", vec![SELECT, GIVEN, MODEL]),
        ("simulate --slots 300", vec![SIMULATE]),
        ("import --nav nav.csv --heard heard.csv --schedule schedule.toml --ids ids.csv", vec![IMPORT]),
        ("reproduce local --permutations 2", vec![REPRODUCE]),
        ("reproduce points --permutations 2", vec![&[("--out", "page", "")]]),
        ("team events.csv", vec![TEAM]),
        ("packet decode PACKET", vec![DECODE]),
        ("packet encode packet.json", vec![ENCODE]),
        ("packet schema", vec![SCHEMA]),
    ]
}

/// The files that options name.
fn prepare(folder: &Path) {
    let log = log(&["ada", "bob"], 40);
    let kinds = ["kind", "fast", "slow"].into_iter().chain(["fast", "slow"].into_iter().cycle());
    let of_kinds: String = log.lines().zip(kinds).map(|(line, kind)| format!("{line},{kind}\n")).collect();
    file(folder, "events.csv", of_kinds);
    file(folder, "other.csv", log.replace("200,500", "210,480"));
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
        "learn deep.csv --output deep.toml",
        "team events.csv --epoch 3 --frame-bytes 64",
    ] {
        let output = pingmap(folder, &arguments.split(' ').collect::<Vec<_>>());
        assert!(output.status.success(), "{arguments}: {}", stderr(&output));
    }
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    file(folder, "offsets.toml", read("model.toml") + OFFSETS);
    prepare_mission(folder, &read);
    file(folder, "packet.json", stdout(&pingmap(folder, &["packet", "decode", PACKET, "--json"])));
}

/// What three vehicles recorded, each kind of it in one table.
fn prepare_mission(folder: &Path, read: &dyn Fn(&str) -> String) {
    let simulate = "simulate --slots 90 --clock-off-s 2 --with-sent --as-files . --force -o recorded.csv";
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
            // A gap of ten seconds in what was recorded.
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

/// Vehicles and times that a model tells apart.
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

/// A packet of another team than the one above.
const PACKET: &str = "f8033412a5427a3815372e56c8decca4852877ca3d0286490c10c42044678508";

/// Exit status, what was said, and all files of the folder by name.
type Outcome = (Option<i32>, String, BTreeMap<PathBuf, Vec<u8>>);

/// Everything that a command says and writes, in a folder of its own. What it measured is not looked at.
fn outcome(template: &Path, arguments: &str) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(template).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
    }
    let arguments = arguments.replace("PACKET", PACKET);
    let output = pingmap(folder.path(), &arguments.split_whitespace().collect::<Vec<_>>());
    let timed = |line: &&str| !line.contains("seconds");
    let said = without_command(stdout(&output));
    let said = said.lines().filter(timed).collect::<Vec<_>>().join("\n");
    let mut files = BTreeMap::new();
    collect(folder.path(), Path::new(""), &mut files);
    (output.status.code(), said, files)
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

/// The command with an option, in the place of the same option where it is there.
fn given(base: &str, option: &str, value: &str) -> String {
    let mut words: Vec<&str> = base.split(' ').collect();
    if let Some(place) = words.iter().position(|word| *word == option) {
        words.drain(place..words.len().min(place + 2));
    }
    format!("{} {option} {value}", words.join(" "))
}

#[test]
fn every_option_of_every_command_changes_something_or_is_refused() {
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
    // A packet of another team than the one that is named.
    let may_be_refused = |arguments: &str| arguments.starts_with("packet") && arguments.contains("--team");
    let failed = outcomes.iter().filter(|(_, outcome)| outcome.0 != Some(0)).map(|(arguments, _)| *arguments);
    let failed: Vec<&String> = failed.filter(|arguments| !may_be_refused(arguments)).collect();
    assert_eq!(failed, [""; 0], "refused: choose other values");
    let forgotten = cases.iter().filter(|(given, base)| outcomes[given] == outcomes[base]).map(|(given, _)| given);
    assert_eq!(forgotten.collect::<Vec<_>>(), [""; 0], "nothing changes");
}

#[test]
fn every_option_is_among_those_cases() {
    let mut known: BTreeMap<Vec<&str>, BTreeSet<String>> = BTreeMap::new();
    for (command, parts) in commands() {
        let words: Vec<&str> = command.split(' ').collect();
        let name = if ["packet", "plan"].contains(&words[0]) { &words[..2] } else { &words[..1] };
        let options = parts.into_iter().flatten();
        known.entry(name.to_vec()).or_default().extend(options.map(|case| case.0.to_owned()));
        if words[0] == "plan" {
            let of_one = ["--at", "--probability", "--range-max-m"];
            let of_all = OF_ALL_PLANS.into_iter().chain([DEEP, RISING]).flatten().map(|case| case.0.to_owned());
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
            // The number of threads must change nothing, and what is refused otherwise is no case; all have tests of their own.
            .filter(|option| !["--help", "--threads", "--force", "--strict", "--quiet"].contains(&option.as_str()))
            .filter(|option| ![CRITERION.0, ADDITIONS.0].contains(&option.as_str()) || known.contains(option))
            .collect();
        assert_eq!(options, known, "{name:?}");
    }
}
