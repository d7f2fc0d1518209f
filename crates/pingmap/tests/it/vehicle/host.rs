//! A host of the process: it writes lines, and reads answers with a time limit.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::Value;

/// Time for an answer.
const LIMIT: Duration = Duration::from_secs(60);

pub const HELLO: &str = r#"{"type":"hello","version":1}"#;

/// A process with a host on its standard input and output.
pub struct Host {
    pub child: Child,
    input: Option<ChildStdin>,
    lines: Receiver<String>,
    log: Option<JoinHandle<String>>,
}

impl Host {
    /// Starts a process in a folder, with its output read by a thread.
    pub fn start(folder: &Path, arguments: &[&str]) -> Self {
        Self::of(spawn(folder, arguments))
    }

    /// Reads the streams of a process.
    pub fn of(mut child: Child) -> Self {
        let output = child.stdout.take().unwrap();
        let (to_host, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(output).lines() {
                let Ok(line) = line else { return };
                if to_host.send(line).is_err() {
                    return;
                }
            }
        });
        let mut errors = child.stderr.take().unwrap();
        let log = std::thread::spawn(move || {
            let mut text = Vec::new();
            let _ = errors.read_to_end(&mut text);
            String::from_utf8_lossy(&text).into_owned()
        });
        Self { input: child.stdin.take(), child, lines, log: Some(log) }
    }

    /// Starts a process and greets it.
    pub fn greeted(folder: &Path) -> (Self, Value) {
        let mut host = Self::start(folder, &["vehicle"]);
        let greeting = host.ask(HELLO);
        assert_eq!(greeting["type"], "hello", "{greeting}");
        (host, greeting)
    }

    /// Writes bytes without an end of line. A process that is gone takes none.
    pub fn write(&mut self, bytes: &[u8]) {
        if let Some(input) = &mut self.input {
            let _ = input.write_all(bytes).and_then(|()| input.flush());
        }
    }

    pub fn send(&mut self, line: &str) {
        self.write(format!("{line}\n").as_bytes());
    }

    /// The next message; `None` at the end of the output.
    pub fn next(&self) -> Option<Value> {
        match self.lines.recv_timeout(LIMIT) {
            Ok(line) => Some(serde_json::from_str(&line).unwrap_or_else(|_| panic!("no JSON: {line}"))),
            Err(RecvTimeoutError::Disconnected) => None,
            Err(RecvTimeoutError::Timeout) => panic!("no answer within {LIMIT:?}"),
        }
    }

    /// Writes a line, and returns the first message that is no event.
    pub fn ask(&mut self, line: &str) -> Value {
        self.send(line);
        loop {
            let message = self.next().unwrap_or_else(|| panic!("the process ended at {line:.100}"));
            if message["type"] != "event" {
                return message;
            }
        }
    }

    /// Closes the input of the process.
    pub fn close(&mut self) {
        self.input = None;
    }

    /// Waits for the end of the process. Returns its exit status, the remaining messages and its log.
    pub fn finish(mut self) -> (ExitStatus, Vec<Value>, String) {
        let messages: Vec<Value> = std::iter::from_fn(|| self.next()).collect();
        let status = wait(&mut self.child);
        (status, messages, self.log.take().unwrap().join().unwrap())
    }

    /// Ends the process at once, as a loss of power would, and returns the messages that it had written.
    pub fn kill(&mut self) -> Vec<Value> {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        // The last line may be cut.
        let lines = std::iter::from_fn(|| self.lines.recv_timeout(LIMIT).ok());
        lines.filter_map(|line| serde_json::from_str(&line).ok()).collect()
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Starts a process with all its streams as pipes.
pub fn spawn(folder: &Path, arguments: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pingmap"));
    command.current_dir(folder).args(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command.spawn().unwrap()
}

/// Waits for the end of a process, with a time limit.
pub fn wait(child: &mut Child) -> ExitStatus {
    let begin = Instant::now();
    while begin.elapsed() < LIMIT {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let _ = child.kill();
    panic!("the process did not end within {LIMIT:?}");
}

/// Sends a signal such as `TERM`.
pub fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status().unwrap();
    assert!(status.success(), "{status}");
}
