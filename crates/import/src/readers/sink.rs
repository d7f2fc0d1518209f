//! The sink of modem records: adds them to a recording.

use pingmap_agent::MessageKind;

use crate::model::modem_ids::ModemIds;
use crate::model::recording::{Arrival, Recording};

/// A recording under construction, with the table of modem ids.
pub(crate) struct Sink<'a> {
    pub(crate) recording: &'a mut Recording,
    pub(crate) ids: &'a ModemIds,
}

impl Sink<'_> {
    /// Extends the activity of the modem to a time, in seconds.
    pub(crate) fn record_activity(&mut self, time_s: f64) {
        self.recording.extend_activity(0, time_s);
    }

    /// Adds an id of this modem. Ids that are not numeric are ignored.
    pub(crate) fn add_modem_id(&mut self, id: &str) {
        if id.parse::<u32>().is_ok() {
            self.recording.modem_ids.insert(id.to_owned());
        }
    }

    /// Adds the arrival of a message or of one frame. An arrival from the broadcast address is ignored.
    pub(crate) fn add_arrival(&mut self, time_s: f64, (source, destination): (&str, &str), arrival: FrameInfo) {
        let Some(source) = self.ids.resolve(source) else { return };
        let FrameInfo { frame, frames, good, kind } = arrival;
        let destination = self.ids.resolve(destination);
        self.record_activity(time_s);
        let arrival = Arrival { time_s, source, destination, frame, frames, good, kind };
        self.recording.arrivals.get_or_insert_default().push(arrival);
    }
}

/// Properties of one frame, or of a whole message.
#[derive(Debug, Clone, Default)]
pub(crate) struct FrameInfo {
    pub(crate) frame: Option<u32>,
    pub(crate) frames: Option<u32>,
    pub(crate) good: bool,
    pub(crate) kind: Option<MessageKind>,
}
