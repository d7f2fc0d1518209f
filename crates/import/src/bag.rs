//! What topics of a robot's bag tell, whatever file they stand in.

use std::collections::BTreeSet;

use pingmap_agent::MessageKind;
use serde::Deserialize;

use crate::cdr::Cdr;
use crate::columns::{TableKind, role_of};
use crate::ids::Ids;
use crate::micromodem::{Into, Micromodem, Part};
use crate::navigation::Navigation;
use crate::recording::Sent;
use crate::sentence::Sentence;
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
            _ => Self::Other,
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
}

/// What is said of a position, a reception or a transmission.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Spoken {
    #[serde(alias = "lat")]
    latitude: Option<f64>,
    #[serde(alias = "lon")]
    longitude: Option<f64>,
    #[serde(alias = "x")]
    easting: Option<f64>,
    #[serde(alias = "y")]
    northing: Option<f64>,
    depth: Option<f64>,
    #[serde(alias = "src")]
    source: Option<Id>,
    #[serde(alias = "dest", alias = "dst")]
    destination: Option<Id>,
    good: Option<bool>,
    sent: Option<bool>,
    frame: Option<u32>,
    frames: Option<u32>,
    kind: Option<String>,
}

/// An id as a number or a text.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Id {
    Number(u64),
    Text(String),
}

impl Id {
    fn text(&self) -> String {
        match self {
            Id::Number(number) => number.to_string(),
            Id::Text(text) => text.clone(),
        }
    }
}

impl Spoken {
    /// Takes in a number by the name that it has; of several of one name the first.
    pub(crate) fn number(&mut self, name: &str, number: f64) {
        let place = match role_of(TableKind::Navigation, name) {
            Some("latitude") => Some(&mut self.latitude),
            Some("longitude") => Some(&mut self.longitude),
            Some("easting") => Some(&mut self.easting),
            Some("northing") => Some(&mut self.northing),
            Some("depth") => Some(&mut self.depth),
            _ => None,
        };
        if let Some(place) = place {
            place.get_or_insert(number);
            return;
        }
        let whole = (number >= 0.0 && number.fract() == 0.0).then_some(number as u64);
        let count = whole.and_then(|whole| u32::try_from(whole).ok());
        match role_of(TableKind::Heard, name) {
            Some("source") => self.source = self.source.take().or(whole.map(Id::Number)),
            Some("destination") => self.destination = self.destination.take().or(whole.map(Id::Number)),
            Some("good") => self.good = self.good.or(Some(number != 0.0)),
            Some("frame") => self.frame = self.frame.or(count),
            Some("frames") => self.frames = self.frames.or(count),
            _ if name.eq_ignore_ascii_case("sent") => self.sent = self.sent.or(Some(number != 0.0)),
            _ => {}
        }
    }

    /// The same of a text.
    pub(crate) fn text(&mut self, name: &str, text: &str) {
        match role_of(TableKind::Heard, name) {
            Some("source") => self.source = self.source.take().or(Some(Id::Text(text.to_owned()))),
            Some("destination") => self.destination = self.destination.take().or(Some(Id::Text(text.to_owned()))),
            _ if name.eq_ignore_ascii_case("kind") => self.kind = self.kind.take().or(Some(text.to_owned())),
            _ => {}
        }
    }
}

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
        }
    }

    /// Whether a topic is read.
    pub(crate) fn asks_for(&self, name: &str) -> bool {
        name.starts_with(self.prefix)
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
            Topic::Other => Some(()),
        };
        self.garbled(is_read.is_none());
    }

    fn take_degrees(&mut self, time_s: f64, name: &str, message: &[u8]) -> Option<()> {
        let mut cdr = Cdr::of(message)?;
        cdr.header()?;
        let (status, _) = (cdr.i8()?, cdr.u16()?);
        let (latitude_deg, longitude_deg) = (cdr.f64()?, cdr.f64()?);
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
            match serde_json::from_str::<Spoken>(text) {
                Ok(spoken) => self.take_spoken(time_s, name, &spoken),
                Err(_) => self.told.skipped.garbled += 1,
            }
            return;
        }
        for line in text.lines().filter(|line| line.contains("$CA") || line.contains("$CC")) {
            let into = Into { recording: &mut self.told.recording, ids: self.ids };
            match Sentence::parse(line) {
                Some(sentence) => self.modem.take(time_s, &sentence, into),
                None => self.told.skipped.garbled += 1,
            }
        }
    }

    /// A message that cannot be read is counted.
    pub(crate) fn garbled(&mut self, is_garbled: bool) {
        self.told.skipped.garbled += usize::from(is_garbled);
    }

    /// Takes in what members of a message say by their names.
    pub(crate) fn take_spoken(&mut self, time_s: f64, name: &str, spoken: &Spoken) {
        let places = [spoken.latitude.zip(spoken.longitude), spoken.easting.zip(spoken.northing)];
        for (form, place) in places.into_iter().enumerate() {
            let is_placed = place.is_none_or(|place| self.place(time_s, (form, name), place, spoken.depth).is_some());
            self.garbled(!is_placed);
        }
        let destination = spoken.destination.as_ref().map(Id::text).unwrap_or_default();
        let is_name = |kind: &&String| !kind.is_empty() && !kind.contains(char::is_control);
        let kind = spoken.kind.as_ref().filter(is_name).map(MessageKind::new);
        let mut into = Into { recording: &mut self.told.recording, ids: self.ids };
        match (spoken.sent, &spoken.source) {
            (Some(true), _) => {
                into.sign(time_s);
                let sent = Sent { time_s, destination: self.ids.whom(&destination), frames: spoken.frames, kind };
                into.recording.sent.get_or_insert_default().push(sent);
            }
            (Some(false), _) => {
                into.recording.sent.get_or_insert_default();
                self.told.skipped.not_sent += 1;
            }
            (None, Some(source)) => {
                let frame = spoken.frame.filter(|frame| *frame > 0);
                let good = spoken.good.unwrap_or(true);
                into.arrive(time_s, (&source.text(), &destination), Part { frame, frames: spoken.frames, good, kind });
            }
            (None, None) => {}
        }
    }

    /// Everything that the bag told.
    ///
    /// # Errors
    /// Where positions stand in several topics of one kind.
    pub(crate) fn finish(mut self) -> Result<Told, String> {
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
        self.told.datum = self.navigation.datum();
        self.told.recording.fixes = self.navigation.into_fixes();
        Ok(self.told)
    }
}
