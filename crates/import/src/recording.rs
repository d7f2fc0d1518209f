//! What one vehicle recorded, on its own clock.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::{MessageKind, VehicleId};

use crate::reference::Place;

/// What every vehicle recorded.
pub type Recordings = BTreeMap<VehicleId, Recording>;

/// What one vehicle recorded, in any order. All times are of its own clock, in seconds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Where it was.
    pub fixes: Vec<Fix>,
    /// Where it stays, if it does not move.
    pub fixed: Option<Fix>,
    /// What it sent, by its own word; `None` where there is no record of that.
    pub sent: Option<Vec<Sent>>,
    /// What reached it; `None` where there is no record of that: such a vehicle is no receiver.
    pub arrivals: Option<Vec<Arrival>>,
    /// What members of messages say that reached it, of each record: [`crate::resolve`] takes it for such where somebody recorded is
    /// its source.
    pub said: Vec<Vec<Arrival>>,
    /// From the first to the last sign of its modem, of each record.
    pub signs: Vec<(f64, f64)>,
    /// What its modem is called by others, by its own word.
    pub modem_ids: BTreeSet<String>,
    /// From when to when its modem is said to have been listening.
    pub listening: Vec<(f64, f64)>,
    /// From when to when it could not hear, and why.
    pub deaf: Vec<(f64, f64, Unknown)>,
    /// From when on its modem worked in which band, by its own word.
    pub bands: Vec<(f64, String)>,
    /// When its clock was set by satellites, and when it was not.
    pub clock_set: Vec<(f64, bool)>,
}

/// A place at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// When.
    pub time_s: f64,
    /// Where.
    pub place: Place,
    /// How deep, where that was recorded.
    pub depth_m: Option<f64>,
}

/// A transmission that its sender knows to have been sent.
#[derive(Debug, Clone, PartialEq)]
pub struct Sent {
    /// When it began.
    pub time_s: f64,
    /// To whom; `None` for everybody.
    pub destination: Option<VehicleId>,
    /// In how many frames, where that was recorded.
    pub frames: Option<u32>,
    /// What kind of message, where that was recorded.
    pub kind: Option<MessageKind>,
    /// In which band, where that was recorded; else in that in which its modem worked.
    pub band: Option<String>,
}

/// A message, or a frame of one, that reached a modem.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrival {
    /// When it was recorded.
    pub time_s: f64,
    /// Who sent it.
    pub source: VehicleId,
    /// To whom; `None` for everybody.
    pub destination: Option<VehicleId>,
    /// Which frame, from 1.
    pub frame: Option<u32>,
    /// Of how many.
    pub frames: Option<u32>,
    /// Whether it was decoded.
    pub good: bool,
    /// What kind of message, where that was recorded.
    pub kind: Option<MessageKind>,
}

/// What stands between the parts of a band: number, carrier, bandwidth. A part that is not known is empty.
pub(crate) const BAND_PARTS: &str = "\u{1f}";

/// Whether two bands are known to differ.
pub(crate) fn bands_differ(a: &str, b: &str) -> bool {
    let mut parts = a.split(BAND_PARTS).zip(b.split(BAND_PARTS));
    parts.any(|(a, b)| !a.is_empty() && !b.is_empty() && a != b)
}

/// Why nobody knows whether a transmission was missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Unknown {
    /// A schedule named it, nobody heard it, and nothing says that it was sent.
    NotKnownSent,
    /// Its sender sends to one vehicle or another, and nobody who heard it says to whom this was.
    DestinationUnknown,
    /// The receiver's modem had said nothing yet, or said nothing any more.
    NotRecording,
    /// The receiver was transmitting itself.
    Transmitting,
    /// The receiver's modem was starting.
    Rebooting,
    /// The receiver listened on another rate or band, or was ranging.
    OtherMode,
    /// How the clocks of both differ is not known.
    ClockUnsure,
    /// Where one of both was is not known.
    NoNavigation,
    /// One of both was at the surface.
    Surfaced,
}

impl Recording {
    /// Takes in another record of the same vehicle.
    pub(crate) fn append(&mut self, other: Recording) {
        let Recording { fixes, fixed, sent, arrivals, said, signs, modem_ids, listening, deaf, bands, clock_set } =
            other;
        self.fixes.extend(fixes);
        self.fixed = fixed.or(self.fixed);
        if let Some(sent) = sent {
            self.sent.get_or_insert_default().extend(sent);
        }
        if let Some(arrivals) = arrivals {
            self.arrivals.get_or_insert_default().extend(arrivals);
        }
        self.said.extend(said);
        self.signs.extend(signs);
        self.modem_ids.extend(modem_ids);
        self.listening.extend(listening);
        self.deaf.extend(deaf);
        self.bands.extend(bands);
        self.clock_set.extend(clock_set);
    }

    /// Takes in that its modem works in a band from now on.
    pub(crate) fn works_in(&mut self, time_s: f64, band: String) {
        if self.bands.last().is_none_or(|(latest_s, latest)| *latest != band || *latest_s > time_s) {
            self.bands.push((time_s, band));
        }
    }

    /// In which band its modem worked, where it had said so by then.
    pub(crate) fn band(&self, time_s: f64) -> Option<&str> {
        let said = self.bands.iter().filter(|(from_s, _)| *from_s <= time_s);
        said.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, band)| band.as_str())
    }

    /// Takes in that its modem was at work, as told by the record that begins at this number of `signs`.
    pub(crate) fn sign(&mut self, record: usize, time_s: f64) {
        match self.signs.get_mut(record) {
            Some((from_s, to_s)) => (*from_s, *to_s) = (from_s.min(time_s), to_s.max(time_s)),
            None => self.signs.push((time_s, time_s)),
        }
    }
}

impl Unknown {
    /// All of them.
    pub const ALL: [Unknown; 9] = [
        Unknown::NotKnownSent,
        Unknown::DestinationUnknown,
        Unknown::NotRecording,
        Unknown::Transmitting,
        Unknown::Rebooting,
        Unknown::OtherMode,
        Unknown::ClockUnsure,
        Unknown::NoNavigation,
        Unknown::Surfaced,
    ];

    /// The reason in a few words.
    pub fn words(self) -> &'static str {
        match self {
            Unknown::NotKnownSent => "not known to be sent",
            Unknown::DestinationUnknown => "to whom unknown",
            Unknown::NotRecording => "modem silent",
            Unknown::Transmitting => "itself sending",
            Unknown::Rebooting => "rebooting",
            Unknown::OtherMode => "other mode",
            Unknown::ClockUnsure => "clock unsure",
            Unknown::NoNavigation => "no navigation",
            Unknown::Surfaced => "surfaced",
        }
    }

    /// The reason as a key for programs.
    pub fn key(self) -> &'static str {
        match self {
            Unknown::NotKnownSent => "not_known_sent",
            Unknown::DestinationUnknown => "destination_unknown",
            Unknown::NotRecording => "not_recording",
            Unknown::Transmitting => "transmitting",
            Unknown::Rebooting => "rebooting",
            Unknown::OtherMode => "other_mode",
            Unknown::ClockUnsure => "clock_unsure",
            Unknown::NoNavigation => "no_navigation",
            Unknown::Surfaced => "surfaced",
        }
    }
}
