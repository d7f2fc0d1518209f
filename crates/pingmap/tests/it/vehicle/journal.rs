//! A host that compares every answer of the process with a vehicle in this process, and keeps what was acknowledged.

use std::collections::BTreeMap;
use std::path::Path;

use pingmap_packet::{MapMessage, from_hex};
use pingmap_vehicle::{Contents, Output, Vehicle, read_line, write_line};
use serde_json::Value;

use super::host::{HELLO, Host};
use super::mission::{Mission, contents, restored};

/// The first byte of a record that is an entry of the memory.
const ENTRY: u8 = 0;

/// Frames that the vehicle handed out in all its lives.
#[derive(Default)]
pub struct Frames {
    tokens: BTreeMap<u64, Vec<u8>>,
    counters: BTreeMap<(u8, u16), Vec<u8>>,
}

impl Frames {
    /// Adds a frame, and asserts that no other frame has its token or its counter.
    pub fn add(&mut self, message: &Value) {
        let bytes = from_hex(message["bytes"].as_str().unwrap()).unwrap();
        let token = message["token"].as_u64().unwrap();
        assert!(self.tokens.insert(token, bytes.clone()).is_none(), "token {token} is used twice");
        if let Ok((_, packet)) = MapMessage::decode(&bytes, None) {
            let counter = (packet.sender, packet.counter);
            assert!(self.counters.insert(counter, bytes).is_none(), "counter {counter:?} is used twice");
        }
    }

    /// Forgets tokens, which begin again after a store was lost.
    pub fn forget_tokens(&mut self) {
        self.tokens.clear();
    }

    /// Number of frames with a counter.
    pub fn summaries(&self) -> usize {
        self.counters.len()
    }

    /// Number of all frames.
    pub fn count(&self) -> usize {
        self.tokens.len()
    }

    /// The largest counter.
    pub fn latest(&self) -> u16 {
        self.counters.keys().map(|(_, counter)| *counter).max().unwrap_or_default()
    }
}

/// One life of the process.
pub struct Life<'a> {
    pub host: Host,
    folder: &'a Path,
    /// A vehicle that handles the same inputs.
    twin: Vehicle,
    /// Entries of acknowledged inputs.
    acknowledged: Vec<Vec<u8>>,
    /// Number of the last line that was sent.
    sent: u64,
    /// Lines that wait for their answers.
    open: Vec<String>,
}

impl<'a> Life<'a> {
    /// Starts the process. The twin begins with the same store.
    pub fn start(folder: &'a Path) -> Self {
        let contents = if folder.join("auv1.redb").exists() { contents(folder) } else { Contents::default() };
        let mut twin = restored(folder, &contents);
        let (host, _) = Host::greeted(folder);
        twin.handle(read_line(HELLO.as_bytes()).unwrap());
        Self { host, folder, twin, acknowledged: Vec::new(), sent: 1, open: Vec::new() }
    }

    pub fn send(&mut self, lines: Vec<String>) {
        for line in lines {
            self.host.send(&line);
            self.sent += 1;
            self.open.push(line);
        }
    }

    /// Checks messages of the process. Returns the frames among them.
    fn check(&mut self, messages: &[Value]) -> Vec<Value> {
        let is_answer = |message: &&Value| message["type"] != "event" && message["input"] != 0;
        let answered = messages.iter().filter(is_answer).count();
        let mut expected = Vec::new();
        for line in self.open.drain(..answered) {
            for output in self.twin.handle(read_line(line.as_bytes()).unwrap()) {
                match output {
                    Output::Store(records) => self.acknowledged.extend(records),
                    Output::Base(_) => {}
                    Output::Send(message) => {
                        expected.push(serde_json::from_str::<Value>(&write_line(&message)).unwrap())
                    }
                }
            }
        }
        // Events of an input come before its answer, so that a kill may leave events without it.
        assert_eq!(expected, messages[..expected.len()], "the twin answers otherwise");
        messages.iter().filter(|message| message["type"] == "frame").cloned().collect()
    }

    /// Plays one step of the mission, and waits for all answers.
    pub fn step(&mut self, mission: &mut Mission, frames: &mut Frames) {
        let lines = mission.next();
        let mut new = self.answers(lines);
        let closing = |frame: &Value| match mission.uniform() < 0.7 {
            true => format!(r#"{{"type":"departed","token":{},"time":{}}}"#, frame["token"], mission.time_s),
            false => format!(r#"{{"type":"dropped","token":{}}}"#, frame["token"]),
        };
        let lines: Vec<String> = new.iter().map(closing).collect();
        new.extend(self.answers(lines));
        new.iter().for_each(|frame| frames.add(frame));
    }

    fn answers(&mut self, lines: Vec<String>) -> Vec<Value> {
        self.send(lines);
        let mut messages = Vec::new();
        let mut answered = 0;
        while answered < self.open.len() {
            let message = self.host.next().expect("an answer");
            answered += usize::from(message["type"] != "event");
            messages.push(message);
        }
        self.check(&messages)
    }

    /// Kills the process, and asserts that its store has everything that was acknowledged.
    pub fn kill(mut self, frames: &mut Frames) {
        let messages = self.host.kill();
        self.check(&messages).iter().for_each(|frame| frames.add(frame));
        let stored = contents(self.folder);
        let mut all = stored.clone();
        all.entries.extend(self.acknowledged.into_iter().filter(|record| record.first() == Some(&ENTRY)));
        let snapshot = |contents: &Contents| restored(self.folder, contents).agent().snapshot();
        assert!(snapshot(&stored) == snapshot(&all), "an acknowledged entry is lost");
    }
}
