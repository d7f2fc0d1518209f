//! The announcement of a message, and the intervals within which sentences belong together.

use pingmap_agent::MessageKind;

use crate::readers::modem::nmea::Sentence;

/// Longest time between sentences of one message, in seconds: an announcement and its data, or data and its statistics.
pub(super) const MESSAGE_S_MAX: f64 = 30.0;

/// Longest interval between two successive frames of one message, in seconds.
pub(super) const FRAME_S_MAX: f64 = 5.0;

/// An announcement: the source will send a number of frames at a rate.
#[derive(Debug, Clone)]
pub(super) struct Cycle {
    time_s: f64,
    pub(super) source: String,
    rate: String,
    pub(super) frames: Option<u32>,
}

impl Cycle {
    pub(super) fn new(time_s: f64, sentence: &Sentence) -> Self {
        let (source, rate) = (sentence.field(1).to_owned(), sentence.field(3).to_owned());
        Self { time_s, source, rate, frames: sentence.number(5).filter(|frames| *frames > 0) }
    }

    /// Returns whether a message at a time may be the announced one.
    pub(super) fn is_recent(&self, time_s: f64) -> bool {
        time_s - self.time_s <= MESSAGE_S_MAX
    }

    pub(super) fn kind(&self) -> Option<MessageKind> {
        rate_kind(&self.rate)
    }
}

/// Returns the kind of messages at a rate.
pub(super) fn rate_kind(rate: &str) -> Option<MessageKind> {
    (!rate.is_empty() && !rate.contains(char::is_control)).then(|| MessageKind::new(format!("rate {rate}")))
}

/// Returns the kind of mini-packets.
pub(super) fn mini_kind() -> Option<MessageKind> {
    Some(MessageKind::new("mini"))
}
