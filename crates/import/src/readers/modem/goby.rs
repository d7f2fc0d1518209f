//! Transmissions in the text format of Goby's protocol buffers (`goby.acomms.protobuf.ModemTransmission`).

use pingmap_agent::MessageKind;

use crate::model::exclusion::ExclusionReason;
use crate::model::recording::{Reply, TransmissionRecord};
use crate::readers::sink::{FrameInfo, Sink};

/// A transmission, with the fields that matter here.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct ModemTransmission {
    source: Option<String>,
    destination: Option<String>,
    rate: Option<String>,
    kind: Option<String>,
    frames: u32,
    bad_frames: u32,
}

/// A modem that ranges is deaf for so long, in seconds.
const RANGING_S: f64 = 5.0;

/// Duration of an acknowledgement, in seconds.
const REPLY_S: f64 = 3.0;

/// Goby's broadcast address.
const BROADCAST: &str = "0";

impl ModemTransmission {
    /// Parses `src: 1 dest: 0 type: DATA rate: 0 frame: "…"`, and ignores all other fields.
    pub(crate) fn parse(text: &str) -> Self {
        let mut transmission = Self::default();
        for (depth, key, value) in Fields::new(text) {
            match key {
                "src" if depth == 0 => transmission.source = Some(value.to_owned()),
                "dest" if depth == 0 => transmission.destination = Some(value.to_owned()),
                "rate" if depth == 0 => transmission.rate = Some(value.to_owned()),
                "type" if depth == 0 => transmission.kind = Some(value.to_owned()),
                "frame" if depth == 0 => transmission.frames += 1,
                key if key.trim_end_matches(']').ends_with("frame_with_bad_crc") => transmission.bad_frames += 1,
                _ => {}
            }
        }
        transmission
    }

    fn is_message(&self) -> bool {
        !self.has_no_data() && self.frames > 0
    }

    /// Returns whether the transmission is of a type without data.
    fn has_no_data(&self) -> bool {
        !matches!(self.kind.as_deref(), None | Some("DATA" | "MICROMODEM_MINI_DATA" | "DRIVER_SPECIFIC"))
    }

    fn message_kind(&self) -> Option<MessageKind> {
        let rate = self.rate.as_deref().filter(|rate| rate.parse::<u32>().is_ok())?;
        Some(MessageKind::new(format!("rate {rate}")))
    }

    /// Records the reception of this transmission.
    pub(crate) fn record_reception(&self, time_s: f64, sink: &mut Sink) {
        let Some(source) = self.source.as_deref().filter(|_| self.is_message()) else { return };
        let destination = self.destination.as_deref().filter(|destination| *destination != BROADCAST).unwrap_or("");
        let (frames, good) = (Some(self.frames), self.bad_frames < self.frames);
        // The text states the number of bad frames, but not their indices.
        for frame in 1..=self.frames.saturating_sub(self.bad_frames).max(1) {
            let part = FrameInfo { frame: Some(frame), frames, good, kind: self.message_kind() };
            sink.add_arrival(time_s, (source, destination), part);
        }
    }

    /// Records that this transmission was sent.
    pub(crate) fn record_transmission(&self, time_s: f64, sink: &mut Sink) {
        if self.kind.as_deref() == Some("ACK") {
            // It exists only because a message was decoded, so it does not extend the activity of the modem.
            sink.recording.replies.push(Reply { decoded_s: time_s, start_s: time_s, end_s: time_s + REPLY_S });
        } else if self.has_no_data() {
            // Ranging: the modem is deaf meanwhile.
            sink.record_activity(time_s);
            sink.recording.deaf_intervals.push((time_s, time_s + RANGING_S, ExclusionReason::OtherMode));
        }
        let Some(source) = self.source.as_deref().filter(|_| self.is_message()) else { return };
        sink.add_modem_id(source);
        sink.record_activity(time_s);
        let destination = self.destination.as_deref().filter(|destination| *destination != BROADCAST).unwrap_or("");
        let record = TransmissionRecord {
            time_s,
            destination: sink.ids.resolve(destination),
            frames: Some(self.frames),
            kind: self.message_kind(),
            band: None,
        };
        sink.recording.transmissions.get_or_insert_default().push(record);
    }
}

/// Iterates over the fields of a text, each with its depth of nesting.
struct Fields<'a> {
    rest: &'a str,
    depth: usize,
}

impl<'a> Fields<'a> {
    fn new(text: &'a str) -> Self {
        // A prefix may state the type: `@PB[goby.acomms.protobuf.ModemTransmission]`.
        let text = text.trim_start();
        let rest = match text.strip_prefix("@PB[") {
            Some(rest) => rest.split_once(']').map_or("", |(_, rest)| rest),
            None => text,
        };
        Self { rest, depth: 0 }
    }

    /// Consumes a quoted text up to its end. The opening quotation mark is already consumed.
    fn quoted(&mut self, mark: char) -> &'a str {
        let mut escaped = false;
        let end = self.rest.char_indices().find(|&(_, c)| {
            let ends = c == mark && !escaped;
            escaped = c == '\\' && !escaped;
            ends
        });
        let (text, rest) = match end {
            Some((end, _)) => (&self.rest[..end], &self.rest[end + 1..]),
            None => (self.rest, ""),
        };
        self.rest = rest;
        text
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = (usize, &'a str, &'a str);

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            self.rest = self.rest.trim_start_matches(|c: char| c.is_whitespace() || matches!(c, ',' | ';'));
            let first = self.rest.chars().next()?;
            if first == '}' {
                (self.depth, self.rest) = (self.depth.saturating_sub(1), &self.rest[1..]);
                continue;
            }
            let end = self.rest.find(|c: char| c.is_whitespace() || matches!(c, ':' | '{' | '}' | '"'));
            let (key, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
            self.rest = rest.trim_start().strip_prefix(':').unwrap_or(rest).trim_start();
            match self.rest.chars().next() {
                Some('{') => (self.depth, self.rest) = (self.depth + 1, &self.rest[1..]),
                Some(mark @ ('"' | '\'')) => {
                    self.rest = &self.rest[1..];
                    let depth = self.depth;
                    return Some((depth, key, self.quoted(mark)));
                }
                Some(_) if !key.is_empty() => {
                    let end = self.rest.find(|c: char| c.is_whitespace() || c == '}').unwrap_or(self.rest.len());
                    let (value, rest) = self.rest.split_at(end);
                    self.rest = rest;
                    return Some((self.depth, key, value));
                }
                // Skips an unexpected character.
                Some(character) => self.rest = &self.rest[character.len_utf8()..],
                None => return None,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmissions_with_any_content_of_frames_are_parsed() {
        let text = r#"@PB[goby.acomms.protobuf.ModemTransmission] src: 2 dest: 0 rate: 1 type: DATA time: 1.7778096e+15 frame: "\001 src: 9 \"{" frame: "" [micromodem.protobuf.frame_with_bad_crc]: 1 [micromodem.protobuf.receive_stat] { mode: RECEIVE_BAD src: 7 }"#;
        let expected = ModemTransmission {
            source: Some("2".into()),
            destination: Some("0".into()),
            rate: Some("1".into()),
            kind: Some("DATA".into()),
            frames: 2,
            bad_frames: 1,
        };
        assert_eq!(ModemTransmission::parse(text), expected);
        let nested = r#"src:3 dest:1 frame:"a" [goby.acomms.micromodem.protobuf.transmission] { frame_with_bad_crc: 0 } type: ACK"#;
        let transmission = ModemTransmission::parse(nested);
        assert_eq!(
            (transmission.source.as_deref(), transmission.bad_frames, transmission.is_message()),
            (Some("3"), 1, false)
        );
        for text in ["", "{", "}}}", "src", "src:", "src: }", "\"", ":::", "@PB[", "src: \"\\", "a { b { c: 1", "é: ü"]
        {
            let _ = ModemTransmission::parse(text);
        }
    }
}
