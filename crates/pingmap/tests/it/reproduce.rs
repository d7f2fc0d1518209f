//! `pingmap reproduce`: the page in docs matches the output of the command, and shows the results of the paper.

use std::path::Path;

use crate::common::{HEADER, file, json, pingmap, stderr, stdout};

/// Returns the page in docs, or prints that the test is skipped if the crate is tested alone.
fn page() -> Option<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reproduction.md");
    let page = std::fs::read_to_string(&path).ok();
    if page.is_none() {
        eprintln!("skipped: there is no {}", path.display());
    }
    page
}

/// The number of permutations of the page in docs.
const PERMUTATIONS: f64 = 100.0;

/// The number of permutations for the comparison.
const FEW: &str = "8";

/// Returns the rows of the tables of a page, each with the title of its table.
fn rows(page: &str) -> Vec<(&str, Vec<&str>)> {
    let mut title = "";
    let mut rows = Vec::new();
    for line in page.lines() {
        if let Some(bold) = line.strip_prefix("**") {
            title = bold.trim_end_matches("**");
        } else if let Some(cells) = line.strip_prefix("| ") {
            rows.push((title, cells.trim_end_matches(" |").split(" | ").collect()));
        }
    }
    rows
}

/// Returns all lines outside tables, without those that depend on the number of permutations.
fn text(page: &str) -> Vec<String> {
    let prose = page.lines().filter(|line| !line.starts_with('|') && !line.starts_with("All training events"));
    prose.map(|line| line.split(" The order ").next().unwrap_or_default().to_owned()).collect()
}

/// Parses mean and standard error of a cell like "✓ −.1234 ± .0012 [.0034]".
fn estimate(cell: &str) -> Option<(f64, f64)> {
    let cell = cell.split(" [").next()?.trim_start_matches(['✓', '✗', '≈', ' ']).replace('−', "-");
    let (mean, error) = cell.split_once(" ± ")?;
    Some((mean.parse().ok()?, error.parse().ok()?))
}

/// The row of means over data sets. Its ± is the error over data sets, not over permutations.
const OVER_SETS: &str = "teams, over data sets";

/// Returns the error over permutations of the mean over teams, from the rows of the teams.
fn error_of_mean_team(rows: &[(&str, Vec<&str>)], title: &str, column: usize) -> f64 {
    let teams = rows.iter().filter(|(of, row)| *of == title && row[0].ends_with(" team"));
    let errors: Vec<f64> = teams.map(|(_, row)| estimate(row[column]).unwrap().1).collect();
    errors.iter().map(|error| error.powi(2)).sum::<f64>().sqrt() / errors.len() as f64
}

/// Eight of the hundred permutations must agree with all hundred up to their standard errors. The length-scale, the
/// data, the regions and the text must be equal.
#[test]
fn the_page_matches_the_output_of_the_command() {
    let Some(page) = page() else { return };
    let folder = tempfile::tempdir().unwrap();
    let output = pingmap(folder.path(), &["reproduce", "--permutations", FEW, "--out", "."]);
    assert!(output.status.success(), "{}", stderr(&output));
    let again = std::fs::read_to_string(folder.path().join("reproduction.md")).unwrap();
    assert!(page.starts_with("The paper's field data are not public"), "the first line says what the data are");
    assert!(page.contains("`pingmap reproduce all --permutations 100 --seed 1 --out docs`"));
    let as_if_few = |page: &str| {
        let page =
            page.replace("--permutations 100", &format!("--permutations {FEW}")).replace("--out docs", "--out .");
        page.replace("100 permutations", &format!("{FEW} permutations"))
            .replace(", 100 times at random", &format!(", {FEW} times at random"))
    };
    assert_eq!(text(&as_if_few(&page)), text(&again), "headings, kernel, captions and notes");

    let (page, again) = (rows(&page), rows(&again));
    assert_eq!(page.len(), again.len());
    // Four standard errors of the difference between some of the permutations and all of them.
    let spread = 4.0 * (PERMUTATIONS / FEW.parse::<f64>().unwrap() - 1.0).sqrt();
    let mut compared = 0;
    for ((title, old), (_, new)) in page.iter().zip(&again) {
        assert_eq!(old.len(), new.len(), "{title}: {old:?}");
        assert_eq!(old[0], new[0], "{title}");
        if title.contains("events of every agent") {
            assert_eq!(old, new);
        }
        if title.starts_with("Locality") {
            assert_eq!(old[..4], new[..4], "radius, centre and events");
        }
        for (column, (old_cell, new_cell)) in old.iter().zip(new).enumerate() {
            if let (Some((mean, error)), Some((new, _))) = (estimate(old_cell), estimate(new_cell)) {
                let error = if old[0] == OVER_SETS { error_of_mean_team(&page, title, column) } else { error };
                assert!((mean - new).abs() <= spread * error + 5e-4, "{title}: {old_cell} is now {new_cell}");
                compared += 1;
            }
        }
    }
    assert!(compared > 900, "only {compared} figures were compared");
    for figure in ["tracks", "points", "predictions"] {
        for ending in ["svg", "png"] {
            let path = format!("reproduction/{figure}.{ending}");
            assert!(std::fs::metadata(folder.path().join(&path)).unwrap().len() > 10_000, "{path}");
            assert!(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(&path).exists(), "{path}");
        }
    }
}

/// Parses cells like "6 of 7" for every claim, in their order. The first claim is that two good points beat one. The
/// others are that good points beat random ones, and random ones beat bad ones, at two points and at one.
fn holding(page: &str, name: &str) -> Vec<(usize, usize)> {
    let rows = rows(page);
    let is_it = |title: &str| title.contains("in NLL") && title.contains("(1.384 ℓ)");
    let row = rows.iter().find(|(title, row)| is_it(title) && row[0] == name).unwrap();
    let parse = |cell: &&str| {
        let numbers: Vec<usize> = cell.split(' ').filter_map(|word| word.parse().ok()).collect();
        (numbers[0], numbers[1])
    };
    row.1[1..].iter().map(parse).collect()
}

#[test]
fn the_order_of_policies_holds_at_the_radius_of_the_paper() {
    let Some(page) = page() else { return };
    let (agents, teams) = (holding(&page, "agents for which it holds"), holding(&page, "teams for which it holds"));
    assert_eq!((agents[0], teams[0]), ((7, 7), (3, 3)), "two good points beat one");
    for claim in [1, 2] {
        assert!(agents[claim].0 >= 6, "{agents:?}");
        assert_eq!(teams[claim], (3, 3));
    }
}

/// With the data set as the unit, the mean and its error follow from the means of the teams.
#[test]
fn means_over_data_sets_follow_from_the_means_of_teams() {
    let Some(page) = page() else { return };
    let rows = rows(&page);
    let over: Vec<_> = rows.iter().filter(|(_, row)| row[0] == OVER_SETS).collect();
    assert_eq!(over.len(), 4);
    for (title, over) in over {
        for column in 1..over.len() {
            let teams = rows.iter().filter(|(of, row)| of == title && row[0].ends_with(" team"));
            let means: Vec<f64> = teams.map(|(_, row)| estimate(row[column]).unwrap().0).collect();
            let mean = means.iter().sum::<f64>() / 3.0;
            let squares = means.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
            let found = estimate(over[column]).unwrap();
            assert!((found.0 - mean).abs() < 1.1e-4, "{title}: {found:?} {means:?}");
            assert!((found.1 - (squares / 6.0).sqrt()).abs() < 1.1e-4, "{title}: {found:?} {means:?}");
            // Student's t with two degrees of freedom.
            assert_eq!(over[column].starts_with('≈'), found.0.abs() <= 4.303 * found.1, "{title}: {}", over[column]);
        }
    }
}

#[test]
fn reproduction_does_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "two.csv", own_log(120));
    file(folder.path(), "three.csv", crate::common::log(&["a", "b", "c"], 150));
    let files = ["reproduction.md", "reproduction/points.png", "reproduction/predictions.svg"];
    let run = |threads: &str| {
        let data = ["reproduce", "--data", "two.csv", "--data", "three.csv", "--permutations", "5", "--seed", "5"];
        let output = pingmap(
            folder.path(),
            &[&data[..], &["--json", "--out", "out", "--overwrite", "--threads", threads]].concat(),
        );
        assert!(output.status.success(), "{}", stderr(&output));
        let written = files.map(|name| std::fs::read(folder.path().join("out").join(name)).unwrap());
        (crate::common::without_command(stdout(&output)), written)
    };
    let (one, two) = (run("1"), run("2"));
    assert!(one == two, "the output depends on the number of threads");
    let printed: serde_json::Value = serde_json::from_str(&one.0).unwrap();
    assert_eq!(printed["schema"], 1);
    assert_eq!(printed["radii"][0]["data_sets"][1]["agents"].as_array().unwrap().len(), 3);
    assert_eq!(printed["sweep"][0]["rows"].as_array().unwrap().len(), 6);
}

/// Returns a log of two vehicles on crossing tracks that receive each other at short range.
fn own_log(count: usize) -> String {
    crate::common::log(&["a", "b"], count)
}

#[test]
fn own_data_replace_those_of_the_paper() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("logs")).unwrap();
    file(&folder.path().join("logs"), "second.csv", own_log(60));
    file(&folder.path().join("logs"), "first.csv", own_log(80));
    file(&folder.path().join("logs"), "first.splits.csv", "s0\n1\n");
    file(folder.path(), "third.csv", own_log(40));
    let arguments = ["reproduce", "local", "--data", "logs", "--data", "third.csv", "--permutations", "3", "--json"];
    let printed = json(folder.path(), &arguments);
    let names: Vec<&str> =
        printed["data_sets"].as_array().unwrap().iter().map(|set| set["data_set"].as_str().unwrap()).collect();
    assert_eq!(names, ["first", "second", "third"]);
    assert!(printed["caveat"].as_str().unwrap().contains("first, second, third"));
    // The first data set has two agents, as in the paper, so the published numbers are printed. The third differs.
    let published = |set: usize| &printed["data_sets"][set]["agents"][0]["published"];
    assert!(published(0).is_object() && published(2).is_null());
    assert!(!folder.path().join("pingmap-reproduction").exists(), "a table needs no folder");
}

#[test]
fn degenerate_logs_give_finite_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let line = |n: usize, rx: &str, east: usize, success: u8| format!("{n},t,{rx},0,{east},500,0,{success}\n");
    let same: String = (0..20).map(|n| line(n, "a", 0, 1)).collect();
    let heard: String = (0..20).map(|n| line(n, "a", 10 * n, 1)).collect();
    for (name, lines) in [("one", line(0, "a", 0, 1)), ("same", same), ("heard", heard)] {
        let log = file(folder.path(), "log.csv", format!("{HEADER}\n{lines}"));
        let arguments = [
            "reproduce",
            "--data",
            log.to_str().unwrap(),
            "--permutations",
            "2",
            "--out",
            name,
            "--overwrite",
            "--accept-bad-log",
        ];
        let output = pingmap(folder.path(), &arguments);
        assert!(output.status.success(), "{name}: {}", stderr(&output));
        for bad in ["NaN", "inf "] {
            assert!(!stdout(&output).contains(bad), "{name}: {}", stdout(&output));
        }
    }
}

#[test]
fn invalid_data_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    file(folder.path(), "bad.csv", format!("{HEADER}\n1,a,b,0,0,1,1,2\n"));
    for (data, expected) in [
        ("empty", "no event logs; expected files that end in .csv"),
        ("nowhere", "cannot be read"),
        ("bad.csv", "line 2, column success"),
    ] {
        let output = pingmap(folder.path(), &["reproduce", "--data", data, "--out", "out"]);
        assert_eq!(output.status.code(), Some(2), "{data}: {}", stderr(&output));
        assert!(stderr(&output).contains(expected), "{data}: {}", stderr(&output));
        assert!(!folder.path().join("out").exists());
    }
    for arguments in [["--permutations", "0"], ["nothing", "--json"]] {
        assert_eq!(pingmap(folder.path(), &[&["reproduce"], &arguments[..]].concat()).status.code(), Some(2));
    }
}
