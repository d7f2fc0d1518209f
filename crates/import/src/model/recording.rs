//! The recording of one vehicle, in the time of its own clock.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::{MessageKind, VehicleId};

use crate::model::exclusion::ExclusionReason;
use crate::model::reference::Place;

/// The recordings of all vehicles.
pub type Recordings = BTreeMap<VehicleId, Recording>;

/// The records of one vehicle. Its lists have any order. All times are by its own clock, in seconds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Positions.
    pub fixes: Vec<Fix>,
    /// The position of a station that does not move.
    pub station: Option<Fix>,
    /// Transmissions by the vehicle's own record; `None` if no such record exists.
    pub transmissions: Option<Vec<TransmissionRecord>>,
    /// Receptions; `None` if no such record exists, so that the vehicle is no receiver.
    pub arrivals: Option<Vec<Arrival>>,
    /// Possible receptions in messages with named members, one list for each file. [`crate::resolve_modem_ids`] accepts
    /// those from vehicles with a recording.
    pub reported: Vec<Vec<Arrival>>,
    /// Times of the first and the last record of its modem, for each file.
    pub modem_activity: Vec<(f64, f64)>,
    /// Ids of its modem by the modem's own records.
    pub modem_ids: BTreeSet<String>,
    /// Intervals in which its modem was listening, as stated by the user.
    pub listening: Vec<(f64, f64)>,
    /// Acknowledgements that its modem sent by itself.
    pub replies: Vec<Reply>,
    /// Intervals in which its modem could not receive, and the reason.
    pub deaf_intervals: Vec<(f64, f64, ExclusionReason)>,
    /// Time spans in which records of a damaged log were lost.
    pub lost_spans: Vec<(f64, f64)>,
    /// Band of its modem from a time on, by the modem's own records.
    pub bands: Vec<(f64, String)>,
    /// Times with a report of satellite navigation, and whether it had a fix. A fix sets the clock.
    pub clock_syncs: Vec<(f64, bool)>,
}

/// A position at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// Time of the position, in seconds.
    pub time_s: f64,
    /// Horizontal position.
    pub place: Place,
    /// Depth in metres, if recorded.
    pub depth_m: Option<f64>,
}

/// A transmission in the record of its sender.
#[derive(Debug, Clone, PartialEq)]
pub struct TransmissionRecord {
    /// Start of the transmission, in seconds.
    pub time_s: f64,
    /// Destination; `None` for a broadcast.
    pub destination: Option<VehicleId>,
    /// Number of frames, if recorded.
    pub frames: Option<u32>,
    /// Kind of message, if recorded.
    pub kind: Option<MessageKind>,
    /// Band of this transmission, if recorded. Otherwise the band of the modem applies.
    pub band: Option<String>,
}

/// An acknowledgement that a modem sent by itself, because it decoded a message.
///
/// It contains no data, so it is no transmission whose outcome counts. It is evidence of a reception: a rule that
/// excludes the answered message for this transmission excludes successes alone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reply {
    /// Time at which the modem reported the latest frame of the answered message, in seconds.
    pub decoded_s: f64,
    /// Start of the transmission, in seconds.
    pub start_s: f64,
    /// End of the transmission, in seconds.
    pub end_s: f64,
}

/// A message, or one frame of it, that reached a modem.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrival {
    /// Time of the record, in seconds.
    pub time_s: f64,
    /// Sender.
    pub source: VehicleId,
    /// Destination; `None` for a broadcast.
    pub destination: Option<VehicleId>,
    /// Number of the frame, from 1.
    pub frame: Option<u32>,
    /// Number of frames in the message.
    pub frames: Option<u32>,
    /// Whether it was decoded.
    pub good: bool,
    /// Kind of message, if recorded.
    pub kind: Option<MessageKind>,
}

/// Separates the parts of a band: number, carrier, bandwidth. An unknown part is empty.
pub(crate) const BAND_PARTS: &str = "\u{1f}";

/// Returns whether two bands differ in a part that both state.
pub(crate) fn bands_differ(a: &str, b: &str) -> bool {
    let mut parts = a.split(BAND_PARTS).zip(b.split(BAND_PARTS));
    parts.any(|(a, b)| !a.is_empty() && !b.is_empty() && a != b)
}

impl Recording {
    /// Adds another recording of the same vehicle.
    pub(crate) fn append(&mut self, other: Recording) {
        let Recording {
            fixes,
            station,
            transmissions,
            arrivals,
            reported,
            modem_activity,
            modem_ids,
            listening,
            replies,
            deaf_intervals,
            lost_spans,
            bands,
            clock_syncs,
        } = other;
        self.fixes.extend(fixes);
        self.station = station.or(self.station);
        if let Some(transmissions) = transmissions {
            self.transmissions.get_or_insert_default().extend(transmissions);
        }
        if let Some(arrivals) = arrivals {
            self.arrivals.get_or_insert_default().extend(arrivals);
        }
        self.reported.extend(reported);
        self.modem_activity.extend(modem_activity);
        self.modem_ids.extend(modem_ids);
        self.listening.extend(listening);
        self.replies.extend(replies);
        self.deaf_intervals.extend(deaf_intervals);
        self.lost_spans.extend(lost_spans);
        self.bands.extend(bands);
        self.clock_syncs.extend(clock_syncs);
    }

    /// Records the band of the modem from a time on.
    pub(crate) fn set_band(&mut self, time_s: f64, band: String) {
        if self.bands.last().is_none_or(|(latest_s, latest)| *latest != band || *latest_s > time_s) {
            self.bands.push((time_s, band));
        }
    }

    /// Returns the band of the modem at a time, if it was recorded before.
    pub(crate) fn band(&self, time_s: f64) -> Option<&str> {
        let earlier_bands = self.bands.iter().filter(|(from_s, _)| *from_s <= time_s);
        earlier_bands.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, band)| band.as_str())
    }

    /// Extends the activity of the modem to a time. `record` is the index of the file's entry in `modem_activity`; a
    /// new entry is appended if none exists.
    pub(crate) fn extend_activity(&mut self, record: usize, time_s: f64) {
        match self.modem_activity.get_mut(record) {
            Some((from_s, to_s)) => (*from_s, *to_s) = (from_s.min(time_s), to_s.max(time_s)),
            None => self.modem_activity.push((time_s, time_s)),
        }
    }
}
