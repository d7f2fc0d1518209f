//! Parser of the topics in a bag, independent of the container format.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;

use crate::model::modem_ids::ModemIds;
use crate::model::parsed_file::ParsedFile;
use crate::model::recording::{Arrival, TransmissionRecord};
use crate::readers::bags::cdr::CdrReader;
use crate::readers::bags::encoding::{TopicFormat, decompress};
use crate::readers::bags::lost_spans::LostSpans;
use crate::readers::message_fields::MessageFields;
use crate::readers::modem::micromodem::Micromodem;
use crate::readers::modem::nmea::Sentence;
use crate::readers::navigation::Navigation;
use crate::readers::sink::Sink;

/// The state of a bag that is being read.
pub(crate) struct BagParser<'a> {
    ids: &'a ModemIds,
    /// Prefix of the topics to read.
    prefix: &'a str,
    modem: Micromodem,
    navigation: Navigation,
    parsed: ParsedFile,
    /// Names of topics with positions: in degrees, and in metres.
    positions: [BTreeSet<String>; 2],
    /// Recent sentences with their time and topic, to detect echoes.
    recent_lines: Vec<(f64, String, String)>,
    /// Possible receptions in messages with named members.
    reported: Vec<Arrival>,
    /// Time spans in which records were lost.
    pub(crate) lost: LostSpans,
    /// Whether any topic has the prefix.
    is_any_selected: bool,
}

/// Largest time between a sentence and its echo in another topic, in seconds.
const ECHO_S: f64 = 2.0;

impl<'a> BagParser<'a> {
    pub(crate) fn new(ids: &'a ModemIds, prefix: &'a str) -> Self {
        let positions = [BTreeSet::new(), BTreeSet::new()];
        Self {
            ids,
            prefix,
            modem: Micromodem::default(),
            navigation: Navigation::default(),
            parsed: ParsedFile::default(),
            positions,
            recent_lines: Vec::new(),
            reported: Vec::new(),
            lost: LostSpans::default(),
            is_any_selected: false,
        }
    }

    /// Returns whether a topic is to be read.
    pub(crate) fn selects(&mut self, name: &str) -> bool {
        let is_selected = name.starts_with(self.prefix);
        self.is_any_selected |= is_selected;
        is_selected
    }

    /// Absorbs a message with the time of its record, in seconds. The message may be compressed with Zstandard.
    pub(crate) fn absorb(&mut self, time_s: f64, (topic, name): (TopicFormat, &str), message: &[u8]) {
        let Some(message) = decompress(message) else {
            self.count_garbled(true);
            return;
        };
        let message = message.as_ref();
        let is_read = match topic {
            TopicFormat::NavSatFix => self.absorb_nav_sat_fix(time_s, name, message),
            TopicFormat::Odometry => self.absorb_odometry(time_s, name, message),
            TopicFormat::Text => {
                CdrReader::new(message).and_then(|mut cdr| cdr.text().map(|text| self.read_text(time_s, name, text)))
            }
            TopicFormat::Bytes => CdrReader::new(message).and_then(|mut cdr| {
                let text = String::from_utf8_lossy(cdr.array()?);
                self.read_text(time_s, name, &text);
                Some(())
            }),
            TopicFormat::Json => std::str::from_utf8(message).ok().map(|text| self.read_text(time_s, name, text)),
            TopicFormat::OtherEncoding => {
                self.parsed.skipped.unknown_type += 1;
                Some(())
            }
            TopicFormat::Other => Some(()),
        };
        self.count_garbled(is_read.is_none());
    }

    fn absorb_nav_sat_fix(&mut self, time_s: f64, name: &str, message: &[u8]) -> Option<()> {
        let mut cdr = CdrReader::new(message)?;
        cdr.header()?;
        let (status, _) = (cdr.i8()?, cdr.u16()?);
        let (latitude_deg, longitude_deg) = (cdr.f64()?, cdr.f64()?);
        self.parsed.recording.clock_syncs.push((time_s, status >= 0));
        if status < 0 {
            self.parsed.skipped.missing_positions += 1;
            return Some(());
        }
        self.add_position(time_s, (0, name), (latitude_deg, longitude_deg), None)
    }

    fn absorb_odometry(&mut self, time_s: f64, name: &str, message: &[u8]) -> Option<()> {
        let mut cdr = CdrReader::new(message)?;
        cdr.header()?;
        cdr.bytes()?;
        let (x_m, y_m, z_m) = (cdr.f64()?, cdr.f64()?, cdr.f64()?);
        self.add_position(time_s, (1, name), (x_m, y_m), Some(-z_m))
    }

    /// Adds a position in degrees (form 0) or metres (form 1). Returns `None` if it is invalid.
    fn add_position(
        &mut self,
        time_s: f64,
        (form, name): (usize, &str),
        place: (f64, f64),
        depth_m: Option<f64>,
    ) -> Option<()> {
        if !self.positions[form].contains(name) {
            self.positions[form].insert(name.to_owned());
        }
        let is_valid = if form == 0 {
            self.navigation.add_degrees(time_s, place, depth_m)
        } else {
            self.navigation.add_metres(time_s, place, depth_m)
        };
        is_valid.then_some(())
    }

    /// Absorbs a text: JSON, or modem sentences. Other text is ignored.
    pub(crate) fn read_text(&mut self, time_s: f64, name: &str, text: &str) {
        if text.trim_start().starts_with('{') {
            match MessageFields::from_json(text) {
                Some(fields) => self.absorb_fields(time_s, name, &fields),
                None => self.parsed.skipped.garbled += 1,
            }
            return;
        }
        for line in text.lines().filter(|line| line.contains("$CA") || line.contains("$CC")) {
            if self.is_echo(time_s, name, line) {
                continue;
            }
            let sink = Sink { recording: &mut self.parsed.recording, ids: self.ids };
            match Sentence::parse(line) {
                Some(sentence) => self.modem.absorb(time_s, &sentence, sink),
                None => self.parsed.skipped.garbled += 1,
            }
        }
    }

    /// Returns whether another topic held the same sentence recently.
    fn is_echo(&mut self, time_s: f64, name: &str, line: &str) -> bool {
        self.recent_lines.retain(|(earlier_s, ..)| (time_s - earlier_s).abs() <= ECHO_S);
        let is_same = |(_, topic, other): &(f64, String, String)| topic != name && other == line;
        if let Some(index) = self.recent_lines.iter().position(is_same) {
            // An echo cancels one occurrence only, so a sentence that the modem repeats is kept.
            self.recent_lines.swap_remove(index);
            return true;
        }
        self.recent_lines.push((time_s, name.to_owned(), line.to_owned()));
        false
    }

    /// Counts a message that cannot be parsed.
    pub(crate) fn count_garbled(&mut self, is_garbled: bool) {
        self.parsed.skipped.garbled += usize::from(is_garbled);
    }

    /// Absorbs the named fields of a message.
    pub(crate) fn absorb_fields(&mut self, time_s: f64, name: &str, fields: &MessageFields) {
        if fields.is_ambiguous {
            self.count_garbled(true);
            return;
        }
        self.absorb_position(time_s, name, fields);
        let destination = self.ids.resolve(fields.destination.as_deref().unwrap_or_default());
        let is_printable = |kind: &&String| !kind.is_empty() && !kind.contains(char::is_control);
        let kind = fields.kind.as_ref().filter(is_printable).map(MessageKind::new);
        let frames = fields.frames;
        match (fields.sent, &fields.source, fields.received_frame()) {
            (Some(true), ..) => {
                Sink { recording: &mut self.parsed.recording, ids: self.ids }.record_activity(time_s);
                let record = TransmissionRecord { time_s, destination, frames, kind, band: None };
                self.parsed.recording.transmissions.get_or_insert_default().push(record);
            }
            (_, Some(_), Err(())) => self.count_garbled(true),
            (_, Some(source), Ok(frame)) => {
                let good = fields.good.unwrap_or(true);
                let arrival = |source| Arrival { time_s, source, destination, frame, frames, good, kind };
                self.reported.extend(self.ids.resolve(source).map(arrival));
            }
            (Some(false), None, _) => {
                self.parsed.recording.transmissions.get_or_insert_default();
                self.parsed.skipped.failed_transmissions += 1;
            }
            (None, None, _) => {}
        }
        for text in fields.texts.iter().filter(|text| text.contains('$')) {
            self.read_text(time_s, name, text);
        }
    }

    fn absorb_position(&mut self, time_s: f64, name: &str, fields: &MessageFields) {
        let places = [fields.latitude.zip(fields.longitude), fields.easting.zip(fields.northing)];
        if fields.has_no_fix && places[0].is_some() {
            self.parsed.skipped.missing_positions += 1;
            return;
        }
        for (form, place) in places.into_iter().enumerate() {
            let is_placed =
                place.is_none_or(|place| self.add_position(time_s, (form, name), place, fields.depth).is_some());
            self.count_garbled(!is_placed);
        }
    }

    /// Ends the bag.
    ///
    /// # Errors
    /// If positions of one form occur in several topics, several modems occur, or no topic has the prefix.
    pub(crate) fn finish(mut self) -> Result<ParsedFile, String> {
        if !self.is_any_selected && !self.prefix.is_empty() {
            return Err(format!("no topic (or channel) has a name that begins with {}", self.prefix));
        }
        self.modem.finish(Sink { recording: &mut self.parsed.recording, ids: self.ids }, &mut self.parsed.skipped);
        for topics in &self.positions {
            if topics.len() > 1 {
                let names: Vec<&str> = topics.iter().map(String::as_str).collect();
                return Err(format!(
                    "positions occur in {}; expected one topic (or channel): NAME=FILE#TOPIC selects those whose names begin with TOPIC",
                    names.join(" and ")
                ));
            }
        }
        let ids: Vec<&str> = self.parsed.recording.modem_ids.iter().map(String::as_str).collect();
        if ids.len() > 1 {
            return Err(format!(
                "modems {} occur in it; expected one: NAME=FILE#TOPIC selects topics (or channels) whose names begin with TOPIC",
                ids.join(" and ")
            ));
        }
        self.parsed.recording.reported.extend((!self.reported.is_empty()).then_some(self.reported));
        self.parsed.recording.lost_spans = self.lost.into_spans();
        self.parsed.datum = self.navigation.datum();
        self.parsed.skipped.missing_positions += self.navigation.missing;
        self.parsed.recording.fixes = self.navigation.into_fixes();
        Ok(self.parsed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FROM_2: &str = "$CARXD,2,1,0,1,AABB";
    const FROM_3: &str = "$CARXD,3,1,0,1,CCDD";

    /// Parses texts, each with its time and topic.
    fn parsed(prefix: &str, texts: &[(f64, &str, &str)]) -> Result<ParsedFile, String> {
        let ids = ModemIds::default();
        let mut bag = BagParser::new(&ids, prefix);
        for (time_s, topic, text) in texts {
            if bag.selects(topic) {
                bag.read_text(*time_s, topic, text);
            }
        }
        bag.finish()
    }

    fn arrivals(texts: &[(f64, &str, &str)]) -> usize {
        parsed("", texts).unwrap().recording.arrivals.unwrap_or_default().len()
    }

    #[test]
    fn a_sentence_that_two_topics_repeat_counts_once() {
        let echoed = [(10.0, "/rx", FROM_2), (10.1, "/log", FROM_2)];
        assert_eq!((arrivals(&echoed[..1]), arrivals(&echoed)), (1, 1));
        // No echoes: the same topic, another sender, a later time.
        assert_eq!(arrivals(&[(10.0, "/rx", FROM_2), (11.0, "/rx", FROM_2)]), 2);
        assert_eq!(arrivals(&[(10.0, "/rx", FROM_2), (10.1, "/log", FROM_3)]), 2);
        assert_eq!(arrivals(&[(10.0, "/rx", FROM_2), (13.0, "/log", FROM_2)]), 2);
        // The modem repeats a sentence, and another topic echoes both.
        let repeated = [(10.0, "/rx", FROM_2), (11.0, "/rx", FROM_2), (10.1, "/log", FROM_2), (11.1, "/log", FROM_2)];
        assert_eq!(arrivals(&repeated), 2);
    }

    #[test]
    fn a_bag_with_several_modems_or_without_the_topic_is_refused() {
        let ids = [(1.0, "/a/rx", "$CACFG,SRC,1"), (1.0, "/b/rx", "$CACFG,SRC,2")];
        let error = parsed("", &ids).err().unwrap();
        assert!(error.contains("modems 1 and 2") && error.contains("NAME=FILE#TOPIC"), "{error}");
        assert_eq!(parsed("/b/", &ids).unwrap().recording.modem_ids, ["2".to_owned()].into());
        assert!(parsed("/c/", &ids).err().unwrap().contains("begins with /c/"));
    }

    #[test]
    fn members_yield_receptions_transmissions_and_positions() {
        let reported = parsed(
            "",
            &[
                (1.0, "/m", r#"{"source":2,"dst":63}"#),
                (2.0, "/m", r#"{"sent":true,"to":"auv2"}"#),
                (3.0, "/m", r#"{"source":2,"frame":0,"frames":2}"#),
                (4.0, "/m", r#"{"lat":41.5,"lon":-70.6}"#),
                (5.0, "/m", r#"{"sent":7}"#),
            ],
        )
        .unwrap();
        let transmissions = reported.recording.transmissions.unwrap();
        assert_eq!(
            (transmissions.len(), transmissions[0].destination.as_ref().map(|destination| destination.as_str())),
            (1, Some("auv2"))
        );
        assert_eq!(
            (reported.recording.reported.concat().len(), reported.recording.fixes.len(), reported.skipped.garbled),
            (1, 1, 1)
        );
    }
}
