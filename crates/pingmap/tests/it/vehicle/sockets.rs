use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::Child;
use std::time::Duration;

use serde_json::Value;

use super::host::{HELLO, signal, spawn, wait};
use super::mission::{configure, contents, folder};
use crate::common::{file, pingmap, stderr};

/// Connects to the socket of a process as soon as it listens.
fn connect(path: &Path) -> BufReader<UnixStream> {
    for _ in 0..1000 {
        if let Ok(stream) = UnixStream::connect(path) {
            stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
            return BufReader::new(stream);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("no process listens at {}", path.display());
}

fn ask(stream: &mut BufReader<impl Read + Write>, line: &str) -> Value {
    stream.get_mut().write_all(format!("{line}\n").as_bytes()).unwrap();
    loop {
        let mut text = String::new();
        stream.read_line(&mut text).unwrap();
        let answer: Value = serde_json::from_str(&text).unwrap_or_else(|_| panic!("{text:?}"));
        if answer["type"] != "event" {
            return answer;
        }
    }
}

fn end(mut child: Child) {
    signal(&child, "TERM");
    assert!(wait(&mut child).success());
}

fn nav(time: u32) -> String {
    format!(r#"{{"type":"nav","time":{time},"position":{{"x":1,"y":1}}}}"#)
}

#[test]
fn a_host_that_leaves_in_the_middle_of_a_line_makes_room_for_the_next() {
    let folder = folder();
    configure(folder.path(), "[host]\nlisten = \"unix:auv1.sock\"");
    let path = folder.path().join("auv1.sock");
    // A killed process left its socket.
    drop(UnixListener::bind(&path).unwrap());
    let child = spawn(folder.path(), &["vehicle"]);
    for round in 0..3 {
        let mut stream = connect(&path);
        assert_eq!(ask(&mut stream, r#"{"type":"status"}"#)["code"], "not_greeted");
        assert_eq!(ask(&mut stream, HELLO)["type"], "hello");
        // Numbers begin again.
        assert_eq!(ask(&mut stream, &nav(1000 + 10 * round))["input"], 3);
        stream.get_mut().write_all(b"{\"type\":\"nav\",\"ti").unwrap();
    }
    // The next host waits until the present one leaves.
    let mut present = connect(&path);
    assert_eq!(ask(&mut present, HELLO)["type"], "hello");
    let mut waiting = connect(&path);
    waiting.get_mut().write_all(format!("{HELLO}\n").as_bytes()).unwrap();
    assert_eq!(ask(&mut present, &nav(1100))["type"], "ok");
    drop(present);
    let mut greeting = String::new();
    waiting.read_line(&mut greeting).unwrap();
    assert!(greeting.starts_with(r#"{"type":"hello""#), "{greeting}");
    end(child);
    assert!(!path.exists());
    let events = contents(folder.path());
    assert!(events.base.is_some() && events.entries.is_empty());
}

#[test]
fn a_socket_in_use_and_another_file_are_refused() {
    let folder = folder();
    configure(folder.path(), "[host]\nlisten = \"unix:auv1.sock\"");
    let path = folder.path().join("auv1.sock");
    let listener = UnixListener::bind(&path).unwrap();
    let refused = || {
        let output = pingmap(folder.path(), &["vehicle"]);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        assert!(stderr(&output).contains("auv1.sock"), "{}", stderr(&output));
    };
    refused();
    drop(listener);
    std::fs::remove_file(&path).unwrap();
    file(folder.path(), "auv1.sock", "notes");
    refused();
    assert_eq!(std::fs::read(&path).unwrap(), b"notes");
}

#[test]
fn a_host_connects_by_tcp() {
    let folder = folder();
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    configure(folder.path(), &format!("[host]\nlisten = \"tcp:127.0.0.1:{port}\""));
    let child = spawn(folder.path(), &["vehicle"]);
    let stream = (0..1000).find_map(|_| {
        std::thread::sleep(Duration::from_millis(10));
        std::net::TcpStream::connect(("127.0.0.1", port)).ok()
    });
    let mut stream = BufReader::new(stream.unwrap());
    assert_eq!(ask(&mut stream, HELLO)["type"], "hello");
    assert_eq!(ask(&mut stream, &nav(1000))["type"], "ok");
    assert_eq!(ask(&mut stream, r#"{"type":"stop"}"#)["type"], "stopped");
    let mut child = child;
    assert!(wait(&mut child).success());
}
