//! Output files: existing files are not overwritten, and outputs are checked before the work.

use std::path::Path;

use crate::common::*;

fn run(folder: &Path, arguments: &str) -> (Option<i32>, String, String) {
    let output = pingmap(folder, &arguments.split_whitespace().collect::<Vec<_>>());
    (output.status.code(), stdout(&output), stderr(&output))
}

/// Returns a folder with a log and a model.
fn prepared() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    file(folder.path(), "events.csv", log(&["a", "b"], 60));
    assert_eq!(run(folder.path(), "learn events.csv --kernel matern32 --additions none").0, Some(0));
    folder
}

/// Every command that writes a file, without the name of that file, and a name.
const COMMANDS: [(&str, &str); 8] = [
    ("learn events.csv --kernel matern32 --additions none -o ", "m.toml"),
    ("map events.csv --model model.toml --at 0,0 --cell-m 200 -o ", "m.png"),
    ("map events.csv --model model.toml --at 0,0 --cell-m 200 -o ", "m.svg"),
    ("map events.csv --model model.toml --at 0,0 --cell-m 200 -o ", "m.csv"),
    ("map events.csv --model model.toml --at 0,0 --cell-m 200 --origin 41,-70 -o ", "m.geojson"),
    ("predict events.csv --model model.toml --links events.csv -o ", "p.csv"),
    ("team events.csv -o ", "t.toml"),
    ("simulate --slots 60 -o ", "s.csv"),
];

#[test]
fn input_files_are_never_overwritten() {
    let folder = prepared();
    let folder = folder.path();
    let before = std::fs::read(folder.join("events.csv")).unwrap();
    for (command, _) in
        COMMANDS.iter().filter(|(command, name)| command.contains("events.csv") && name.ends_with("csv"))
    {
        for name in ["events.csv", "./events.csv"] {
            let (status, _, message) = run(folder, &format!("{command}{name}"));
            assert!(status == Some(2) && message.contains("is read and would be written"), "{command}: {message}");
        }
        // --overwrite does not allow it either.
        assert_eq!(run(folder, &format!("{command}events.csv --overwrite")).0, Some(2));
    }
    assert_eq!(run(folder, "team events.csv -o model.toml").0, Some(2));
    assert_eq!(run(folder, "replay events.csv --write-splits events.csv").0, Some(2));
    assert_eq!(std::fs::read(folder.join("events.csv")).unwrap(), before);
}

#[test]
fn existing_files_are_replaced_only_with_overwrite() {
    let folder = prepared();
    let folder = folder.path();
    for (command, name) in COMMANDS {
        for content in ["years of work\n", ""] {
            file(folder, name, content);
            let (status, printed, message) = run(folder, &format!("{command}{name}"));
            let expected = format!("{name} exists; expected another name, or --overwrite");
            assert!(status == Some(2) && message.contains(&expected), "{command}: {message}");
            // The refusal comes before the work.
            assert!(printed.is_empty() && message.lines().count() == 1, "{command}: {message}");
            assert_eq!(std::fs::read(folder.join(name)).unwrap(), content.as_bytes(), "{command}");
        }
        let (status, _, message) = run(folder, &format!("{command}{name} --overwrite"));
        assert_eq!(status, Some(0), "{command}: {message}");
        // The files of the command itself are no exception.
        let written = std::fs::read(folder.join(name)).unwrap();
        assert!(!written.is_empty(), "{command}");
        assert_eq!(run(folder, &format!("{command}{name}")).0, Some(2), "{command}");
        assert_eq!(std::fs::read(folder.join(name)).unwrap(), written, "{command}");
    }
    // The same rule holds for the pages of reports.
    std::fs::create_dir(folder.join("site")).unwrap();
    file(&folder.join("site"), "index.html", "<!DOCTYPE html><title>my site</title>");
    let replay = "replay events.csv --model model.toml --frames 1 --repeats 1 --report";
    let (status, _, message) = run(folder, &format!("{replay} site"));
    assert!(status == Some(2) && message.contains("index.html") && message.contains("--overwrite"), "{message}");
    let report = format!("{replay} report --write-splits splits.csv");
    assert_eq!(run(folder, &report).0, Some(0));
    assert_eq!(run(folder, &report).0, Some(2));
    assert_eq!(run(folder, &format!("{report} --overwrite")).0, Some(0));
    // An input is not replaced even if it has the name of a page.
    std::fs::copy(folder.join("events.csv"), folder.join("site/index.html")).unwrap();
    let of_page = "replay site/index.html --model model.toml --frames 1 --repeats 1 --report site --overwrite";
    let (status, _, message) = run(folder, of_page);
    assert!(status == Some(2) && message.contains("is read and would be written"), "{message}");
}

#[test]
fn an_output_that_cannot_be_written_is_refused_before_the_work() {
    let folder = prepared();
    let folder = folder.path();
    for (command, name) in COMMANDS {
        let (status, printed, message) = run(folder, &format!("{command}nowhere/{name}"));
        assert!(status == Some(1) && message.contains("there is no folder nowhere"), "{command}: {message}");
        // The refusal comes before all other messages.
        assert!(printed.is_empty() && message.lines().count() == 1, "{command}: {message}");
        std::fs::create_dir_all(folder.join("folder").join(name)).unwrap();
        let (status, _, message) = run(folder, &format!("{command}folder/{name}"));
        assert!(status == Some(2) && message.contains("is a folder"), "{command}: {message}");
    }
}

#[test]
fn results_are_written_to_standard_output_for_a_dash() {
    let folder = prepared();
    let folder = folder.path();
    for (command, name) in COMMANDS.iter().filter(|(_, name)| !["m.png", "m.svg", "m.geojson"].contains(name)) {
        assert_eq!(run(folder, &format!("{command}{name}")).0, Some(0), "{command}");
        let (status, printed, message) = run(folder, &format!("{command}-"));
        assert_eq!(status, Some(0), "{command}: {message}");
        let seconds = |line: &&str| !line.contains("seconds");
        let of_file = std::fs::read_to_string(folder.join(name)).unwrap();
        assert!(printed.lines().filter(seconds).eq(of_file.lines().filter(seconds)), "{command}: {printed}");
    }
}

#[test]
fn a_team_file_contains_the_relative_path_of_its_model() {
    let folder = prepared();
    let folder = folder.path();
    std::fs::create_dir_all(folder.join("teams/first")).unwrap();
    assert_eq!(run(folder, "team events.csv -o teams/first/team.toml").0, Some(0));
    let text = std::fs::read_to_string(folder.join("teams/first/team.toml")).unwrap();
    assert!(text.contains("model_file = \"../../model.toml\""), "{text}");
    assert_eq!(run(folder, "replay events.csv --team teams/first/team.toml --frames 1 --repeats 1").0, Some(0));
}

#[cfg(unix)]
#[test]
fn an_input_is_recognised_under_another_name() {
    let folder = prepared();
    let folder = folder.path();
    std::fs::hard_link(folder.join("events.csv"), folder.join("same.csv")).unwrap();
    std::fs::hard_link(folder.join("model.toml"), folder.join("same.png")).unwrap();
    for arguments in [
        "replay events.csv --model model.toml --frames 1 --write-splits model.toml --overwrite",
        "predict events.csv --model model.toml --links events.csv -o same.csv --overwrite",
        "map events.csv --model model.toml --at 0,0 -o same.png --overwrite",
        "plan standoff events.csv --model model.toml --at 0,0 -o same.png --overwrite",
    ] {
        let (status, _, message) = run(folder, arguments);
        assert!(status == Some(2) && message.contains("is read and would be written"), "{arguments}: {message}");
    }
}

/// `/dev/full` behaves like a full disk.
#[cfg(unix)]
#[test]
fn a_result_is_printed_if_its_file_cannot_be_written() {
    let folder = prepared();
    let folder = folder.path();
    for (arguments, printed_there) in [
        ("predict events.csv --model model.toml --links events.csv -o /dev/full", "probability,lower,upper"),
        ("team events.csv -o /dev/full", "schema = "),
        ("team events.csv -o /dev/full --json", "team_digest"),
        ("learn events.csv --kernel matern32 --additions none --site-prior 8 --json -o /dev/full", "candidates"),
        ("learn events.csv --site-prior 8 --update model.toml --json -o /dev/full", "site_points"),
        ("learn events.csv --site-prior 8 --update model.toml -o /dev/full", "# A model of how links behave"),
    ] {
        let (status, printed, message) = run(folder, arguments);
        assert!(status == Some(1) && message.contains("/dev/full"), "{arguments}: {message}");
        assert!(printed.contains(printed_there), "{arguments}: {printed}");
    }
}

#[test]
fn manual_pages_and_figures_do_not_replace_other_files() {
    let folder = prepared();
    let folder = folder.path();
    let listed = || {
        let mut names: Vec<_> =
            std::fs::read_dir(folder.join("man")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(run(folder, "man man").0, Some(0));
    let all = listed();
    for name in &all {
        let pages = tempfile::tempdir().unwrap();
        std::fs::write(pages.path().join(name), "mine").unwrap();
        let (status, _, message) = run(pages.path(), "man .");
        assert!(status == Some(2) && message.contains(name.to_str().unwrap()), "{name:?}: {message}");
        assert_eq!(std::fs::read(pages.path().join(name)).unwrap(), b"mine");
    }
    assert_eq!(run(folder, "man man").0, Some(2));
    assert_eq!(run(folder, "man man --overwrite").0, Some(0));
    assert_eq!(listed(), all);
    std::fs::create_dir_all(folder.join("out/reproduction")).unwrap();
    file(folder, "out/reproduction/tracks.svg", "mine");
    let (status, _, message) = run(folder, "reproduce tracks --permutations 1 --out out");
    assert!(status == Some(2) && message.contains("tracks.svg") && message.contains("--overwrite"), "{message}");
    // A log without a miss is not sufficient for the experiment.
    let heard_only = log(&["a", "b"], 60)
        .lines()
        .map(|line| line.strip_suffix(",0").map_or(line.to_owned(), |line| format!("{line},1")))
        .collect::<Vec<_>>();
    file(folder, "heard.csv", heard_only.join("\n") + "\n");
    let (status, _, message) = run(folder, "reproduce events --data heard.csv --permutations 1 --out other");
    assert!(status == Some(2) && message.contains("--accept-bad-log"), "{message}");
}
