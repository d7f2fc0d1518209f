//! [`Owner`]: handles the messages of one host after the other.

use std::io;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::process::connection::{Closer, Connection};
use crate::process::reader::{Arrival, read};
use crate::process::stop_request::StopRequest;
use crate::process::writer::write;
use crate::protocol::output::Message;
use crate::store::error::StoreError;
use crate::store::snapshot::write_snapshot;
use crate::store::vehicle_store::Store;
use crate::vehicle::state::{Output, Vehicle};

/// Time between two looks for a request to stop.
const POLL: Duration = Duration::from_millis(50);

/// Time between two attempts to queue a message for a host that does not read.
const RETRY: Duration = Duration::from_millis(2);

/// Time for a host on a socket to read the last messages after it closed its own direction.
const DRAIN: Duration = Duration::from_secs(10);

/// The owner of the vehicle and of its store.
pub(crate) struct Owner<'a> {
    pub(crate) vehicle: Vehicle,
    pub(crate) store: Store,
    pub(crate) snapshot_path: PathBuf,
    /// Messages that wait in each direction, at most.
    pub(crate) queue: usize,
    pub(crate) stop: &'a StopRequest<'a>,
    /// Whether the last message was produced.
    pub(crate) has_stopped: bool,
}

/// The owner's ends of the two queues, and the writer thread.
struct Host {
    arrivals: Receiver<Arrival>,
    /// `None` if the host takes no messages any more.
    messages: Option<SyncSender<Message>>,
    writer: JoinHandle<()>,
    closer: Closer,
}

impl Host {
    fn new(connection: Connection, queue: usize) -> io::Result<Self> {
        let (input, output, closer) = connection.split();
        let (to_owner, arrivals) = sync_channel(queue);
        let (to_host, messages) = sync_channel(queue);
        let of_reader = to_host.clone();
        let named = |name: &str| thread::Builder::new().name(name.into());
        named("reader").spawn(move || read(input, &to_owner, &of_reader))?;
        let writer = named("writer").spawn(move || write(output, &messages))?;
        Ok(Self { arrivals, messages: Some(to_host), writer, closer })
    }

    /// Returns whether the host takes messages. The writer ends when it does not.
    fn takes_messages(&self) -> bool {
        self.messages.is_some() && !self.writer.is_finished()
    }

    /// Queues a message. Waits while the host does not read, but not after a request to stop.
    fn send(&mut self, mut message: Message, stop: &StopRequest<'_>) {
        while let Some(messages) = &self.messages {
            message = match messages.try_send(message) {
                Ok(()) => return,
                Err(TrySendError::Full(message)) if !stop.is_overdue() => message,
                Err(_) => {
                    self.messages = None;
                    self.closer.close();
                    return;
                }
            };
            thread::sleep(RETRY);
        }
    }

    /// Waits until the host has the last messages, and closes the connection.
    fn finish(mut self, stop: &StopRequest<'_>) {
        self.messages = None;
        let begin = Instant::now();
        let is_late = || self.closer.is_socket() && begin.elapsed() > DRAIN;
        while !self.writer.is_finished() && !stop.is_overdue() && !is_late() {
            thread::sleep(RETRY);
        }
        self.closer.close();
    }
}

impl Owner<'_> {
    /// Serves one host until it leaves, or until the process is requested to stop.
    pub(crate) fn serve(&mut self, connection: Connection, is_only_host: bool) -> io::Result<()> {
        let mut host = Host::new(connection, self.queue)?;
        self.vehicle.begin_host();
        while !self.has_stopped && !self.stop.is_made() {
            match host.arrivals.recv_timeout(POLL) {
                Ok(arrival) => self.handle(arrival, &mut host),
                Err(RecvTimeoutError::Timeout) if host.takes_messages() => {}
                Err(_) => break,
            }
        }
        if !self.has_stopped && (is_only_host || self.stop.is_made()) {
            let outputs = self.vehicle.stop();
            self.carry_out(outputs, &mut host);
        }
        host.finish(self.stop);
        Ok(())
    }

    fn handle(&mut self, Arrival { number, message, is_after_loss }: Arrival, host: &mut Host) {
        self.vehicle.number_next_input(number);
        if is_after_loss {
            self.vehicle.note_lost_messages();
        }
        let outputs = match message {
            Ok(input) => self.vehicle.handle(input),
            Err(fault) => {
                tracing::debug!(line = number, %fault, "a line was refused");
                self.vehicle.refuse(fault)
            }
        };
        self.carry_out(outputs, host);
    }

    /// Ends without a host.
    pub(crate) fn stop_alone(&mut self) {
        for output in self.vehicle.stop() {
            if let Err(error) = self.keep(&output) {
                tracing::error!(%error, "the store failed at the end");
                break;
            }
        }
        self.has_stopped = true;
    }

    /// Takes the steps that follow from an input, in their order.
    fn carry_out(&mut self, outputs: Vec<Output>, host: &mut Host) {
        let is_last = |output: &Output| matches!(output, Output::Send(Message::Stopped { .. }));
        self.has_stopped |= outputs.iter().any(is_last);
        for output in outputs {
            match self.keep(&output) {
                Ok(()) => {}
                Err(error) => return self.continue_in_memory(&error, host),
            }
            if let Output::Send(message) = output {
                host.send(message, self.stop);
            }
        }
    }

    /// Stores what a step has to store.
    fn keep(&mut self, output: &Output) -> Result<(), StoreError> {
        match output {
            Output::Store(records) => self.store.append(records),
            Output::Base(base) => {
                self.store.replace_base(base)?;
                // The store has everything. The next snapshot may succeed.
                if let Err(error) = write_snapshot(&self.snapshot_path, base) {
                    tracing::error!(%error, "the snapshot could not be written");
                    self.vehicle.snapshot_failed();
                }
                Ok(())
            }
            Output::Send(_) => Ok(()),
        }
    }

    fn continue_in_memory(&mut self, error: &StoreError, host: &mut Host) {
        tracing::error!(%error, "the store failed: the vehicle continues in memory, and sends nothing");
        let mut outputs = self.vehicle.store_failed(&error.to_string());
        if self.has_stopped {
            outputs.extend(self.vehicle.stop());
        }
        for output in outputs {
            if let Output::Send(message) = output {
                host.send(message, self.stop);
            }
        }
    }
}
