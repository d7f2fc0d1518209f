//! Flexible packets of the Micro-Modem 2.

use pingmap_agent::MessageKind;

use crate::readers::modem::cycle::{mini_kind, rate_kind};
use crate::readers::modem::nmea::Sentence;

/// Largest number of frames that are read from one packet. A packet has about 100 bytes.
const FRAMES_MAX: usize = 256;

/// A flexible packet in a sentence of the host or the modem.
#[derive(Debug, PartialEq)]
pub(super) struct FlexiblePacket<'a> {
    /// Sender of a received packet.
    pub(super) source: &'a str,
    pub(super) destination: &'a str,
    pub(super) kind: Option<MessageKind>,
    pub(super) requests_reply: bool,
    /// Whether each frame of the user is good. The modem's own frames are left out.
    pub(super) frames: Vec<bool>,
}

impl<'a> FlexiblePacket<'a> {
    /// Parses `CCTDP`, `CATDP`, `CARDP`, `CCTFP`, `CATFP` or `CARFP`. Returns `None` if fields are missing.
    ///
    /// The sentences that end in `FP` hold mini frames and data frames, each with a rate. Firmware from 2.1.9 on puts
    /// two fields before the destination of `CCTFP` and `CATFP`. A frame is a flag (1 for good), its length and its
    /// bytes.
    pub(super) fn parse(sentence: &Sentence<'a>) -> Option<Self> {
        let field = |index: usize| sentence.field(index);
        let start = if sentence.fields.len() >= 9 { 2 } else { 0 };
        // Indices of the destination and of the frames.
        let (destination, frames) = match sentence.name {
            "CCTDP" => (0, 4),
            "CATDP" => (2, 6),
            "CARDP" => (1, 5),
            "CCTFP" | "CATFP" => (start, start + 6),
            _ => (3, 10),
        };
        if sentence.fields.len() <= frames || field(destination).is_empty() {
            return None;
        }
        let is_received = sentence.name.starts_with("CAR");
        let source = if is_received { field(destination - 1) } else { "" };
        if sentence.name.ends_with("DP") {
            let requests_reply = is_set(field(destination + 2));
            let kind = rate_kind(field(destination + 1));
            let frames = if is_received { frame_flags(field(frames)) } else { vec![true] };
            return Some(Self { source, destination: field(destination), kind, requests_reply, frames });
        }
        let (mini_frames, data_frames) = match sentence.name {
            // The host gives bytes without their division into frames.
            "CCTFP" => (whole(field(frames - 1)), whole(field(frames))),
            _ => (frame_flags(field(frames - 1)), frame_flags(field(frames))),
        };
        let kind = if data_frames.is_empty() { mini_kind() } else { rate_kind(field(destination + 2)) };
        let requests_reply = is_set(field(destination + 3));
        let frames = [mini_frames, data_frames].concat();
        Some(Self { source, destination: field(destination), kind, requests_reply, frames })
    }
}

/// Returns whether a flag of a sentence is set.
pub(super) fn is_set(flag: &str) -> bool {
    !matches!(flag, "" | "0")
}

/// Returns one good frame for bytes, and none for an empty field.
fn whole(bytes: &str) -> Vec<bool> {
    if bytes.is_empty() { Vec::new() } else { vec![true] }
}

/// Returns whether each frame in a list of triples is good.
fn frame_flags(frames: &str) -> Vec<bool> {
    let flags = frames.split(';').step_by(3).filter(|flag| !flag.is_empty());
    flags.take(FRAMES_MAX).map(|flag| flag == "1").collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_all_sentences_are_parsed() {
        for (text, source, destination, kind, requests_reply, frames) in [
            ("$CCTDP,3,5,0,0,AABB", "", "3", "rate 5", false, &[true][..]),
            ("$CATDP,0,7,3,5,1,0,2", "", "3", "rate 5", true, &[true]),
            ("$CARDP,2,3,5,0,0,1;2;AABB;0;2;CCDD", "2", "3", "rate 5", false, &[true, false]),
            ("$CCTFP,0,0,127,1,5,0,0,,00FF00FF", "", "127", "rate 5", false, &[true]),
            ("$CCTFP,127,1,5,1,0,01,00FF", "", "127", "rate 5", true, &[true, true]),
            ("$CCTFP,0,0,127,1,5,0,0,01,", "", "127", "mini", false, &[true]),
            ("$CATFP,0,0,127,1,5,0,0,,1;4;", "", "127", "rate 5", false, &[true]),
            (
                "$CARFP,2026-05-03T12:00:00.5,0,2,127,1,5,1,0,1;6;08ff,0;1;AA,1;4;00FF",
                "2",
                "127",
                "rate 5",
                true,
                &[false, true],
            ),
            ("$CARFP,2026-05-03T12:00:00.5,0,2,3,1,-1,0,0,1;5;0801,1;3;ac4131,,", "2", "3", "mini", false, &[true]),
            // The modem's own frame alone, such as that of a ping, has no data of the user.
            ("$CARFP,2026-05-03T12:00:00.5,0,1,0,1,-1,0,0,1;6;0801000700ff,,", "1", "0", "mini", false, &[]),
        ] {
            let packet = FlexiblePacket::parse(&Sentence::parse(text).unwrap()).unwrap();
            let expected = FlexiblePacket {
                source,
                destination,
                kind: Some(MessageKind::new(kind)),
                requests_reply,
                frames: frames.to_vec(),
            };
            assert_eq!(packet, expected, "{text}");
        }
        for text in
            ["$CARFP,1,0,2,127,1,5,0,0,1;6;08", "$CCTFP,127,1,5", "$CATFP", "$CARDP,2,3", "$CARDP,2,,5,0,0,1;2;A"]
        {
            assert_eq!(FlexiblePacket::parse(&Sentence::parse(text).unwrap()), None, "{text}");
        }
    }
}
