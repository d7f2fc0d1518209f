//! Commands run by the library, without a process.

use crate::common::{file, log};

/// Runs a command, and returns its output or its failure.
fn run(arguments: &[&str]) -> Result<String, pingmap::Failure> {
    let mut results = Vec::new();
    pingmap::run(["pingmap"].iter().chain(arguments), &mut results)?;
    Ok(String::from_utf8(results).unwrap())
}

#[test]
fn results_are_written_to_the_callers_writer() {
    let folder = tempfile::tempdir().unwrap();
    let events = file(folder.path(), "events.csv", log(&["a", "b"], 40));
    let events = events.to_str().unwrap();
    let select = ["select", events, "--vehicle", "a", "--json"];
    let first: serde_json::Value = serde_json::from_str(&run(&select).unwrap()).unwrap();
    assert_eq!(first["inducing_points"].as_array().unwrap().len(), 2);
    assert!(first["certificate"]["kl"].as_f64().unwrap() <= first["certificate"]["gap"].as_f64().unwrap());
    // The command can run again, with any number of threads.
    for threads in ["1", "2", "0"] {
        let again = run(&[&select[..], &["--threads", threads]].concat()).unwrap();
        let mut again: serde_json::Value = serde_json::from_str(&again).unwrap();
        assert_eq!((&again["command"][0], &again["command"][6]), (&"select".into(), &threads.into()));
        again["command"] = first["command"].clone();
        assert_eq!(again, first, "{threads} threads");
    }
    let text = run(&select[..select.len() - 1]).unwrap();
    assert!(text.contains("good choice of 2 points"), "{text}");
}

#[test]
fn failures_have_the_status_and_message_of_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("nowhere.csv");
    let failure = run(&["replay", missing.to_str().unwrap()]).unwrap_err();
    assert!(failure.status == 2 && failure.message.contains("nowhere.csv"), "{failure:?}");
    let failure = run(&["replay"]).unwrap_err();
    assert!(failure.status == 2 && failure.message.contains("<LOG>"), "{failure:?}");
    let help = run(&["--help"]).unwrap_err();
    assert!(help.status == 0 && help.message.contains("demo") && help.message.contains("reproduce"), "{help:?}");
}

#[test]
fn an_interrupted_command_fails_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let events = file(folder.path(), "events.csv", log(&["a", "b"], 40));
    let (events, output) = (events.to_str().unwrap(), folder.path().join("result.csv"));
    let output = output.to_str().unwrap();
    let interrupt = pingmap::Interrupt::default();
    interrupt.request();
    for command in [
        &["learn", events, "-o", output][..],
        &["replay", events],
        &["replay", events, "--online"],
        &["map", events, "--at", "0,0", "-o", output],
        &["predict", events, "--links", events, "-o", output],
        &["simulate", "-o", output],
        &["import", "--events", events, "-o", output],
    ] {
        let failure = pingmap::run_until(["pingmap"].iter().chain(command), &mut Vec::new(), &interrupt).unwrap_err();
        assert!(failure.message.contains("the computation was stopped"), "{command:?}: {failure:?}");
        assert_eq!(failure.status, 1, "{command:?}");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["events.csv"]);
}

#[test]
fn warnings_go_to_the_list_of_the_calling_thread() {
    let folder = tempfile::tempdir().unwrap();
    let events = file(folder.path(), "events.csv", log(&["a", "b"], 40));
    let predict = ["predict", events.to_str().unwrap(), "--links", events.to_str().unwrap(), "--events-max", "30"];
    let warnings = pingmap::Warnings::default();
    warnings.attach();
    run(&predict).unwrap();
    let found = warnings.take();
    assert!(found.iter().any(|text| text.starts_with("using 30 of ")), "{found:?}");
    assert!(warnings.take().is_empty());
    std::thread::scope(|scope| scope.spawn(|| run(&predict).unwrap()).join().unwrap());
    assert!(warnings.take().is_empty(), "another thread has no list");
}

#[test]
fn every_command_has_a_summary() {
    let help = run(&["--help"]).unwrap_err().message;
    let list = help.split_once("Commands:").unwrap().1.split_once("Options:").unwrap().0;
    let commands: Vec<&str> = list.lines().filter(|line| !line.trim().is_empty()).collect();
    for line in commands {
        let Some((name, summary)) = line.trim().split_once("  ") else {
            // A summary may continue below its command.
            assert!(line.starts_with("    "), "{line:?} has no summary");
            continue;
        };
        assert!(summary.trim().len() > 10, "{line:?}");
        assert!(name == "help" || run(&[name, "--help"]).unwrap_err().status == 0, "{name}");
    }
}
