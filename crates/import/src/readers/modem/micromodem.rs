//! A state machine over the sentences between a host and its WHOI Micro-Modem.
//!
//! A transmission requires the modem's own report (`CATXF`, or `CAXST` with mode 0). Cycle requests and the host's data
//! are not sufficient. A reception is a sentence with data for the host (`CARXD`, `CARXA`, `CAMUA`, `CARDP`, `CARFP`).
//! For a broken message, only the statistics name the sender (`CACST`, mode 1).
//!
//! The announcement of another vehicle does not count as activity of this modem. Otherwise the activity would depend on
//! receptions.

use crate::model::exclusion::ExclusionReason;
use crate::model::parsed_file::{SentenceCounts, SkipCounts};
use crate::model::recording::BAND_PARTS;
use crate::readers::modem::cycle::Cycle;
use crate::readers::modem::nmea::Sentence;
use crate::readers::modem::receiver::{Receiver, requests_reply};
use crate::readers::modem::sentence_names::may_hold_data;
use crate::readers::modem::transmitter::Transmitter;
use crate::readers::sink::Sink;

/// Time for which the modem is deaf before it reports a start, in seconds.
const START_S: f64 = 5.0;

/// Time for which the modem is deaf while it ranges, in seconds.
const RANGING_S: f64 = 5.0;

/// The state of one modem, derived from its sentences.
#[derive(Debug, Default)]
pub(crate) struct Micromodem {
    /// Whether there was any sentence.
    pub(crate) has_sentences: bool,
    /// The latest cycle.
    cycle: Option<Cycle>,
    transmitter: Transmitter,
    receiver: Receiver,
    /// Number, carrier and bandwidth of its band; empty if not reported.
    band: [String; 3],
    /// Time of the command to restart.
    reset_s: Option<f64>,
    unknown_sentences: SentenceCounts,
}

impl Micromodem {
    /// Absorbs a sentence. The time is by the host's clock, in seconds.
    pub(crate) fn absorb(&mut self, time_s: f64, sentence: &Sentence, mut sink: Sink) {
        self.receiver.finish_stale(time_s, &mut sink);
        self.has_sentences = true;
        // A host with a modem records receptions and transmissions, so both records exist even if they are empty.
        sink.recording.arrivals.get_or_insert_default();
        sink.recording.transmissions.get_or_insert_default();
        match sentence.name {
            "CARXD" | "CARXA" | "CAMSG" | "CACST" | "CAMUA" | "CARDP" | "CARFP" => {
                if requests_reply(sentence, &sink) {
                    self.transmitter.expect_reply(time_s);
                }
                self.receiver.absorb(time_s, sentence, self.cycle.as_ref(), &mut sink);
            }
            "CACYC" | "CCCYC" => self.absorb_cycle(time_s, sentence, &mut sink),
            "CAREV" | "CACFG" | "CACLK" | "CATMS" | "CATMG" | "CAMSC" | "CCMSC" => {
                self.absorb_status(time_s, sentence, &mut sink)
            }
            "CAMPC" | "CAMPA" | "CACMD" | "CACMA" | "CAPDT" | "CAPNT" | "CAPGT" => {
                self.transmitter.cancel_reply();
                sink.recording.deaf_intervals.push((time_s, time_s + RANGING_S, ExclusionReason::OtherMode));
                sink.record_activity(time_s);
            }
            "CADRQ" | "CATXP" | "CATXF" | "CAXST" | "CAERR" | "CCTXD" | "CATXD" | "CCTXA" | "CATXA" | "CCMUC"
            | "CAMUC" | "CCTDP" | "CATDP" | "CCTFP" | "CATFP" => {
                self.transmitter.absorb(time_s, sentence, self.cycle.as_ref(), &mut sink);
            }
            name if may_hold_data(name) => self.unknown_sentences.add(name, 1),
            _ => {}
        }
    }

    /// Ends the present message if it began before a time, in seconds.
    pub(crate) fn finish_before(&mut self, time_s: f64, mut sink: Sink) {
        self.receiver.finish_before(time_s, &mut sink);
    }

    /// Ends the record, and adds the counts of unusable sentences and messages to `skipped`.
    pub(crate) fn finish(&mut self, mut sink: Sink, skipped: &mut SkipCounts) {
        self.receiver.finish_incoming(&mut sink);
        skipped.unattributed += self.receiver.unattributed;
        skipped.failed_transmissions += self.transmitter.failed;
        self.unknown_sentences.iter().for_each(|(name, number)| skipped.unknown_sentences.add(name, number));
        skipped.garbled += self.receiver.garbled + self.transmitter.garbled;
    }

    /// Absorbs a report of the modem's own state.
    fn absorb_status(&mut self, time_s: f64, sentence: &Sentence, sink: &mut Sink) {
        match sentence.name {
            "CCMSC" => return,
            "CAMSC" => {
                self.reset_s = Some(time_s);
                self.transmitter.drop_outgoing();
            }
            "CAREV" if sentence.field(1) == "INIT" => {
                self.transmitter.drop_outgoing();
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
        self.receiver.start_cycle(sink);
        self.transmitter.cancel_reply();
        let cycle = Cycle::new(time_s, sentence);
        if sentence.name == "CACYC" && sink.recording.modem_ids.contains(&cycle.source) {
            sink.record_activity(time_s);
        }
        self.cycle = Some(cycle);
    }
}
