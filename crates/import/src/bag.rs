//! What topics of a robot's bag tell, whatever file they stand in.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;

use crate::arriving::Into;
use crate::cdr::Cdr;
use crate::ids::Ids;
use crate::micromodem::Micromodem;
use crate::navigation::Navigation;
use crate::recording::{Arrival, Sent};
use crate::sentence::Sentence;
use crate::spoken::Spoken;
use crate::told::Told;

/// What stands in a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Topic {
    /// `sensor_msgs/NavSatFix`.
    Degrees,
    /// `nav_msgs/Odometry`.
    Metres,
    /// `std_msgs/String`.
    Text,
    /// `std_msgs/UInt8MultiArray` or `ByteMultiArray`.
    Bytes,
    /// Objects as JSON.
    Json,
    /// Nothing of use here.
    Other,
    /// Written in a way that is not read.
    OtherEncoding,
}

impl Topic {
    /// What stands in a topic of this type, written in this way.
    pub(crate) fn of(kind: &str, encoding: &str) -> Self {
        match (encoding, kind) {
            ("json", _) => Self::Json,
            ("cdr", "sensor_msgs/msg/NavSatFix") => Self::Degrees,
            ("cdr", "nav_msgs/msg/Odometry") => Self::Metres,
            ("cdr", "std_msgs/msg/String") => Self::Text,
            ("cdr", "std_msgs/msg/UInt8MultiArray" | "std_msgs/msg/ByteMultiArray") => Self::Bytes,
            ("cdr", _) => Self::Other,
            _ => Self::OtherEncoding,
        }
    }
}

/// What a bag told so far.
pub(crate) struct Bag<'a> {
    ids: &'a Ids,
    /// What the names of topics begin with that are read.
    prefix: &'a str,
    modem: Micromodem,
    navigation: Navigation,
    told: Told,
    /// Topics of positions, in degrees and in metres.
    positions: [BTreeSet<String>; 2],
    /// Sentences of just now, when and in which topics they stood.
    latest: Vec<(f64, String, String)>,
    /// What members of messages say that was received.
    said: Vec<Arrival>,
    /// Whether a topic was asked for.
    is_asked: bool,
}

/// The same sentence in two topics within so many seconds was said once.
const ECHO_S: f64 = 2.0;

impl<'a> Bag<'a> {
    pub(crate) fn new(ids: &'a Ids, prefix: &'a str) -> Self {
        let positions = [BTreeSet::new(), BTreeSet::new()];
        Self {
            ids,
            prefix,
            modem: Micromodem::default(),
            navigation: Navigation::default(),
            told: Told::default(),
            positions,
            latest: Vec::new(),
            said: Vec::new(),
            is_asked: false,
        }
    }

    /// Whether a topic is read.
    pub(crate) fn asks_for(&mut self, name: &str) -> bool {
        let is_asked = name.starts_with(self.prefix);
        self.is_asked |= is_asked;
        is_asked
    }

    /// Takes in a message, recorded at this time.
    pub(crate) fn take(&mut self, time_s: f64, (topic, name): (Topic, &str), message: &[u8]) {
        let is_read = match topic {
            Topic::Degrees => self.take_degrees(time_s, name, message),
            Topic::Metres => self.take_metres(time_s, name, message),
            Topic::Text => Cdr::of(message).and_then(|mut cdr| cdr.text().map(|text| self.spoken(time_s, name, text))),
            Topic::Bytes => Cdr::of(message).and_then(|mut cdr| {
                let text = String::from_utf8_lossy(cdr.array()?);
                self.spoken(time_s, name, &text);
                Some(())
            }),
            Topic::Json => std::str::from_utf8(message).ok().map(|text| self.spoken(time_s, name, text)),
            Topic::OtherEncoding => {
                self.told.skipped.of_no_type += 1;
                Some(())
            }
            Topic::Other => Some(()),
        };
        self.garbled(is_read.is_none());
    }

    fn take_degrees(&mut self, time_s: f64, name: &str, message: &[u8]) -> Option<()> {
        let mut cdr = Cdr::of(message)?;
        cdr.header()?;
        let (status, _) = (cdr.i8()?, cdr.u16()?);
        let (latitude_deg, longitude_deg) = (cdr.f64()?, cdr.f64()?);
        self.told.recording.clock_set.push((time_s, status >= 0));
        if status < 0 {
            self.told.skipped.unplaced += 1;
            return Some(());
        }
        self.place(time_s, (0, name), (latitude_deg, longitude_deg), None)
    }

    fn take_metres(&mut self, time_s: f64, name: &str, message: &[u8]) -> Option<()> {
        let mut cdr = Cdr::of(message)?;
        cdr.header()?;
        cdr.bytes()?;
        let (x_m, y_m, z_m) = (cdr.f64()?, cdr.f64()?, cdr.f64()?);
        self.place(time_s, (1, name), (x_m, y_m), Some(-z_m))
    }

    /// A position in degrees (0) or metres (1); `None` where it is none.
    fn place(
        &mut self,
        time_s: f64,
        (form, name): (usize, &str),
        place: (f64, f64),
        depth_m: Option<f64>,
    ) -> Option<()> {
        if !self.positions[form].contains(name) {
            self.positions[form].insert(name.to_owned());
        }
        let is_one = if form == 0 {
            self.navigation.place_degrees(time_s, place, depth_m)
        } else {
            self.navigation.place_metres(time_s, place, depth_m)
        };
        is_one.then_some(())
    }

    /// What a text says: a modem's sentences, or JSON. Other texts are not asked.
    pub(crate) fn spoken(&mut self, time_s: f64, name: &str, text: &str) {
        if text.trim_start().starts_with('{') {
            match Spoken::of_json(text) {
                Some(spoken) => self.take_spoken(time_s, name, &spoken),
                None => self.told.skipped.garbled += 1,
            }
            return;
        }
        for line in text.lines().filter(|line| line.contains("$CA") || line.contains("$CC")) {
            if self.is_echo(time_s, name, line) {
                continue;
            }
            let into = Into { recording: &mut self.told.recording, ids: self.ids };
            match Sentence::parse(line) {
                Some(sentence) => self.modem.take(time_s, &sentence, into),
                None => self.told.skipped.garbled += 1,
            }
        }
    }

    /// Whether a sentence stood in another topic just now.
    fn is_echo(&mut self, time_s: f64, name: &str, line: &str) -> bool {
        self.latest.retain(|(then_s, ..)| (time_s - then_s).abs() <= ECHO_S);
        let same = |(_, topic, other): &(f64, String, String)| topic != name && other == line;
        if let Some(place) = self.latest.iter().position(same) {
            // Each says it once more than the other, if the modem did.
            self.latest.swap_remove(place);
            return true;
        }
        self.latest.push((time_s, name.to_owned(), line.to_owned()));
        false
    }

    /// A message that cannot be read is counted.
    pub(crate) fn garbled(&mut self, is_garbled: bool) {
        self.told.skipped.garbled += usize::from(is_garbled);
    }

    /// Takes in what members of a message say by their names.
    pub(crate) fn take_spoken(&mut self, time_s: f64, name: &str, spoken: &Spoken) {
        if spoken.is_unclear {
            self.garbled(true);
            return;
        }
        self.take_place(time_s, name, spoken);
        let destination = self.ids.whom(spoken.destination.as_deref().unwrap_or_default());
        let is_name = |kind: &&String| !kind.is_empty() && !kind.contains(char::is_control);
        let kind = spoken.kind.as_ref().filter(is_name).map(MessageKind::new);
        let frames = spoken.frames;
        match (spoken.sent, &spoken.source, spoken.received_frame()) {
            (Some(true), ..) => {
                Into { recording: &mut self.told.recording, ids: self.ids }.sign(time_s);
                let sent = Sent { time_s, destination, frames, kind, band: None };
                self.told.recording.sent.get_or_insert_default().push(sent);
            }
            (_, Some(_), Err(())) => self.garbled(true),
            (_, Some(source), Ok(frame)) => {
                let good = spoken.good.unwrap_or(true);
                let arrival = |source| Arrival { time_s, source, destination, frame, frames, good, kind };
                self.said.extend(self.ids.whom(source).map(arrival));
            }
            (Some(false), None, _) => {
                self.told.recording.sent.get_or_insert_default();
                self.told.skipped.not_sent += 1;
            }
            (None, None, _) => {}
        }
        for text in spoken.texts.iter().filter(|text| text.contains('$')) {
            self.spoken(time_s, name, text);
        }
    }

    fn take_place(&mut self, time_s: f64, name: &str, spoken: &Spoken) {
        let places = [spoken.latitude.zip(spoken.longitude), spoken.easting.zip(spoken.northing)];
        if spoken.without_fix && places[0].is_some() {
            self.told.skipped.unplaced += 1;
            return;
        }
        for (form, place) in places.into_iter().enumerate() {
            let is_placed = place.is_none_or(|place| self.place(time_s, (form, name), place, spoken.depth).is_some());
            self.garbled(!is_placed);
        }
    }

    /// Everything that the bag told.
    ///
    /// # Errors
    /// Where positions stand in several topics of one kind, several modems speak, or no topic is called as was asked.
    pub(crate) fn finish(mut self) -> Result<Told, String> {
        if !self.is_asked && !self.prefix.is_empty() {
            return Err(format!("no topic (or channel) has a name that begins with {}", self.prefix));
        }
        self.modem.finish(Into { recording: &mut self.told.recording, ids: self.ids }, &mut self.told.skipped);
        for topics in &self.positions {
            if topics.len() > 1 {
                let names: Vec<&str> = topics.iter().map(String::as_str).collect();
                return Err(format!(
                    "positions stand in {}; expected one: NAME=FILE#TOPIC takes topics (or channels) whose names begin so",
                    names.join(" and ")
                ));
            }
        }
        let ids: Vec<&str> = self.told.recording.modem_ids.iter().map(String::as_str).collect();
        if ids.len() > 1 {
            return Err(format!(
                "modems {} speak in it; expected one: NAME=FILE#TOPIC takes topics (or channels) whose names begin so",
                ids.join(" and ")
            ));
        }
        self.told.recording.said.extend((!self.said.is_empty()).then_some(self.said));
        self.told.datum = self.navigation.datum();
        self.told.recording.fixes = self.navigation.into_fixes();
        Ok(self.told)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FROM_2: &str = "$CARXD,2,1,0,1,AABB";
    const FROM_3: &str = "$CARXD,3,1,0,1,CCDD";

    /// What texts say, each at its time and in its topic.
    fn told(prefix: &str, texts: &[(f64, &str, &str)]) -> Result<Told, String> {
        let ids = Ids::default();
        let mut bag = Bag::new(&ids, prefix);
        for (time_s, topic, text) in texts {
            if bag.asks_for(topic) {
                bag.spoken(*time_s, topic, text);
            }
        }
        bag.finish()
    }

    fn arrivals(texts: &[(f64, &str, &str)]) -> usize {
        told("", texts).unwrap().recording.arrivals.unwrap_or_default().len()
    }

    #[test]
    fn what_two_topics_repeat_was_said_once() {
        let twice = [(10.0, "/rx", FROM_2), (10.1, "/log", FROM_2)];
        assert_eq!((arrivals(&twice[..1]), arrivals(&twice)), (1, 1));
        // Said anew: in one topic, by another sender, later.
        assert_eq!(arrivals(&[(10.0, "/rx", FROM_2), (11.0, "/rx", FROM_2)]), 2);
        assert_eq!(arrivals(&[(10.0, "/rx", FROM_2), (10.1, "/log", FROM_3)]), 2);
        assert_eq!(arrivals(&[(10.0, "/rx", FROM_2), (13.0, "/log", FROM_2)]), 2);
        // Twice by the modem, and each time repeated.
        let both = [(10.0, "/rx", FROM_2), (11.0, "/rx", FROM_2), (10.1, "/log", FROM_2), (11.1, "/log", FROM_2)];
        assert_eq!(arrivals(&both), 2);
    }

    #[test]
    fn a_bag_of_several_modems_or_without_the_topic_is_refused() {
        let ids = [(1.0, "/a/rx", "$CACFG,SRC,1"), (1.0, "/b/rx", "$CACFG,SRC,2")];
        let error = told("", &ids).err().unwrap();
        assert!(error.contains("modems 1 and 2") && error.contains("NAME=FILE#TOPIC"), "{error}");
        assert_eq!(told("/b/", &ids).unwrap().recording.modem_ids, ["2".to_owned()].into());
        assert!(told("/c/", &ids).err().unwrap().contains("begins with /c/"));
    }

    #[test]
    fn members_say_what_was_received_sent_and_where() {
        let said = told(
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
        let sent = said.recording.sent.unwrap();
        assert_eq!((sent.len(), sent[0].destination.as_ref().map(|to| to.as_str())), (1, Some("auv2")));
        assert_eq!((said.recording.said.concat().len(), said.recording.fixes.len(), said.skipped.garbled), (1, 1, 1));
    }
}
