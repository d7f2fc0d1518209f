//! The messages that reach one modem, by its own sentences.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;

use crate::readers::modem::cycle::{Cycle, FRAME_S_MAX, mini_kind, rate_kind};
use crate::readers::modem::flexible_packet::{FlexiblePacket, is_set};
use crate::readers::modem::nmea::Sentence;
use crate::readers::sink::{FrameInfo, Sink};

/// Types of packets in statistics: frequency-shift keying and phase-shift keying, each as data or as a mini-packet. The
/// rate of another type is that of its mini frames.
const CYCLE_PACKET_TYPES: std::ops::RangeInclusive<u32> = 1..=4;

/// The state of the receiving side of a modem.
#[derive(Debug, Default)]
pub(super) struct Receiver {
    incoming: Option<IncomingMessage>,
    /// Time of a broken frame without a sender so far.
    broken_s: Option<f64>,
    /// Number of broken messages without a sender.
    pub(super) unattributed: usize,
    /// Number of sentences with missing fields.
    pub(super) garbled: usize,
}

/// A message that is being received frame by frame.
#[derive(Debug)]
struct IncomingMessage {
    /// Times of its first and its latest sentence.
    time_s: f64,
    latest_s: f64,
    /// Time of its first decoded frame.
    decoded_s: Option<f64>,
    source: String,
    destination: String,
    kind: Option<MessageKind>,
    decoded: BTreeSet<u32>,
    frames: u32,
    is_broken: bool,
}

impl IncomingMessage {
    /// Returns whether all announced frames are decoded.
    fn is_whole(&self) -> bool {
        self.frames > 0 && self.decoded.len() as u32 >= self.frames
    }
}

/// Returns whether a decoded message makes the modem answer by itself: it requests an acknowledgement and is not
/// addressed to another modem. The modem answers each mini-packet that is addressed to it.
pub(super) fn requests_reply(sentence: &Sentence, sink: &Sink) -> bool {
    let (destination, is_requested) = match sentence.name {
        "CARXD" | "CARXA" => (sentence.field(1), is_set(sentence.field(2))),
        "CAMUA" => (sentence.field(1), true),
        "CARDP" | "CARFP" => match FlexiblePacket::parse(sentence) {
            Some(packet) => (packet.destination, packet.requests_reply),
            None => return false,
        },
        _ => return false,
    };
    let own_ids = &sink.recording.modem_ids;
    let is_own = if own_ids.is_empty() { sentence.name != "CAMUA" } else { own_ids.contains(destination) };
    is_own && is_requested
}

impl Receiver {
    /// Absorbs a sentence about a message that reached the modem. `cycle` is the latest announcement.
    pub(super) fn absorb(&mut self, time_s: f64, sentence: &Sentence, cycle: Option<&Cycle>, sink: &mut Sink) {
        match sentence.name {
            "CARXD" | "CARXA" => self.absorb_frame(time_s, sentence, cycle, sink),
            "CAMSG" => {
                let is_broken = sentence.field(0).to_uppercase().replace(' ', "_") == "BAD_CRC";
                let is_counted = self.broken_s.is_some_and(|broken_s| time_s - broken_s <= FRAME_S_MAX);
                if is_broken && !is_counted {
                    self.broken_s = Some(time_s);
                    self.unattributed += 1;
                }
            }
            "CACST" => self.absorb_statistics(time_s, sentence, cycle, sink),
            "CAMUA" => {
                self.finish_incoming(sink);
                let part = FrameInfo { good: true, kind: mini_kind(), ..FrameInfo::default() };
                sink.add_arrival(time_s, (sentence.field(0), sentence.field(1)), part);
            }
            _ => {
                self.finish_incoming(sink);
                let Some(packet) = FlexiblePacket::parse(sentence) else {
                    self.garbled += 1;
                    return;
                };
                let frames = Some(packet.frames.len() as u32);
                for (frame, &good) in (1..).zip(&packet.frames) {
                    let part = FrameInfo { frame: Some(frame), frames, good, kind: packet.kind.clone() };
                    sink.add_arrival(time_s, (packet.source, packet.destination), part);
                }
            }
        }
    }

    /// Ends the present message before the announced one. A frame that broke earlier is not part of the announced one.
    pub(super) fn start_cycle(&mut self, sink: &mut Sink) {
        self.finish_incoming(sink);
        self.broken_s = None;
    }

    /// Ends the present message if no frame arrived for long.
    pub(super) fn finish_stale(&mut self, time_s: f64, sink: &mut Sink) {
        if self.incoming.as_ref().is_some_and(|incoming| time_s - incoming.latest_s > FRAME_S_MAX) {
            self.finish_incoming(sink);
        }
    }

    /// Ends the present message if its first sentence came before a time.
    pub(super) fn finish_before(&mut self, time_s: f64, sink: &mut Sink) {
        if self.incoming.as_ref().is_some_and(|incoming| incoming.time_s < time_s) {
            self.finish_incoming(sink);
        }
    }

    /// Absorbs a decoded frame.
    fn absorb_frame(&mut self, time_s: f64, sentence: &Sentence, cycle: Option<&Cycle>, sink: &mut Sink) {
        let (source, destination) = (sentence.field(0), sentence.field(1));
        let Some(frame) = sentence.number(3).filter(|frame| *frame > 0) else {
            self.garbled += 1;
            return;
        };
        let starts_new_message =
            |incoming: &IncomingMessage| incoming.decoded.last().is_some_and(|last| frame <= *last);
        if self.incoming.as_ref().is_some_and(starts_new_message) {
            self.finish_incoming(sink);
        }
        let incoming = self.extend_incoming(time_s, (source, destination), cycle, sink);
        incoming.decoded.insert(frame);
        incoming.decoded_s.get_or_insert(time_s);
    }

    /// Returns the incoming message of a source, and starts a new one if necessary.
    fn extend_incoming(
        &mut self,
        time_s: f64,
        (source, destination): (&str, &str),
        cycle: Option<&Cycle>,
        sink: &mut Sink,
    ) -> &mut IncomingMessage {
        if self.incoming.as_ref().is_some_and(|incoming| incoming.source != source) {
            self.finish_incoming(sink);
        }
        let cycle = cycle.filter(|cycle| cycle.source == source && cycle.is_recent(time_s));
        let (frames, kind) = cycle.map_or((0, None), |cycle| (cycle.frames.unwrap_or(0), cycle.kind()));
        // A frame that broke shortly before belongs to this message.
        let broken_s = self.broken_s.take().filter(|broken_s| time_s - broken_s <= FRAME_S_MAX);
        self.unattributed -= usize::from(broken_s.is_some());
        let incoming = self.incoming.get_or_insert_with(|| IncomingMessage {
            time_s: broken_s.unwrap_or(time_s),
            latest_s: time_s,
            decoded_s: None,
            source: source.to_owned(),
            destination: destination.to_owned(),
            kind,
            decoded: BTreeSet::new(),
            frames,
            is_broken: false,
        });
        incoming.is_broken |= broken_s.is_some();
        incoming.latest_s = time_s;
        incoming
    }

    /// Absorbs receive statistics with mode 0 (good), 1 (broken) or 2 (no packet). From version 6 on, the first field
    /// is the version.
    fn absorb_statistics(&mut self, time_s: f64, sentence: &Sentence, cycle: Option<&Cycle>, sink: &mut Sink) {
        let shift = usize::from(sentence.number(0).is_some_and(|version| version >= 6));
        let field = |index: usize| sentence.field(index + shift);
        let source = field(13);
        if field(0) != "1" || source.parse::<u32>().is_err() {
            return;
        }
        let frames = field(17).parse().unwrap_or(0);
        let is_cycle = field(16).parse().map_or(true, |packet_type| CYCLE_PACKET_TYPES.contains(&packet_type));
        let kind = rate_kind(field(12)).filter(|_| is_cycle);
        // A packet that breaks after a complete message belongs to another message.
        if self.incoming.as_ref().is_some_and(IncomingMessage::is_whole) {
            self.finish_incoming(sink);
        }
        let incoming = self.extend_incoming(time_s, (source, field(14)), cycle, sink);
        incoming.frames = incoming.frames.max(frames);
        incoming.kind = incoming.kind.take().or(kind);
        incoming.is_broken = true;
    }

    /// Records the incoming message; no more frames will arrive.
    pub(super) fn finish_incoming(&mut self, sink: &mut Sink) {
        let Some(incoming) = self.incoming.take() else { return };
        let is_whole = incoming.is_whole();
        let IncomingMessage { time_s, decoded_s, source, destination, kind, decoded, frames, is_broken, .. } = incoming;
        let (last, count) = (decoded.last().copied().unwrap_or(0), decoded.len() as u32);
        // If all announced frames are decoded, an earlier broken packet was not one of them. It was an announcement, or
        // an earlier attempt. Otherwise the broken frames are additional frames of this message.
        let (time_s, frames) = match decoded_s.filter(|_| is_whole) {
            Some(decoded_s) => (decoded_s, frames.max(last)),
            None => (time_s, frames.max(last).max(u32::from(is_broken) + count)),
        };
        for frame in decoded.iter().copied().chain(decoded.is_empty().then_some(1)) {
            let part =
                FrameInfo { frame: Some(frame), frames: Some(frames), good: !decoded.is_empty(), kind: kind.clone() };
            sink.add_arrival(time_s, (&source, &destination), part);
        }
    }
}
