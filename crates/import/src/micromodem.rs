//! What the sentences between a host and its WHOI Micro-Modem tell.
//!
//! Sent is what the modem says that it has sent (`CATXF`, or `CAXST` with mode 0); cycle requests and data that a host gave are not. Heard is
//! what it gives its host (`CARXD`, `CAMUA`, `CARDP`); of messages that were not decoded the sender is known by statistics alone
//! (`CACST`, mode 1). That another vehicle's modem was heard to announce something is no sign that this one was at work: it would
//! tie when it was at work to what it heard.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;

use crate::arriving::{Into, Part};
use crate::recording::{BAND_PARTS, Sent, Unknown};
use crate::sentence::Sentence;
use crate::told::Skipped;

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
    pub(crate) spoke: bool,
    /// Whom the latest cycle is for.
    cycle: Option<Cycle>,
    outgoing: Option<Outgoing>,
    incoming: Option<Incoming>,
    /// When it last finished a message.
    finished_s: Option<f64>,
    /// When a packet that is no message began.
    other_begin_s: Option<f64>,
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
struct Outgoing {
    time_s: f64,
    begin_s: Option<f64>,
    destination: String,
    kind: Option<MessageKind>,
    /// Frames by the host's word and by the modem's echo.
    given: u32,
    echoed: u32,
}

/// A message of several frames that arrives.
#[derive(Debug)]
struct Incoming {
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

impl Incoming {
    /// Whether as many frames are decoded as were announced.
    fn is_whole(&self) -> bool {
        self.frames > 0 && self.decoded.len() as u32 >= self.frames
    }
}

fn rate(rate: &str) -> Option<MessageKind> {
    (!rate.is_empty() && !rate.contains(char::is_control)).then(|| MessageKind::new(format!("rate {rate}")))
}

fn mini() -> Option<MessageKind> {
    Some(MessageKind::new("mini"))
}

impl Micromodem {
    /// Takes a sentence in, said at this time by the host's clock.
    pub(crate) fn take(&mut self, time_s: f64, sentence: &Sentence, mut into: Into) {
        if self.incoming.as_ref().is_some_and(|incoming| time_s - incoming.latest_s > FRAME_S_MAX) {
            self.arrived(&mut into);
        }
        self.spoke = true;
        // A host that talks to a modem keeps a record of both ways, even where nothing came of it.
        into.recording.arrivals.get_or_insert_default();
        into.recording.sent.get_or_insert_default();
        match sentence.name {
            "CARXD" | "CAMSG" | "CACST" | "CAMUA" | "CARDP" => self.receive(time_s, sentence, &mut into),
            "CACYC" | "CCCYC" => self.announce(time_s, sentence, &mut into),
            "CAREV" | "CACFG" | "CACLK" | "CATMS" | "CATMG" | "CAMSC" | "CCMSC" => {
                self.work(time_s, sentence, &mut into)
            }
            "CAMPC" | "CAMPA" | "CAPDT" | "CAPNT" | "CAPGT" => {
                into.recording.deaf.push((time_s, time_s + RANGING_S, Unknown::OtherMode));
                into.sign(time_s);
            }
            name if name.starts_with("CC") || name.starts_with("CA") => self.send(time_s, sentence, &mut into),
            _ => {}
        }
    }

    /// At the end of the record; what of it says nothing is counted.
    pub(crate) fn finish(&mut self, mut into: Into, skipped: &mut Skipped) {
        self.arrived(&mut into);
        skipped.unattributed += self.unattributed;
        skipped.not_sent += self.not_sent;
    }

    /// What a modem says of itself.
    fn work(&mut self, time_s: f64, sentence: &Sentence, into: &mut Into) {
        match sentence.name {
            "CCMSC" => return,
            "CAMSC" => {
                self.reset_s = Some(time_s);
                self.forget_outgoing();
            }
            "CAREV" if sentence.field(1) == "INIT" => {
                self.forget_outgoing();
                let from_s = self.reset_s.take().unwrap_or(time_s - START_S);
                into.recording.deaf.push((from_s, time_s, Unknown::Rebooting));
            }
            "CACFG" if sentence.field(0) == "SRC" => into.is_called(sentence.field(1)),
            "CACFG" => {
                // The band by its number; number 0 is what carrier and bandwidth make it.
                if let Some(place) = ["BND", "FC0", "BW0"].iter().position(|name| *name == sentence.field(0)) {
                    sentence.field(1).clone_into(&mut self.band[place]);
                    let [number, ..] = &self.band;
                    let is_made = matches!(number.as_str(), "" | "0");
                    let band = if is_made { self.band.join(BAND_PARTS) } else { number.clone() };
                    into.recording.works_in(time_s, band.trim_end_matches(BAND_PARTS).to_owned());
                }
            }
            _ => {}
        }
        into.sign(time_s);
    }

    /// A cycle: who shall send, at what rate. Proves nothing.
    fn announce(&mut self, time_s: f64, sentence: &Sentence, into: &mut Into) {
        // Whatever arrived before is all there is of it, and what broke before was none of what is announced.
        self.arrived(into);
        self.broken_s = None;
        let (source, rate) = (sentence.field(1).to_owned(), sentence.field(3).to_owned());
        if sentence.name == "CACYC" && into.recording.modem_ids.contains(&source) {
            into.sign(time_s);
        }
        self.cycle = Some(Cycle { time_s, source, rate, frames: sentence.number(5).filter(|frames| *frames > 0) });
    }

    fn cycle_of(&self, source: &str, time_s: f64) -> Option<&Cycle> {
        self.cycle.as_ref().filter(|cycle| cycle.source == source && time_s - cycle.time_s <= MESSAGE_S_MAX)
    }

    fn send(&mut self, time_s: f64, sentence: &Sentence, into: &mut Into) {
        match sentence.name {
            "CADRQ" => into.is_called(sentence.field(1)),
            "CATXD" => into.is_called(sentence.field(0)),
            "CATXP" | "CATXF" | "CAXST" | "CAERR" | "CAMUC" | "CATDP" => {}
            "CCTXD" | "CCMUC" | "CCTDP" => {
                self.give(time_s, sentence);
                return;
            }
            _ => return,
        }
        into.sign(time_s);
        let is_stale = |outgoing: &Outgoing| time_s - outgoing.begin_s.unwrap_or(outgoing.time_s) > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_some_and(is_stale) {
            self.forget_outgoing();
        }
        match sentence.name {
            "CATXD" | "CAMUC" | "CATDP" => self.give(time_s, sentence),
            "CATXP" => match &mut self.outgoing {
                Some(outgoing) => outgoing.begin_s = Some(time_s),
                None => self.other_begin_s = Some(time_s),
            },
            "CATXF" if self.outgoing.is_some() => self.sent(time_s, into),
            "CATXF" => {
                // Of a cycle, or of an answer: no message, and deaf meanwhile.
                let begin_s = self.other_begin_s.take().filter(|begin_s| time_s - begin_s <= MESSAGE_S_MAX);
                into.recording.deaf.push((begin_s.unwrap_or(time_s - PACKET_S_MAX), time_s, Unknown::Transmitting));
            }
            "CAXST" => self.transmitted(time_s, sentence, into),
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
    fn give(&mut self, time_s: f64, sentence: &Sentence) {
        let is_echo = sentence.name.starts_with("CA");
        let (destination, kind, has_data) = match sentence.name {
            "CCTXD" => (1, None, !sentence.field(3).is_empty()),
            "CATXD" => (1, None, sentence.field(3) != "0"),
            "CCMUC" | "CAMUC" => (1, mini(), true),
            "CCTDP" => (0, rate(sentence.field(1)), true),
            _ => (2, rate(sentence.field(3)), true),
        };
        if !has_data {
            return;
        }
        let cycle = self.cycle.as_ref().filter(|cycle| time_s - cycle.time_s <= MESSAGE_S_MAX);
        let kind = kind.or_else(|| rate(&cycle?.rate));
        let is_new = |outgoing: &Outgoing| outgoing.begin_s.is_some() || time_s - outgoing.time_s > MESSAGE_S_MAX;
        if self.outgoing.as_ref().is_none_or(is_new) {
            let destination = sentence.field(destination).to_owned();
            self.outgoing = Some(Outgoing { time_s, begin_s: None, destination, kind, given: 0, echoed: 0 });
        }
        let Some(outgoing) = &mut self.outgoing else { return };
        *if is_echo { &mut outgoing.echoed } else { &mut outgoing.given } += 1;
    }

    /// The modem has finished.
    fn sent(&mut self, time_s: f64, into: &mut Into) {
        let Some(outgoing) = self.outgoing.take() else { return };
        self.finished_s = Some(time_s);
        let frames = outgoing.given.max(outgoing.echoed);
        let sent = Sent {
            time_s: outgoing.begin_s.unwrap_or(time_s),
            destination: into.ids.whom(&outgoing.destination),
            frames: (frames > 0).then_some(frames),
            kind: outgoing.kind,
            band: None,
        };
        into.recording.sent.get_or_insert_default().push(sent);
    }

    /// Statistics of what was sent: with an error it was not. From version 6 on the version stands before all others.
    fn transmitted(&mut self, time_s: f64, sentence: &Sentence, into: &mut Into) {
        let shift = usize::from(sentence.field(0).len() < 3);
        let Some(mode) = sentence.number(3 + shift) else { return };
        if mode == 0 {
            self.sent(time_s, into);
            // Nothing takes it back any more.
            self.finished_s = None;
            return;
        }
        let sent = into.recording.sent.get_or_insert_default();
        if self.outgoing.take().is_some() {
            self.not_sent += 1;
        } else if self.finished_s.take().is_some_and(|finished_s| time_s - finished_s <= FRAME_S_MAX) {
            self.not_sent += usize::from(sent.pop().is_some());
        }
    }

    fn receive(&mut self, time_s: f64, sentence: &Sentence, into: &mut Into) {
        match sentence.name {
            "CARXD" => {
                let (source, destination) = (sentence.field(0), sentence.field(1));
                let Some(frame) = sentence.number(3).filter(|frame| *frame > 0) else { return };
                let begins = |incoming: &Incoming| incoming.decoded.last().is_some_and(|last| frame <= *last);
                if self.incoming.as_ref().is_some_and(begins) {
                    self.arrived(into);
                }
                let incoming = self.incoming(time_s, (source, destination), into);
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
            "CACST" => self.statistics(time_s, sentence, into),
            "CAMUA" => {
                self.arrived(into);
                let part = Part { good: true, kind: mini(), ..Part::default() };
                into.arrive(time_s, (sentence.field(0), sentence.field(1)), part);
            }
            _ => {
                self.arrived(into);
                // Whether each frame is good, its length and its bytes, in turn.
                let frames: Vec<&str> =
                    sentence.field(5).split(';').step_by(3).filter(|good| !good.is_empty()).collect();
                let number = frames.len().max(1) as u32;
                for frame in 1..=number {
                    let good = frames.get(frame as usize - 1) == Some(&"1");
                    let kind = rate(sentence.field(2));
                    let part = Part { frame: Some(frame), frames: Some(number), good, kind };
                    into.arrive(time_s, (sentence.field(0), sentence.field(1)), part);
                }
            }
        }
    }

    /// The message of a source that is arriving; a new one if there is none.
    fn incoming(&mut self, time_s: f64, (source, destination): (&str, &str), into: &mut Into) -> &mut Incoming {
        if self.incoming.as_ref().is_some_and(|incoming| incoming.source != source) {
            self.arrived(into);
        }
        let cycle = self.cycle_of(source, time_s);
        let (frames, kind) = cycle.map_or((0, None), |cycle| (cycle.frames.unwrap_or(0), rate(&cycle.rate)));
        // A frame that broke just before was one of this message.
        let broken_s = self.broken_s.take().filter(|broken_s| time_s - broken_s <= FRAME_S_MAX);
        self.unattributed -= usize::from(broken_s.is_some());
        let incoming = self.incoming.get_or_insert_with(|| Incoming {
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
    fn statistics(&mut self, time_s: f64, sentence: &Sentence, into: &mut Into) {
        let shift = usize::from(sentence.number(0).is_some_and(|version| version >= 6));
        let at = |place: usize| sentence.field(place + shift);
        let source = at(13);
        if at(0) != "1" || source.parse::<u32>().is_err() {
            return;
        }
        let frames = at(17).parse().unwrap_or(0);
        let kind = rate(at(12));
        // What breaks after a message that is whole is another one.
        if self.incoming.as_ref().is_some_and(Incoming::is_whole) {
            self.arrived(into);
        }
        let incoming = self.incoming(time_s, (source, at(14)), into);
        incoming.frames = incoming.frames.max(frames);
        incoming.kind = incoming.kind.take().or(kind);
        incoming.is_broken = true;
    }

    /// All of a message is there that will come.
    fn arrived(&mut self, into: &mut Into) {
        let Some(incoming) = self.incoming.take() else { return };
        let is_whole = incoming.is_whole();
        let Incoming { time_s, decoded_s, source, destination, kind, decoded, frames, is_broken, .. } = incoming;
        let (last, count) = (decoded.last().copied().unwrap_or(0), decoded.len() as u32);
        // Where as many frames were decoded as were announced, what broke before was none of them: an announcement, or an
        // earlier try. Otherwise broken frames are some beside those that were decoded.
        let (time_s, frames) = match decoded_s.filter(|_| is_whole) {
            Some(decoded_s) => (decoded_s, frames.max(last)),
            None => (time_s, frames.max(last).max(u32::from(is_broken) + count)),
        };
        for frame in decoded.iter().copied().chain(decoded.is_empty().then_some(1)) {
            let part = Part { frame: Some(frame), frames: Some(frames), good: !decoded.is_empty(), kind: kind.clone() };
            into.arrive(time_s, (&source, &destination), part);
        }
    }
}
