//! What the sentences between a host and its WHOI Micro-Modem tell.
//!
//! Sent is what the modem says that it has sent (`CATXF`, or `CAXST` with mode 0); cycle requests and data that a host gave are not. Heard is
//! what it gives its host (`CARXD`, `CAMUA`, `CARDP`); of messages that were not decoded the sender is known by statistics alone
//! (`CACST`, mode 1). That another vehicle's modem was heard to announce something is no sign that this one was at work: it would
//! tie when it was at work to what it heard.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;

use crate::model::exclusion::ExclusionReason;
use crate::model::parsed_file::SkipCounts;
use crate::model::recording::{BAND_PARTS, SentMessage};
use crate::readers::modem::nmea::Sentence;
use crate::readers::sink::{FrameInfo, Sink};

/// Sentences of one message lie no farther apart than this, in seconds: an announcement and its data, data and its statistics.
const MESSAGE_S_MAX: f64 = 30.0;

/// No longer than this from one frame of a message to the next.
const FRAME_S_MAX: f64 = 5.0;

/// So long a modem hears nothing when it starts, or ranges.
const START_S: f64 = 5.0;
const RANGING_S: f64 = 5.0;

/// A modem that says that it has finished, but not when it began, had begun no earlier than this.
const PACKET_S_MAX: f64 = 3.0;

/// What modems said so far.
#[derive(Debug, Default)]
pub(crate) struct Micromodem {
    /// Whether anything was said.
    pub(crate) has_sentences: bool,
    /// Whom the latest cycle is for.
    cycle: Option<Cycle>,
    outgoing: Option<OutgoingMessage>,
    incoming: Option<IncomingMessage>,
    /// When it last finished a message.
    finished_s: Option<f64>,
    /// When a packet that is no message began.
    control_begin_s: Option<f64>,
    /// When a frame was broken whose sender may still be named.
    broken_s: Option<f64>,
    /// Number, carrier and bandwidth of its band, as far as it said them.
    band: [String; 3],
    /// When it was told to start anew.
    reset_s: Option<f64>,
    /// How many messages were broken whose sender nobody named, and how many were not sent in the end.
    unattributed: usize,
    not_sent: usize,
}

/// Who shall send how many frames at what rate.
#[derive(Debug, Clone)]
struct Cycle {
    time_s: f64,
    source: String,
    rate: String,
    frames: Option<u32>,
}

/// Data that a modem was given to send.
#[derive(Debug)]
struct OutgoingMessage {
    time_s: f64,
    begin_s: Option<f64>,
    destination: String,
    kind: Option<MessageKind>,
    /// Frames by the host's word and by the modem's echo.
    by_host: u32,
    by_echo: u32,
}

/// A message of several frames that arrives.
#[derive(Debug)]
struct IncomingMessage {
    /// When it was first heard of, and last.
    time_s: f64,
    latest_s: f64,
    /// When the first frame was decoded.
    decoded_s: Option<f64>,
    source: String,
    destination: String,
    kind: Option<MessageKind>,
    decoded: BTreeSet<u32>,
    frames: u32,
    is_broken: bool,
}

impl IncomingMessage {
    /// Whether as many frames are decoded as were announced.
    fn is_whole(&self) -> bool {
        self.frames > 0 && self.decoded.len() as u32 >= self.frames
    }
}

fn rate_kind(rate: &str) -> Option<MessageKind> {
    (!rate.is_empty() && !rate.contains(char::is_control)).then(|| MessageKind::new(format!("rate {rate}")))
}

fn mini_kind() -> Option<MessageKind> {
    Some(MessageKind::new("mini"))
}

impl Micromodem {
    /// Takes a sentence in, said at this time by the host's clock.
    pub(crate) fn absorb(&mut self, time_s: f64, sentence: &Sentence, mut sink: Sink) {
        if self.incoming.as_ref().is_some_and(|incoming| time_s - incoming.latest_s > FRAME_S_MAX) {
            self.finish_incoming(&mut sink);
        }
        self.has_sentences = true;
        // A host that talks to a modem keeps a record of both ways, even where nothing came of it.
        sink.recording.arrivals.get_or_insert_default();
        sink.recording.sent.get_or_insert_default();
        match sentence.name {
            "CARXD" | "CAMSG" | "CACST" | "CAMUA" | "CARDP" => self.absorb_reception(time_s, sentence, &mut sink),
            "CACYC" | "CCCYC" => self.absorb_cycle(time_s, sentence, &mut sink),
            "CAREV" | "CACFG" | "CACLK" | "CATMS" | "CATMG" | "CAMSC" | "CCMSC" => {
                self.absorb_status(time_s, sentence, &mut sink)
            }
            "CAMPC" | "CAMPA" | "CAPDT" | "CAPNT" | "CAPGT" => {
                sink.recording.deaf_intervals.push((time_s, time_s + RANGING_S, ExclusionReason::OtherMode));
                sink.record_activity(time_s);
            }
            name if name.starts_with("CC") || name.starts_with("CA") => {
                self.absorb_sending(time_s, sentence, &mut sink)
            }
            _ => {}
        }
    }

    /// At the end of the record; what of it says nothing is counted.
    pub(crate) fn finish(&mut self, mut sink: Sink, skipped: &mut SkipCounts) {
        self.finish_incoming(&mut sink);
        skipped.unattributed += self.unattributed;
        skipped.not_sent += self.not_sent;
    }

    /// What a modem says of itself.
    fn absorb_status(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        match sentence.name {
            "CCMSC" => return,
            "CAMSC" => {
                self.reset_s = Some(time_s);
                self.forget_outgoing();
            }
            "CAREV" if sentence.field(1) == "INIT" => {
                self.forget_outgoing();
                let from_s = self.reset_s.take().unwrap_or(time_s - START_S);
                sink.recording.deaf_intervals.push((from_s, time_s, ExclusionReason::Rebooting));
            }
            "CACFG" if sentence.field(0) == "SRC" => sink.add_modem_id(sentence.field(1)),
            "CACFG" => {
                // The band by its number; number 0 is what carrier and bandwidth make it.
                if let Some(place) = ["BND", "FC0", "BW0"].iter().position(|name| *name == sentence.field(0)) {
                    sentence.field(1).clone_into(&mut self.band[place]);
                    let [number, ..] = &self.band;
                    let is_custom = matches!(number.as_str(), "" | "0");
                    let band = if is_custom { self.band.join(BAND_PARTS) } else { number.clone() };
                    sink.recording.set_band(time_s, band.trim_end_matches(BAND_PARTS).to_owned());
                }
            }
            _ => {}
        }
        sink.record_activity(time_s);
    }

    /// A cycle: who shall send, at what rate. Proves nothing.
    fn absorb_cycle(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        // Whatever arrived before is all there is of it, and what broke before was none of what is announced.
        self.finish_incoming(sink);
        self.broken_s = None;
        let (source, rate) = (sentence.field(1).to_owned(), sentence.field(3).to_owned());
        if sentence.name == "CACYC" && sink.recording.modem_ids.contains(&source) {
            sink.record_activity(time_s);
        }
        self.cycle = Some(Cycle { time_s, source, rate, frames: sentence.number(5).filter(|frames| *frames > 0) });
    }

    fn cycle_of(&self, source: &str, time_s: f64) -> Option<&Cycle> {
        self.cycle.as_ref().filter(|cycle| cycle.source == source && time_s - cycle.time_s <= MESSAGE_S_MAX)
    }

    fn absorb_sending(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        match sentence.name {
            "CADRQ" => sink.add_modem_id(sentence.field(1)),
            "CATXD" => sink.add_modem_id(sentence.field(0)),
            "CATXP" | "CATXF" | "CAXST" | "CAERR" | "CAMUC" | "CATDP" => {}
            "CCTXD" | "CCMUC" | "CCTDP" => {
                self.absorb_data(time_s, sentence);
                return;
            }
            _ => return,
        }
        sink.record_activity(time_s);
        let is_stale =
            |outgoing: &OutgoingMessage| time_s - outgoing.begin_s.unwrap_or(outgoing.time_s) > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_some_and(is_stale) {
            self.forget_outgoing();
        }
        match sentence.name {
            "CATXD" | "CAMUC" | "CATDP" => self.absorb_data(time_s, sentence),
            "CATXP" => match &mut self.outgoing {
                Some(outgoing) => outgoing.begin_s = Some(time_s),
                None => self.control_begin_s = Some(time_s),
            },
            "CATXF" if self.outgoing.is_some() => self.finish_outgoing(time_s, sink),
            "CATXF" => {
                // Of a cycle, or of an answer: no message, and deaf meanwhile.
                let begin_s = self.control_begin_s.take().filter(|begin_s| time_s - begin_s <= MESSAGE_S_MAX);
                sink.recording.deaf_intervals.push((
                    begin_s.unwrap_or(time_s - PACKET_S_MAX),
                    time_s,
                    ExclusionReason::Transmitting,
                ));
            }
            "CAXST" => self.absorb_transmit_statistics(time_s, sentence, sink),
            "CAERR" if sentence.fields.contains(&"DATA_TIMEOUT") => {
                self.forget_outgoing();
            }
            _ => {}
        }
    }

    /// Data that were given to the modem are not sent any more.
    fn forget_outgoing(&mut self) {
        self.not_sent += usize::from(self.outgoing.take().is_some());
    }

    /// Data for the modem, by the host's word or by its echo.
    fn absorb_data(&mut self, time_s: f64, sentence: &Sentence) {
        let is_echo = sentence.name.starts_with("CA");
        let (destination, kind, has_data) = match sentence.name {
            "CCTXD" => (1, None, !sentence.field(3).is_empty()),
            "CATXD" => (1, None, sentence.field(3) != "0"),
            "CCMUC" | "CAMUC" => (1, mini_kind(), true),
            "CCTDP" => (0, rate_kind(sentence.field(1)), true),
            _ => (2, rate_kind(sentence.field(3)), true),
        };
        if !has_data {
            return;
        }
        let cycle = self.cycle.as_ref().filter(|cycle| time_s - cycle.time_s <= MESSAGE_S_MAX);
        let kind = kind.or_else(|| rate_kind(&cycle?.rate));
        let is_new =
            |outgoing: &OutgoingMessage| outgoing.begin_s.is_some() || time_s - outgoing.time_s > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_none_or(is_new) {
            let destination = sentence.field(destination).to_owned();
            self.outgoing = Some(OutgoingMessage { time_s, begin_s: None, destination, kind, by_host: 0, by_echo: 0 });
        }
        let Some(outgoing) = &mut self.outgoing else { return };
        *if is_echo { &mut outgoing.by_echo } else { &mut outgoing.by_host } += 1;
    }

    /// The modem has finished.
    fn finish_outgoing(&mut self, time_s: f64, sink: &mut Sink) {
        let Some(outgoing) = self.outgoing.take() else { return };
        self.finished_s = Some(time_s);
        let frames = outgoing.by_host.max(outgoing.by_echo);
        let sent = SentMessage {
            time_s: outgoing.begin_s.unwrap_or(time_s),
            destination: sink.ids.resolve(&outgoing.destination),
            frames: (frames > 0).then_some(frames),
            kind: outgoing.kind,
            band: None,
        };
        sink.recording.sent.get_or_insert_default().push(sent);
    }

    /// Statistics of what was sent: with an error it was not. From version 6 on the version stands before all others.
    fn absorb_transmit_statistics(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        let shift = usize::from(sentence.field(0).len() < 3);
        let Some(mode) = sentence.number(3 + shift) else { return };
        if mode == 0 {
            self.finish_outgoing(time_s, sink);
            // Nothing takes it back any more.
            self.finished_s = None;
            return;
        }
        let sent = sink.recording.sent.get_or_insert_default();
        if self.outgoing.take().is_some() {
            self.not_sent += 1;
        } else if self.finished_s.take().is_some_and(|finished_s| time_s - finished_s <= FRAME_S_MAX) {
            self.not_sent += usize::from(sent.pop().is_some());
        }
    }

    fn absorb_reception(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        match sentence.name {
            "CARXD" => {
                let (source, destination) = (sentence.field(0), sentence.field(1));
                let Some(frame) = sentence.number(3).filter(|frame| *frame > 0) else { return };
                let begins = |incoming: &IncomingMessage| incoming.decoded.last().is_some_and(|last| frame <= *last);
                if self.incoming.as_ref().is_some_and(begins) {
                    self.finish_incoming(sink);
                }
                let incoming = self.extend_incoming(time_s, (source, destination), sink);
                incoming.decoded.insert(frame);
                incoming.decoded_s.get_or_insert(time_s);
            }
            "CAMSG" => {
                let is_broken = sentence.field(0).to_uppercase().replace(' ', "_") == "BAD_CRC";
                let is_known = self.broken_s.is_some_and(|broken_s| time_s - broken_s <= FRAME_S_MAX);
                if is_broken && !is_known {
                    self.broken_s = Some(time_s);
                    self.unattributed += 1;
                }
            }
            "CACST" => self.absorb_receive_statistics(time_s, sentence, sink),
            "CAMUA" => {
                self.finish_incoming(sink);
                let part = FrameInfo { good: true, kind: mini_kind(), ..FrameInfo::default() };
                sink.add_arrival(time_s, (sentence.field(0), sentence.field(1)), part);
            }
            _ => {
                self.finish_incoming(sink);
                // Whether each frame is good, its length and its bytes, in turn.
                let frames: Vec<&str> =
                    sentence.field(5).split(';').step_by(3).filter(|good| !good.is_empty()).collect();
                let number = frames.len().max(1) as u32;
                for frame in 1..=number {
                    let good = frames.get(frame as usize - 1) == Some(&"1");
                    let kind = rate_kind(sentence.field(2));
                    let part = FrameInfo { frame: Some(frame), frames: Some(number), good, kind };
                    sink.add_arrival(time_s, (sentence.field(0), sentence.field(1)), part);
                }
            }
        }
    }

    /// The message of a source that is arriving; a new one if there is none.
    fn extend_incoming(
        &mut self,
        time_s: f64,
        (source, destination): (&str, &str),
        sink: &mut Sink,
    ) -> &mut IncomingMessage {
        if self.incoming.as_ref().is_some_and(|incoming| incoming.source != source) {
            self.finish_incoming(sink);
        }
        let cycle = self.cycle_of(source, time_s);
        let (frames, kind) = cycle.map_or((0, None), |cycle| (cycle.frames.unwrap_or(0), rate_kind(&cycle.rate)));
        // A frame that broke just before was one of this message.
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

    /// Statistics of what was received: good (0), broken (1), nothing came (2). From version 6 on the version stands before all others.
    fn absorb_receive_statistics(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        let shift = usize::from(sentence.number(0).is_some_and(|version| version >= 6));
        let at = |place: usize| sentence.field(place + shift);
        let source = at(13);
        if at(0) != "1" || source.parse::<u32>().is_err() {
            return;
        }
        let frames = at(17).parse().unwrap_or(0);
        let kind = rate_kind(at(12));
        // What breaks after a message that is whole is another one.
        if self.incoming.as_ref().is_some_and(IncomingMessage::is_whole) {
            self.finish_incoming(sink);
        }
        let incoming = self.extend_incoming(time_s, (source, at(14)), sink);
        incoming.frames = incoming.frames.max(frames);
        incoming.kind = incoming.kind.take().or(kind);
        incoming.is_broken = true;
    }

    /// All of a message is there that will come.
    fn finish_incoming(&mut self, sink: &mut Sink) {
        let Some(incoming) = self.incoming.take() else { return };
        let is_whole = incoming.is_whole();
        let IncomingMessage { time_s, decoded_s, source, destination, kind, decoded, frames, is_broken, .. } = incoming;
        let (last, count) = (decoded.last().copied().unwrap_or(0), decoded.len() as u32);
        // Where as many frames were decoded as were announced, what broke before was none of them: an announcement, or an
        // earlier try. Otherwise broken frames are some beside those that were decoded.
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
