//! Help texts and printed tables fit on a screen.

use crate::common::{file, pingmap, stderr, stdout};

/// Largest number of columns of a line.
const COLUMNS_MAX: usize = 100;

/// Every command. The empty name is the program.
pub const COMMANDS: [&str; 28] = [
    "",
    "demo",
    "import",
    "check",
    "replay",
    "fleet",
    "vehicle",
    "store",
    "store check",
    "store export",
    "learn",
    "predict",
    "map",
    "plan",
    "plan standoff",
    "plan track",
    "plan gateway",
    "select",
    "reproduce",
    "simulate",
    "team",
    "packet",
    "packet decode",
    "packet encode",
    "packet schema",
    "completions",
    "man",
    "schema",
];

/// Runs a command, and returns what it prints.
fn printed(folder: &std::path::Path, command: &str) -> String {
    let output = pingmap(folder, &command.split_whitespace().collect::<Vec<_>>());
    assert!(output.status.success(), "{command}: {}", stderr(&output));
    stdout(&output)
}

fn assert_narrow(text: &str, command: &str) {
    for line in text.lines() {
        assert!(line.chars().count() <= COLUMNS_MAX, "{command}: {} columns: {line}", line.chars().count());
    }
}

#[test]
fn the_short_help_of_every_command_fits_on_a_screen() {
    let folder = tempfile::tempdir().unwrap();
    for command in COMMANDS {
        let short = printed(folder.path(), &format!("{command} -h"));
        assert!(short.contains("Usage: ") && short.lines().count() <= 25, "{command}: {short}");
        assert_narrow(&short, command);
        let long = printed(folder.path(), &format!("{command} --help"));
        assert!(long.contains("Example") && long.lines().count() > short.lines().count(), "{command}: {long}");
        assert_narrow(&long, command);
    }
}

#[test]
fn the_list_of_commands_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    for above in ["", "plan", "packet", "store"] {
        let help = printed(folder.path(), &format!("{above} -h"));
        let list = help.split_once("Commands:\n").unwrap().1.split_once("\n\n").unwrap().0;
        let names = list.lines().filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help");
        for name in names {
            let name = format!("{above} {name}").trim().to_owned();
            assert!(COMMANDS.contains(&name.as_str()), "{name}");
        }
    }
}

#[test]
fn printed_tables_fit_in_100_columns() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    printed(folder, "simulate --slots 100 -o log.csv");
    let track = "x,y,name\n100,100,the place near the quay of the harbour\n900,900,b\n500,900,c\n";
    file(folder, "track.csv", track);
    for command in [
        "check log.csv",
        "learn log.csv --test-share 0.3",
        "replay log.csv --model model.toml --repeats 2 --compare --calibration",
        "replay log.csv --kernel matern32 --additions none --repeats 2 --frames 1,5 --learn both",
        "replay log.csv --model model.toml --online --piggyback-bytes 2",
        "map log.csv --model model.toml --at 500,500 --cell-m 200",
        "plan standoff log.csv --model model.toml --at 500,500",
        "plan track log.csv --model model.toml --along track.csv --at 500,500",
        "plan gateway log.csv --model model.toml --along track.csv --among track.csv",
        "select log.csv --model model.toml --vehicle auv1 --points 5",
        "simulate --slots 60",
        "team log.csv",
        "packet schema",
        "packet schema --report",
    ] {
        assert_narrow(&printed(folder, command), command);
    }
}
