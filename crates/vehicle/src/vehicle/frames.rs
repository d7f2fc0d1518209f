//! Frames in both directions, and piggybacked outcomes.

use pingmap_agent::{AgentError, Receipt};
use pingmap_import::ModemNews;

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::hex::Hex;
use crate::protocol::input::{FrameRequest, PiggybackIn, PiggybackRequest};
use crate::protocol::output::Message;
use crate::vehicle::ledger::{LEAD_S_MAX, LedgerRecord};
use crate::vehicle::record::Record;
use crate::vehicle::slots::failed;
use crate::vehicle::state::Vehicle;

/// Frames that the host may have open. Further ones replace the oldest, which then counts as sent.
const OPEN_FRAMES_MAX: usize = 256;

impl Vehicle {
    pub(crate) fn receive(&mut self, bytes: &[u8], time_s: f64) {
        // A time far after the clock may be wrong. It does not move the clock of the agent, which never goes back.
        let is_near = self.ledger.clock_s().is_some_and(|clock_s| time_s - clock_s <= LEAD_S_MAX);
        let received = self.agent.receive(bytes, is_near.then_some(time_s));
        self.records.extend(received.entry.map(Record::Entry));
        self.acknowledge(&received.receipt);
    }

    pub(crate) fn receive_piggyback(&mut self, input: &PiggybackIn) -> Result<(), Fault> {
        let bits = u64::from_str_radix(&input.bits, 16)
            .map_err(|_| Fault::of_field(FaultCode::WrongField, "bits", &input.bits, "1 to 16 hexadecimal digits"))?;
        let received = self.agent.receive_piggyback(&input.from, input.time, bits, input.n_bits);
        self.records.extend(received.entry.map(Record::Entry));
        self.acknowledge(&received.receipt);
        Ok(())
    }

    fn acknowledge(&mut self, receipt: &Receipt) {
        let (counts, reason) = match receipt {
            Receipt::Accepted => (true, None),
            Receipt::Refused(refusal) => (false, Some(refusal.to_string())),
        };
        self.send(Message::Acknowledgement { input: self.inputs, counts, reason });
    }

    /// Answers with a frame, or with nothing.
    pub(crate) fn propose_frame(&mut self, request: &FrameRequest) -> Result<(), Fault> {
        let input = self.inputs;
        if let Some(problem) = self.store_problem.as_ref().or(self.silence.as_ref()) {
            return Err(Fault::new(FaultCode::StoreFailed, format!("the vehicle sends nothing: {problem}")));
        }
        self.check_counters()?;
        self.refit_if_due();
        let proposed = self.agent.next_frame(Some(request.time), request.bytes).map_err(|error| match error {
            AgentError::Team(error) => {
                Fault::of_field(FaultCode::OutOfBounds, "bytes", request.bytes, format!("at least 32 ({error})"))
            }
            error => failed(&error),
        })?;
        let Some(frame) = proposed else {
            self.send(Message::Nothing { input });
            return Ok(());
        };
        self.records.push(Record::Entry(frame.entry()));
        self.open_frames.insert(frame.number, frame.slot);
        if self.open_frames.len() > OPEN_FRAMES_MAX {
            self.open_frames.pop_first();
        }
        self.send(Message::Frame { input, token: frame.number, bytes: Hex(frame.bytes) });
        Ok(())
    }

    /// Checks that a recovery from the last snapshot would skip all counters that were used since. Half of the window
    /// asks for another snapshot.
    fn check_counters(&mut self) -> Result<(), Fault> {
        let used = self.agent.next_counter().saturating_sub(self.snapshot_counter);
        let window = u32::from(self.agent.team().packets_per_sender_max);
        self.wants_base |= used >= window / 2;
        if used < window {
            return Ok(());
        }
        let problem =
            "until another snapshot is written, because a recovery from the last one could use counters twice";
        Err(Fault::new(FaultCode::StoreFailed, format!("the vehicle sends nothing {problem}")))
    }

    /// Notes the counter in the snapshot that is about to be written.
    pub(crate) fn begin_snapshot(&mut self) {
        self.former_snapshot_counter = self.snapshot_counter;
        self.snapshot_counter = self.agent.next_counter();
    }

    /// Notes that the last snapshot could not be written. The vehicle sends no frame when too many counters of packets
    /// were used since the snapshot before it.
    pub fn snapshot_failed(&mut self) {
        self.snapshot_counter = self.former_snapshot_counter;
    }

    /// Notes that a frame left at a time, or never.
    pub(crate) fn close_frame(&mut self, token: u64, departed_s: Option<f64>) -> Result<(), Fault> {
        let changed = match departed_s {
            Some(time_s) => self.agent.frame_departed(token, time_s),
            None => self.agent.frame_dropped(token),
        };
        match changed {
            Ok(entry) => {
                self.records.push(Record::Entry(entry));
                self.open_frames.remove(&token);
            }
            // The agent has forgotten the frame, because many others followed. The next base leaves it out.
            Err(AgentError::NoSuchFrame(_)) if self.open_frames.remove(&token).is_some() => self.wants_base = true,
            Err(AgentError::NoSuchFrame(_)) => {
                let expected = "the token of a frame of this vehicle";
                return Err(Fault::of_field(FaultCode::UnknownToken, "token", token, expected));
            }
            Err(error) => return Err(failed(&error)),
        }
        if let Some(time_s) = departed_s {
            self.note_transmission(time_s);
        }
        Ok(())
    }

    /// Notes that the vehicle transmitted at a time. It cannot receive meanwhile.
    pub(crate) fn note_transmission(&mut self, time_s: f64) {
        self.late_reports += u64::from(self.is_counted(time_s));
        let slots = &self.agent.team().slots;
        match slots.sent_in(time_s, self.id()) {
            Some(slot) => self.change_ledger(LedgerRecord::Sent { slot }),
            None => {
                let to_s = time_s + slots.duration_s;
                self.change_ledger(LedgerRecord::Deaf { from_s: time_s, to_s, reason: "transmitting".into() });
            }
        }
    }

    pub(crate) fn piggyback(&mut self, request: &PiggybackRequest) -> Result<(), Fault> {
        if !(7..=64).contains(&request.n_bits) {
            return Err(Fault::of_field(FaultCode::OutOfBounds, "n_bits", request.n_bits, "a number from 7 to 64"));
        }
        let (input, n_bits) = (self.inputs, request.n_bits);
        let is_silent = self.store_problem.is_some() || self.silence.is_some();
        let bits = if is_silent { None } else { self.agent.piggyback(request.time, n_bits) };
        self.send(match bits {
            Some(bits) => Message::Piggyback { input, bits: format!("{bits:x}"), n_bits },
            None => Message::Nothing { input },
        });
        Ok(())
    }

    /// Notes receptions, transmissions and deaf intervals that sentences of a modem show.
    pub(crate) fn absorb_sentence(&mut self, time_s: f64, sentence: &str) -> Result<(), Fault> {
        let news = self
            .modem
            .absorb(time_s, sentence)
            .map_err(|problem| Fault::of_field(FaultCode::WrongField, "sentence", sentence, problem))?;
        self.note_modem_news(news);
        Ok(())
    }

    /// Notes the content of sentences. Senders that are no other member are not counted: other teams may share the
    /// water.
    pub(crate) fn note_modem_news(&mut self, news: ModemNews) {
        for (arrival_s, source) in news.receptions {
            if self.check_peer("sentence", &source).is_ok()
                && let Err(fault) = self.note_reception(&source, arrival_s)
            {
                self.send(Message::Error { input: self.inputs, fault });
            }
        }
        news.transmissions_s.into_iter().for_each(|time_s| self.note_transmission(time_s));
        for (from_s, to_s, reason) in news.deaf_intervals {
            self.change_ledger(LedgerRecord::Deaf { from_s, to_s, reason });
        }
    }
}
