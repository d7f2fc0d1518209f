//! One vehicle as a process, by its host protocol.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, bail};
use pingmap_agent::VehicleId;
use pingmap_vehicle::{Hello, Input, LearnedEvent, Message, PROTOCOL, StatusReport};

/// Messages without an answer, at most. A process that has too many of them is busy.
const UNANSWERED_MAX: u64 = 200;

/// A running process.
pub struct Process {
    id: VehicleId,
    child: Child,
    stdin: ChildStdin,
    stdout: BufReader<ChildStdout>,
    /// Inputs that were written, and inputs that were answered.
    written: u64,
    answered: u64,
    /// Slots that the vehicle has counted since the last [`Process::take_events`].
    events: Vec<LearnedEvent>,
}

impl Process {
    /// Starts a vehicle and greets it.
    pub fn start(id: &VehicleId, program: &Path, config: &Path) -> anyhow::Result<Self> {
        let mut child = Command::new(program)
            .args(["vehicle", "--config"])
            .arg(config)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("{}", program.display()))?;
        let (stdin, stdout) = (child.stdin.take(), child.stdout.take());
        let (stdin, stdout) = stdin.zip(stdout).context("the pipes of a process")?;
        let (stdout, events) = (BufReader::new(stdout), Vec::new());
        let mut process = Self { id: id.clone(), child, stdin, stdout, written: 0, answered: 0, events };
        process.ask(&Input::Hello(Hello { version: PROTOCOL, vehicle: Some(id.clone()), team: None }))?;
        Ok(process)
    }

    /// Writes a message. Waits only if many answers are missing.
    pub fn tell(&mut self, input: &Input) -> anyhow::Result<()> {
        if self.written - self.answered >= UNANSWERED_MAX {
            self.wait()?;
        }
        let line = serde_json::to_string(input)? + "\n";
        self.stdin.write_all(line.as_bytes()).with_context(|| format!("{} does not read", self.id))?;
        self.written += 1;
        Ok(())
    }

    /// Writes a message and returns its answer.
    pub fn ask(&mut self, input: &Input) -> anyhow::Result<Message> {
        self.tell(input)?;
        self.stdin.flush()?;
        self.wait()?.with_context(|| format!("{} gave no answer", self.id))
    }

    /// Waits for the answers to all messages. Returns the last one.
    pub fn wait(&mut self) -> anyhow::Result<Option<Message>> {
        self.stdin.flush()?;
        let mut last = None;
        while self.answered < self.written {
            let mut line = String::new();
            if self.stdout.read_line(&mut line).with_context(|| format!("{} does not write", self.id))? == 0 {
                bail!("{} ended before it answered", self.id);
            }
            let message: Message = serde_json::from_str(&line).with_context(|| format!("{}: {line}", self.id))?;
            match message {
                Message::Event(event) => self.events.push(event),
                Message::Error { fault, .. } => bail!("{} refused a message: {fault}", self.id),
                answer => {
                    self.answered += 1;
                    last = Some(answer);
                }
            }
        }
        Ok(last)
    }

    /// Returns the slots that the vehicle has counted since the last call.
    pub fn take_events(&mut self) -> Vec<LearnedEvent> {
        std::mem::take(&mut self.events)
    }

    pub fn status(&mut self) -> anyhow::Result<StatusReport> {
        match self.ask(&Input::Status {})? {
            Message::Status(status) => Ok(*status),
            other => bail!("{}: expected a status, found {other:?}", self.id),
        }
    }

    /// Kills the process without any warning.
    pub fn kill(mut self) -> anyhow::Result<()> {
        self.child.kill()?;
        self.child.wait()?;
        Ok(())
    }

    /// Ends the process.
    pub fn stop(mut self) -> anyhow::Result<()> {
        self.tell(&Input::Stop {})?;
        self.wait()?;
        let status = self.child.wait()?;
        if !status.success() {
            bail!("{} ended with {status}", self.id);
        }
        Ok(())
    }
}
