//! A state machine over the sentences between a host and its WHOI Micro-Modem.
//!
//! A transmission requires the modem's own report (`CATXF`, or `CAXST` with mode 0). Cycle requests and the host's data
//! are not sufficient. A reception is a sentence with data for the host (`CARXD`, `CAMUA`, `CARDP`). For a broken
//! message, only the statistics name the sender (`CACST`, mode 1).
//!
//! The announcement of another vehicle does not count as activity of this modem. Otherwise the activity would depend on
//! receptions.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;

use crate::model::exclusion::ExclusionReason;
use crate::model::parsed_file::SkipCounts;
use crate::model::recording::{BAND_PARTS, Reply, TransmissionRecord};
use crate::readers::modem::nmea::Sentence;
use crate::readers::sink::{FrameInfo, Sink};

/// Longest time between sentences of one message, in seconds: an announcement and its data, or data and its statistics.
const MESSAGE_S_MAX: f64 = 30.0;

/// Longest interval between two successive frames of one message, in seconds.
const FRAME_S_MAX: f64 = 5.0;

/// Time for which the modem is deaf before it reports a start, in seconds.
const START_S: f64 = 5.0;

/// Time for which the modem is deaf while it ranges, in seconds.
const RANGING_S: f64 = 5.0;

/// Duration of a packet, in seconds, if the modem reports only its end.
const PACKET_S_MAX: f64 = 3.0;

/// Longest time from a decoded message to the start of its acknowledgement, in seconds.
const REPLY_S_MAX: f64 = 5.0;

/// The state of one modem, derived from its sentences.
#[derive(Debug, Default)]
pub(crate) struct Micromodem {
    /// Whether there was any sentence.
    pub(crate) has_sentences: bool,
    /// The latest cycle.
    cycle: Option<Cycle>,
    outgoing: Option<OutgoingMessage>,
    incoming: Option<IncomingMessage>,
    /// Time at which the latest transmission finished.
    finished_s: Option<f64>,
    /// Start of a packet without data.
    control_start_s: Option<f64>,
    /// Time of a decoded message that the modem acknowledges.
    acknowledged_s: Option<f64>,
    /// Time of a broken frame without a sender so far.
    broken_s: Option<f64>,
    /// Number, carrier and bandwidth of its band; empty if not reported.
    band: [String; 3],
    /// Time of the command to restart.
    reset_s: Option<f64>,
    /// Number of broken messages without a sender, and of messages that were not transmitted.
    unattributed: usize,
    failed_transmissions: usize,
}

/// An announcement: the source will send a number of frames at a rate.
#[derive(Debug, Clone)]
struct Cycle {
    time_s: f64,
    source: String,
    rate: String,
    frames: Option<u32>,
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

fn rate_kind(rate: &str) -> Option<MessageKind> {
    (!rate.is_empty() && !rate.contains(char::is_control)).then(|| MessageKind::new(format!("rate {rate}")))
}

fn mini_kind() -> Option<MessageKind> {
    Some(MessageKind::new("mini"))
}

/// Returns whether a decoded message makes the modem answer by itself: it requests an acknowledgement and is not
/// addressed to another modem. The modem answers each mini-packet that is addressed to it.
fn requests_reply(sentence: &Sentence, sink: &Sink) -> bool {
    let (destination, flag) = match sentence.name {
        "CARXD" => (sentence.field(1), sentence.field(2)),
        "CAMUA" => (sentence.field(1), "1"),
        "CARDP" => (sentence.field(1), sentence.field(3)),
        _ => return false,
    };
    let own_ids = &sink.recording.modem_ids;
    let is_own = if own_ids.is_empty() { sentence.name != "CAMUA" } else { own_ids.contains(destination) };
    is_own && !matches!(flag, "" | "0")
}

impl Micromodem {
    /// Absorbs a sentence. The time is by the host's clock, in seconds.
    pub(crate) fn absorb(&mut self, time_s: f64, sentence: &Sentence, mut sink: Sink) {
        if self.incoming.as_ref().is_some_and(|incoming| time_s - incoming.latest_s > FRAME_S_MAX) {
            self.finish_incoming(&mut sink);
        }
        self.has_sentences = true;
        // A host with a modem records receptions and transmissions, so both records exist even if they are empty.
        sink.recording.arrivals.get_or_insert_default();
        sink.recording.transmissions.get_or_insert_default();
        match sentence.name {
            "CARXD" | "CAMSG" | "CACST" | "CAMUA" | "CARDP" => {
                if requests_reply(sentence, &sink) {
                    self.acknowledged_s = Some(time_s);
                }
                self.absorb_reception(time_s, sentence, &mut sink);
            }
            "CACYC" | "CCCYC" => self.absorb_cycle(time_s, sentence, &mut sink),
            "CAREV" | "CACFG" | "CACLK" | "CATMS" | "CATMG" | "CAMSC" | "CCMSC" => {
                self.absorb_status(time_s, sentence, &mut sink)
            }
            "CAMPC" | "CAMPA" | "CAPDT" | "CAPNT" | "CAPGT" => {
                self.acknowledged_s = None;
                sink.recording.deaf_intervals.push((time_s, time_s + RANGING_S, ExclusionReason::OtherMode));
                sink.record_activity(time_s);
            }
            name if name.starts_with("CC") || name.starts_with("CA") => {
                self.absorb_transmission(time_s, sentence, &mut sink)
            }
            _ => {}
        }
    }

    /// Ends the record, and adds the counts of unusable messages to `skipped`.
    pub(crate) fn finish(&mut self, mut sink: Sink, skipped: &mut SkipCounts) {
        self.finish_incoming(&mut sink);
        skipped.unattributed += self.unattributed;
        skipped.failed_transmissions += self.failed_transmissions;
    }

    /// Absorbs a report of the modem's own state.
    fn absorb_status(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        match sentence.name {
            "CCMSC" => return,
            "CAMSC" => {
                self.reset_s = Some(time_s);
                self.drop_outgoing();
            }
            "CAREV" if sentence.field(1) == "INIT" => {
                self.drop_outgoing();
                let from_s = self.reset_s.take().unwrap_or(time_s - START_S);
                sink.recording.deaf_intervals.push((from_s, time_s, ExclusionReason::Rebooting));
            }
            "CACFG" if sentence.field(0) == "SRC" => sink.add_modem_id(sentence.field(1)),
            "CACFG" => {
                // The number identifies a band. Band 0 is custom: its carrier and bandwidth identify it.
                if let Some(index) = ["BND", "FC0", "BW0"].iter().position(|name| *name == sentence.field(0)) {
                    sentence.field(1).clone_into(&mut self.band[index]);
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

    /// Absorbs a cycle. It is no evidence of a transmission.
    fn absorb_cycle(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        // The announcement ends the previous message. A frame that broke earlier is not part of the announced message.
        self.finish_incoming(sink);
        (self.broken_s, self.acknowledged_s) = (None, None);
        let (source, rate) = (sentence.field(1).to_owned(), sentence.field(3).to_owned());
        if sentence.name == "CACYC" && sink.recording.modem_ids.contains(&source) {
            sink.record_activity(time_s);
        }
        self.cycle = Some(Cycle { time_s, source, rate, frames: sentence.number(5).filter(|frames| *frames > 0) });
    }

    fn latest_cycle(&self, source: &str, time_s: f64) -> Option<&Cycle> {
        self.cycle.as_ref().filter(|cycle| cycle.source == source && time_s - cycle.time_s <= MESSAGE_S_MAX)
    }

    fn absorb_transmission(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
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
            |outgoing: &OutgoingMessage| time_s - outgoing.start_s.unwrap_or(outgoing.time_s) > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_some_and(is_stale) {
            self.drop_outgoing();
        }
        match sentence.name {
            "CATXD" | "CAMUC" | "CATDP" => self.absorb_data(time_s, sentence),
            "CATXP" => match &mut self.outgoing {
                Some(outgoing) => outgoing.start_s = Some(time_s),
                None => self.control_start_s = Some(time_s),
            },
            "CATXF" if self.outgoing.is_some() => self.finish_outgoing(time_s, sink),
            "CATXF" => self.finish_control_packet(time_s, sink),
            "CAXST" => self.absorb_transmit_statistics(time_s, sentence, sink),
            "CAERR" if sentence.fields.contains(&"DATA_TIMEOUT") => {
                self.drop_outgoing();
            }
            _ => {}
        }
    }

    /// Records a packet without data. The modem is deaf while it transmits a cycle or an acknowledgement.
    fn finish_control_packet(&mut self, end_s: f64, sink: &mut Sink) {
        let start_s = self.control_start_s.take().filter(|start_s| end_s - start_s <= MESSAGE_S_MAX);
        let decoded_s = self.acknowledged_s.take();
        let start_s = start_s.unwrap_or(decoded_s.unwrap_or(f64::NEG_INFINITY).max(end_s - PACKET_S_MAX));
        match decoded_s.filter(|decoded_s| (0.0..=REPLY_S_MAX).contains(&(start_s - decoded_s))) {
            Some(decoded_s) => sink.recording.replies.push(Reply { decoded_s, start_s, end_s }),
            None => sink.recording.deaf_intervals.push((start_s, end_s, ExclusionReason::Transmitting)),
        }
    }

    /// Drops data that the modem will not transmit any more.
    fn drop_outgoing(&mut self) {
        self.failed_transmissions += usize::from(self.outgoing.take().is_some());
    }

    /// Absorbs data for transmission, from the host or from the modem's echo.
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
            |outgoing: &OutgoingMessage| outgoing.start_s.is_some() || time_s - outgoing.time_s > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_none_or(is_new) {
            let destination = sentence.field(destination).to_owned();
            self.outgoing =
                Some(OutgoingMessage { time_s, start_s: None, destination, kind, host_frames: 0, echo_frames: 0 });
        }
        let Some(outgoing) = &mut self.outgoing else { return };
        *if is_echo { &mut outgoing.echo_frames } else { &mut outgoing.host_frames } += 1;
    }

    /// Records the transmission that the modem has finished.
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
    /// field is the version.
    fn absorb_transmit_statistics(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        let shift = usize::from(sentence.field(0).len() < 3);
        let Some(mode) = sentence.number(3 + shift) else { return };
        if mode == 0 {
            self.finish_outgoing(time_s, sink);
            // No later sentence can revoke this transmission.
            self.finished_s = None;
            return;
        }
        let transmissions = sink.recording.transmissions.get_or_insert_default();
        if self.outgoing.take().is_some() {
            self.failed_transmissions += 1;
        } else if self.finished_s.take().is_some_and(|finished_s| time_s - finished_s <= FRAME_S_MAX) {
            self.failed_transmissions += usize::from(transmissions.pop().is_some());
        }
    }

    fn absorb_reception(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        match sentence.name {
            "CARXD" => {
                let (source, destination) = (sentence.field(0), sentence.field(1));
                let Some(frame) = sentence.number(3).filter(|frame| *frame > 0) else { return };
                let starts_new_message =
                    |incoming: &IncomingMessage| incoming.decoded.last().is_some_and(|last| frame <= *last);
                if self.incoming.as_ref().is_some_and(starts_new_message) {
                    self.finish_incoming(sink);
                }
                let incoming = self.extend_incoming(time_s, (source, destination), sink);
                incoming.decoded.insert(frame);
                incoming.decoded_s.get_or_insert(time_s);
            }
            "CAMSG" => {
                let is_broken = sentence.field(0).to_uppercase().replace(' ', "_") == "BAD_CRC";
                let is_counted = self.broken_s.is_some_and(|broken_s| time_s - broken_s <= FRAME_S_MAX);
                if is_broken && !is_counted {
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
                // Triples of a flag (1 for a good frame), the length and the bytes.
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

    /// Returns the incoming message of a source, and starts a new one if necessary.
    fn extend_incoming(
        &mut self,
        time_s: f64,
        (source, destination): (&str, &str),
        sink: &mut Sink,
    ) -> &mut IncomingMessage {
        if self.incoming.as_ref().is_some_and(|incoming| incoming.source != source) {
            self.finish_incoming(sink);
        }
        let cycle = self.latest_cycle(source, time_s);
        let (frames, kind) = cycle.map_or((0, None), |cycle| (cycle.frames.unwrap_or(0), rate_kind(&cycle.rate)));
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
    fn absorb_receive_statistics(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        let shift = usize::from(sentence.number(0).is_some_and(|version| version >= 6));
        let field = |index: usize| sentence.field(index + shift);
        let source = field(13);
        if field(0) != "1" || source.parse::<u32>().is_err() {
            return;
        }
        let frames = field(17).parse().unwrap_or(0);
        let kind = rate_kind(field(12));
        // A packet that breaks after a complete message belongs to another message.
        if self.incoming.as_ref().is_some_and(IncomingMessage::is_whole) {
            self.finish_incoming(sink);
        }
        let incoming = self.extend_incoming(time_s, (source, field(14)), sink);
        incoming.frames = incoming.frames.max(frames);
        incoming.kind = incoming.kind.take().or(kind);
        incoming.is_broken = true;
    }

    /// Records the incoming message; no more frames will arrive.
    fn finish_incoming(&mut self, sink: &mut Sink) {
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
