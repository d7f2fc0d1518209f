//! The packets that a modem transmits, from the sentences of the modem and of its host.

use pingmap_agent::MessageKind;

use crate::model::exclusion::ExclusionReason;
use crate::model::recording::{Reply, TransmissionRecord};
use crate::readers::modem::cycle::{Cycle, FRAME_S_MAX, MESSAGE_S_MAX, mini_kind};
use crate::readers::modem::flexible_packet::FlexiblePacket;
use crate::readers::modem::nmea::Sentence;
use crate::readers::sink::Sink;

/// Duration of a packet, in seconds, if the modem reports only its end.
const PACKET_S_MAX: f64 = 3.0;

/// Longest time from a decoded message to the start of its acknowledgement, in seconds.
const REPLY_S_MAX: f64 = 5.0;

/// The state of the transmitting side of a modem.
#[derive(Debug, Default)]
pub(super) struct Transmitter {
    outgoing: Option<OutgoingMessage>,
    /// A packet without data that began and has not ended.
    control: Option<ControlPacket>,
    /// Time of a decoded message that the modem is expected to acknowledge.
    decoded_s: Option<f64>,
    /// Times at which the latest acknowledgement and the latest message finished.
    replied_s: Option<f64>,
    finished_s: Option<f64>,
    /// Number of messages that were not transmitted.
    pub(super) failed: usize,
    /// Number of sentences with missing fields.
    pub(super) garbled: usize,
}

/// Data that the modem accepted for transmission.
#[derive(Debug)]
struct OutgoingMessage {
    time_s: f64,
    start_s: Option<f64>,
    destination: String,
    kind: Option<MessageKind>,
    /// Number of frames by the host's sentences, and by the modem's echo.
    host_frames: u32,
    echo_frames: u32,
}

/// A packet without data: a cycle, or the acknowledgement of a message that was decoded at `decoded_s`.
#[derive(Debug, Clone, Copy)]
struct ControlPacket {
    start_s: f64,
    decoded_s: Option<f64>,
}

impl Transmitter {
    /// Absorbs a sentence about data for transmission, or about a packet that was transmitted.
    pub(super) fn absorb(&mut self, time_s: f64, sentence: &Sentence, cycle: Option<&Cycle>, sink: &mut Sink) {
        let is_stale =
            |outgoing: &OutgoingMessage| time_s - outgoing.start_s.unwrap_or(outgoing.time_s) > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_some_and(is_stale) && sentence.name.starts_with("CA") {
            self.drop_outgoing();
        }
        let is_reply = match sentence.name {
            "CATXP" => self.start_packet(time_s),
            "CATXF" => self.finish_packet(time_s, sink),
            "CAXST" => self.absorb_statistics(time_s, sentence, sink),
            "CADRQ" => {
                sink.add_modem_id(sentence.field(1));
                false
            }
            "CAERR" => {
                if sentence.fields.contains(&"DATA_TIMEOUT") {
                    self.drop_outgoing();
                }
                false
            }
            _ => {
                if matches!(sentence.name, "CATXD" | "CATXA") {
                    sink.add_modem_id(sentence.field(0));
                }
                self.absorb_data(time_s, sentence, cycle);
                false
            }
        };
        // A reply exists only because a message was decoded, so it does not extend the activity of the modem.
        if !is_reply && sentence.name.starts_with("CA") {
            sink.record_activity(time_s);
        }
    }

    /// Expects the modem to acknowledge a message that it decoded at a time.
    pub(super) fn expect_reply(&mut self, decoded_s: f64) {
        self.decoded_s = Some(decoded_s);
    }

    /// Stops expecting an acknowledgement, because the next packet has another reason.
    pub(super) fn cancel_reply(&mut self) {
        self.decoded_s = None;
    }

    /// Drops data that the modem will not transmit any more.
    pub(super) fn drop_outgoing(&mut self) {
        self.failed += usize::from(self.outgoing.take().is_some());
    }

    /// Absorbs data for transmission, from the host or from the modem's echo.
    fn absorb_data(&mut self, time_s: f64, sentence: &Sentence, cycle: Option<&Cycle>) {
        let (destination, kind, frames) = match sentence.name {
            "CCTXD" | "CCTXA" => (sentence.field(1), None, u32::from(!sentence.field(3).is_empty())),
            "CATXD" | "CATXA" => (sentence.field(1), None, u32::from(sentence.field(3) != "0")),
            "CCMUC" | "CAMUC" => (sentence.field(1), mini_kind(), 1),
            _ => match FlexiblePacket::parse(sentence) {
                Some(packet) => (packet.destination, packet.kind, packet.frames.len() as u32),
                None => {
                    self.garbled += 1;
                    return;
                }
            },
        };
        if frames == 0 {
            return;
        }
        let is_new =
            |outgoing: &OutgoingMessage| outgoing.start_s.is_some() || time_s - outgoing.time_s > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_none_or(is_new) {
            let (destination, start_s) = (destination.to_owned(), None);
            let kind = kind.or_else(|| cycle.filter(|cycle| cycle.is_recent(time_s))?.kind());
            self.outgoing =
                Some(OutgoingMessage { time_s, start_s, destination, kind, host_frames: 0, echo_frames: 0 });
        }
        let Some(outgoing) = &mut self.outgoing else { return };
        let is_echo = sentence.name.starts_with("CA");
        *if is_echo { &mut outgoing.echo_frames } else { &mut outgoing.host_frames } += frames;
    }

    /// Records the start of a packet. Returns whether the packet is an acknowledgement.
    fn start_packet(&mut self, time_s: f64) -> bool {
        if let Some(outgoing) = &mut self.outgoing {
            outgoing.start_s = Some(time_s);
            return false;
        }
        let decoded_s = self.take_reply(time_s);
        self.control = Some(ControlPacket { start_s: time_s, decoded_s });
        decoded_s.is_some()
    }

    /// Records the end of a packet. Returns whether the packet is an acknowledgement.
    fn finish_packet(&mut self, end_s: f64, sink: &mut Sink) -> bool {
        if self.outgoing.is_some() {
            self.finish_outgoing(end_s, sink);
            return false;
        }
        let control = self.control.take().filter(|control| end_s - control.start_s <= MESSAGE_S_MAX);
        let ControlPacket { start_s, decoded_s } = control.unwrap_or_else(|| {
            let decoded_s = self.take_reply(end_s);
            ControlPacket { start_s: decoded_s.unwrap_or(f64::NEG_INFINITY).max(end_s - PACKET_S_MAX), decoded_s }
        });
        match decoded_s {
            Some(decoded_s) => sink.recording.replies.push(Reply { decoded_s, start_s, end_s }),
            // The modem is deaf while it transmits.
            None => sink.recording.deaf_intervals.push((start_s, end_s, ExclusionReason::Transmitting)),
        }
        self.replied_s = decoded_s.map(|_| end_s);
        decoded_s.is_some()
    }

    /// Returns the time of the decoded message if a packet without data at `time_s` may acknowledge it.
    fn take_reply(&mut self, time_s: f64) -> Option<f64> {
        self.decoded_s.take().filter(|decoded_s| (0.0..=REPLY_S_MAX).contains(&(time_s - decoded_s)))
    }

    /// Records the message that the modem has finished.
    fn finish_outgoing(&mut self, time_s: f64, sink: &mut Sink) {
        let Some(outgoing) = self.outgoing.take() else { return };
        self.finished_s = Some(time_s);
        let frames = outgoing.host_frames.max(outgoing.echo_frames);
        let record = TransmissionRecord {
            time_s: outgoing.start_s.unwrap_or(time_s),
            destination: sink.ids.resolve(&outgoing.destination),
            frames: (frames > 0).then_some(frames),
            kind: outgoing.kind,
            band: None,
        };
        sink.recording.transmissions.get_or_insert_default().push(record);
    }

    /// Absorbs transmit statistics. An error mode means that there was no transmission. From version 6 on, the first
    /// field is the version. Returns whether they describe an acknowledgement.
    fn absorb_statistics(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) -> bool {
        let has_started = self.outgoing.as_ref().is_some_and(|outgoing| outgoing.start_s.is_some());
        let replied_s = self.replied_s.take();
        if !has_started && replied_s.is_some_and(|replied_s| time_s - replied_s <= FRAME_S_MAX) {
            return true;
        }
        let shift = usize::from(sentence.field(0).len() < 3);
        let Some(mode) = sentence.number(3 + shift) else { return false };
        if mode == 0 {
            self.finish_outgoing(time_s, sink);
            // No later sentence can revoke this transmission.
            self.finished_s = None;
            return false;
        }
        let transmissions = sink.recording.transmissions.get_or_insert_default();
        if self.outgoing.take().is_some() {
            self.failed += 1;
        } else if self.finished_s.take().is_some_and(|finished_s| time_s - finished_s <= FRAME_S_MAX) {
            self.failed += usize::from(transmissions.pop().is_some());
        }
        false
    }
}
