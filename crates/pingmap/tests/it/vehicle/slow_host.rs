use std::io::{BufRead, BufReader, Write};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::host::{HELLO, signal, spawn, wait};
use super::mission::{configure, folder};

const LINES: usize = 20_000;

/// Writes a greeting and many requests, whose answers do not fit into a pipe.
fn flood(mut input: impl Write) {
    let _ = input.write_all(format!("{HELLO}\n").as_bytes());
    for _ in 0..LINES {
        let _ = input.write_all(b"{\"type\":\"status\"}\n");
    }
}

#[test]
fn a_host_that_reads_late_gets_one_answer_for_every_line() {
    let folder = folder();
    configure(folder.path(), "[host]\nqueue = 10");
    let mut child = spawn(folder.path(), &["vehicle"]);
    let input = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || flood(input));
    std::thread::sleep(Duration::from_millis(500));
    let output = BufReader::new(child.stdout.take().unwrap());
    let messages: Vec<Value> = output.lines().map(|line| serde_json::from_str(&line.unwrap()).unwrap()).collect();
    writer.join().unwrap();
    assert!(wait(&mut child).success());
    let (last, messages) = messages.split_last().unwrap();
    assert_eq!(last["type"], "stopped");
    let busy = messages.iter().filter(|message| message["code"] == "busy").count();
    let status = messages.iter().filter(|message| message["type"] == "status").count();
    assert_eq!((status + busy, status > 0, busy > 0), (LINES, true, true), "{status} and {busy}");
    let mut numbers: Vec<u64> = messages.iter().filter_map(|message| message["input"].as_u64()).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, (2..=LINES as u64 + 1).collect::<Vec<_>>());
}

#[test]
fn a_host_that_never_reads_does_not_prevent_a_clean_end() {
    let folder = folder();
    configure(folder.path(), "[host]\nqueue = 10");
    let mut child = spawn(folder.path(), &["vehicle"]);
    let input = child.stdin.take().unwrap();
    let _unread = child.stdout.take().unwrap();
    // The pipe of the input fills, too.
    let writer = std::thread::spawn(move || flood(input));
    std::thread::sleep(Duration::from_millis(500));
    assert!(!writer.is_finished() && child.try_wait().unwrap().is_none());
    signal(&child, "TERM");
    let begin = Instant::now();
    assert!(wait(&mut child).success());
    assert!(begin.elapsed() < Duration::from_secs(10), "{:?}", begin.elapsed());
    assert!(folder.path().join("auv1.snapshot").exists());
    writer.join().unwrap();
}

#[test]
fn a_host_that_closes_its_ears_ends_the_process() {
    let folder = folder();
    let mut child = spawn(folder.path(), &["vehicle"]);
    drop(child.stdout.take());
    let mut input = child.stdin.take().unwrap();
    input.write_all(format!("{HELLO}\n{{\"type\":\"status\"}}\n").as_bytes()).unwrap();
    assert!(wait(&mut child).success());
}
