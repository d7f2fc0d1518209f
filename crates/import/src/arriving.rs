//! How what is told of arrivals gets into a recording.

use pingmap_agent::MessageKind;

use crate::ids::Ids;
use crate::recording::{Arrival, Recording};

/// Where what is told goes.
pub(crate) struct Into<'a> {
    pub(crate) recording: &'a mut Recording,
    pub(crate) ids: &'a Ids,
}

impl Into<'_> {
    pub(crate) fn sign(&mut self, time_s: f64) {
        self.recording.sign(0, time_s);
    }

    /// The id by which this modem is known to others.
    pub(crate) fn is_called(&mut self, id: &str) {
        if id.parse::<u32>().is_ok() {
            self.recording.modem_ids.insert(id.to_owned());
        }
    }

    /// A message that reached the modem, or a frame of one; nothing where its source is everybody.
    pub(crate) fn arrive(&mut self, time_s: f64, (source, destination): (&str, &str), arrival: Part) {
        let Some(source) = self.ids.whom(source) else { return };
        let Part { frame, frames, good, kind } = arrival;
        let destination = self.ids.whom(destination);
        self.sign(time_s);
        let arrival = Arrival { time_s, source, destination, frame, frames, good, kind };
        self.recording.arrivals.get_or_insert_default().push(arrival);
    }
}

/// A frame, or a whole message.
#[derive(Debug, Clone, Default)]
pub(crate) struct Part {
    pub(crate) frame: Option<u32>,
    pub(crate) frames: Option<u32>,
    pub(crate) good: bool,
    pub(crate) kind: Option<MessageKind>,
}
