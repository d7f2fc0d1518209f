//! Every command line of the documents and of the help runs as it is printed.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::*;
use crate::help::COMMANDS;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Runs a command line by the shell, with the program on the path.
fn shell(folder: &Path, line: &str) -> Output {
    let program = Path::new(env!("CARGO_BIN_EXE_pingmap")).parent().expect("the program lies in a folder");
    let path = std::env::join_paths(
        std::iter::once(program.to_owned()).chain(std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())),
    );
    let path = path.expect("folders of the path have no separator in their names");
    Command::new("sh").args(["-c", line]).current_dir(folder).env("PATH", path).output().expect("a shell")
}

fn run(folder: &Path, line: &str) -> Output {
    let output = shell(folder, line);
    assert!(output.status.success(), "{line}: {}", stderr(&output));
    output
}

/// Copies the files of the example mission to a folder.
fn copy_mission(folder: &Path) {
    std::fs::create_dir_all(folder).unwrap();
    for entry in std::fs::read_dir(root().join("examples/mission")).unwrap() {
        let file = entry.unwrap().path();
        std::fs::copy(&file, folder.join(file.file_name().unwrap())).unwrap();
    }
}

/// Runs the command lines of a page in the order in which they are printed, and returns their number. Lines after a
/// command that starts with `$` are its output. The folder `mission` of the page has the files of the example mission.
fn run_page(page: &str, mission: &str) -> usize {
    let text = std::fs::read_to_string(root().join(page)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    copy_mission(&folder.path().join(mission));
    let mut count = 0;
    let mut printed: Option<Vec<String>> = None;
    for line in text.lines() {
        let shows_output = line.starts_with("$ pingmap ");
        if let Some(command) =
            line.strip_prefix("$ ").or(line.strip_prefix("    ")).filter(|l| l.starts_with("pingmap "))
        {
            let output = run(folder.path(), command);
            count += 1;
            let lines = format!("{}{}", stdout(&output), stderr(&output));
            printed = shows_output.then(|| lines.lines().map(without_decimals).collect());
        } else if line.starts_with("```") {
            printed = None;
        } else if let Some(printed) = &printed {
            let expected = without_decimals(line.trim_end_matches("..."));
            assert!(printed.iter().any(|line| line.starts_with(&expected)), "{page}: {line}\nfound {printed:#?}");
        }
    }
    count
}

/// Replaces digits after a decimal point, which may differ between machines.
fn without_decimals(line: &str) -> String {
    let mut is_decimal = false;
    let characters = line.chars().map(|character| {
        is_decimal = character == '.' || (is_decimal && character.is_ascii_digit());
        if is_decimal && character != '.' { '#' } else { character }
    });
    characters.collect()
}

#[test]
fn the_commands_of_the_readme_run() {
    assert!(run_page("README.md", "examples/mission") >= 3);
}

#[test]
fn the_commands_of_the_import_guide_run() {
    assert!(run_page("docs/guides/import.md", ".") >= 8);
}

#[test]
fn the_commands_of_the_planning_guide_run() {
    assert!(run_page("docs/guides/planning.md", ".") >= 8);
}

#[test]
fn the_commands_of_the_team_guide_run() {
    assert!(run_page("docs/guides/team.md", ".") >= 6);
}

/// Returns the command lines in the examples of a help text. Help wraps long lines: a line that does not start with
/// `pingmap` continues the line above.
fn examples(help: &str) -> Vec<String> {
    let mut examples: Vec<String> = Vec::new();
    let lines = help.lines().skip_while(|line| !line.starts_with("Example")).skip(1);
    for line in lines.take_while(|line| !line.is_empty()) {
        match examples.last_mut() {
            Some(last) if !line.starts_with("  pingmap ") => *last += &format!(" {}", line.trim()),
            _ => examples.push(line.trim().to_owned()),
        }
    }
    examples
}

/// Commands whose examples write files that examples of other commands read.
const WRITERS: [&str; 3] = ["simulate", "learn", "team"];

/// Its example takes minutes. The tests of this command run it with less work.
const SLOW: &str = "reproduce";

/// Writes the files that the examples of the help name and that no example writes.
fn prepare_examples(folder: &Path) {
    for (log, seed) in [("monday.csv", "2"), ("tuesday.csv", "3"), ("links.csv", "4")] {
        run(folder, &format!("pingmap simulate --slots 60 --seed {seed} -o {log}"));
    }
    run(folder, "pingmap simulate --slots 90 --with-sent --as-files tables -o tables.csv");
    for (name, files) in [("nav", "nav"), ("heard", "rx"), ("sent", "tx")] {
        for vehicle in [1, 2] {
            let from = folder.join(format!("tables/auv{vehicle}.{name}.csv"));
            std::fs::copy(from, folder.join(format!("{files}{vehicle}.csv"))).unwrap();
        }
    }
    std::fs::copy(folder.join("tables/ids.csv"), folder.join("ids.csv")).unwrap();
    file(folder, "waypoints.csv", "easting_m,northing_m\n100,100\n900,500\n");
    file(folder, "places.csv", "name,easting_m,northing_m\nquay,100,100\nbuoy,700,500\n");
    file(
        folder,
        "packet.json",
        r#"{"schema":1,"message":"Report","sender":1,"first":4,"outcomes":"hm-mh","waypoints":[]}"#,
    );
}

#[test]
fn the_examples_of_the_help_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    prepare_examples(folder);
    let mut lines: Vec<String> = Vec::new();
    let others = COMMANDS.iter().filter(|command| !WRITERS.contains(command) && **command != SLOW);
    for command in WRITERS.iter().chain(others) {
        let words: Vec<&str> = command.split(' ').chain(["--help"]).collect();
        for line in examples(&stdout(&pingmap(folder, &words))) {
            if lines.contains(&line) {
                continue;
            }
            // The dots stand for the rest of a packet.
            let packet = || stdout(&run(folder, "pingmap packet encode --team team.toml packet.json"));
            let whole = if line.contains("7f01…") { line.replace("7f01…", packet().trim()) } else { line.clone() };
            run(folder, &whole);
            lines.push(line);
        }
        if *command == "simulate" {
            // The other examples take a shorter log.
            run(folder, "pingmap simulate --slots 100 -o log.csv --overwrite");
        }
    }
    assert!(lines.len() > 20, "{lines:?}");
}
