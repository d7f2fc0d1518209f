//! From frames to messages.

use std::collections::BTreeSet;

use pingmap_agent::{MessageKind, VehicleId};

use crate::recording::Arrival;
use crate::rules::Rules;

/// No longer than this from one frame of a message to the next.
const FRAME_S_MAX: f64 = 5.0;

/// A message as it reached one modem.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    /// When its first frame was recorded.
    pub(crate) time_s: f64,
    /// When the latest one was.
    pub(crate) last_s: f64,
    pub(crate) destination: Option<VehicleId>,
    pub(crate) kind: Option<MessageKind>,
    /// The number of the latest frame, if frames have numbers.
    frame: Option<u32>,
    /// How many frames it has, as far as anybody said.
    frames: u32,
    decoded: BTreeSet<u32>,
    /// Whether it was recorded as decoded without a word of frames.
    whole: bool,
}

impl Message {
    fn of(arrival: &Arrival) -> Self {
        let mut message = Self {
            time_s: arrival.time_s,
            last_s: arrival.time_s,
            destination: arrival.destination.clone(),
            kind: arrival.kind.clone(),
            frame: arrival.frame,
            frames: 0,
            decoded: BTreeSet::new(),
            whole: false,
        };
        message.take(arrival);
        message
    }

    fn take(&mut self, arrival: &Arrival) {
        let frame = arrival.frame.unwrap_or(1);
        self.last_s = arrival.time_s;
        self.frame = arrival.frame;
        self.frames = self.frames.max(frame).max(arrival.frames.unwrap_or(0));
        self.decoded.extend(arrival.good.then_some(frame));
        self.whole |= arrival.good && arrival.frame.is_none();
    }

    /// Whether anything of it was decoded.
    pub(crate) fn is_any_decoded(&self) -> bool {
        self.whole || !self.decoded.is_empty()
    }

    /// Whether it was decoded, given how many frames its sender says that it had.
    pub(crate) fn is_heard(&self, frames_sent: Option<u32>, any_frame: bool) -> bool {
        let frames = self.frames.max(frames_sent.unwrap_or(0)) as usize;
        self.whole || if any_frame { !self.decoded.is_empty() } else { self.decoded.len() >= frames }
    }
}

/// The messages of one sender in the order of time, and how many arrivals were seen twice.
pub(crate) fn messages(mut arrivals: Vec<&Arrival>, rules: &Rules) -> (Vec<Message>, usize) {
    arrivals.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.frame.cmp(&b.frame)));
    let mut messages: Vec<Message> = Vec::new();
    let mut twice = 0;
    for arrival in arrivals {
        let Some(latest) = messages.last_mut() else {
            messages.push(Message::of(arrival));
            continue;
        };
        let again = arrival.frame == latest.frame && arrival.time_s - latest.last_s <= rules.same_arrival_s;
        let next = arrival.frame.zip(latest.frame).is_some_and(|(frame, before)| frame > before)
            && arrival.time_s - latest.last_s <= FRAME_S_MAX
            && arrival.destination == latest.destination;
        if again || next {
            twice += usize::from(again);
            latest.take(arrival);
        } else {
            messages.push(Message::of(arrival));
        }
    }
    (messages, twice)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrival(time_s: f64, frame: Option<u32>, frames: Option<u32>, good: bool) -> Arrival {
        Arrival { time_s, source: VehicleId::new("a"), destination: None, frame, frames, good, kind: None }
    }

    fn heard(arrivals: &[Arrival], any_frame: bool) -> (Vec<(f64, bool)>, usize) {
        let (messages, twice) = messages(arrivals.iter().collect(), &Rules::default());
        (messages.iter().map(|message| (message.time_s, message.is_heard(None, any_frame))).collect(), twice)
    }

    #[test]
    fn a_message_is_heard_when_all_its_frames_are() {
        let whole = [
            arrival(10.0, Some(1), Some(3), true),
            arrival(11.0, Some(2), None, true),
            arrival(12.0, Some(3), None, true),
        ];
        assert_eq!(heard(&whole, false), (vec![(10.0, true)], 0));
        assert_eq!(heard(&whole[..2], false), (vec![(10.0, false)], 0));
        assert_eq!(heard(&whole[..2], true), (vec![(10.0, true)], 0));
        let broken = [arrival(10.0, Some(1), None, true), arrival(11.0, Some(2), None, false)];
        assert_eq!(heard(&broken, false), (vec![(10.0, false)], 0));
        let (first, _) = messages(broken[..1].iter().collect(), &Rules::default());
        assert!(first[0].is_heard(Some(1), false) && !first[0].is_heard(Some(2), false));
        // A line without a frame is of the whole message; frames of two messages are not one.
        let (whole, _) = messages([arrival(10.0, None, None, true)].iter().collect(), &Rules::default());
        assert!(whole[0].is_heard(Some(3), false));
        let two = [arrival(20.2, Some(1), Some(2), true), arrival(50.2, Some(2), Some(2), true)];
        assert_eq!(heard(&two, false), (vec![(20.2, false), (50.2, false)], 0));
    }

    #[test]
    fn retransmissions_are_messages_and_echoes_are_not() {
        let sent_again =
            [arrival(10.0, None, None, true), arrival(10.2, None, None, true), arrival(14.0, None, None, true)];
        assert_eq!(heard(&sent_again, false), (vec![(10.0, true), (14.0, true)], 1));
        let frames_again = [arrival(10.0, Some(1), None, true), arrival(14.0, Some(1), None, false)];
        assert_eq!(heard(&frames_again, false), (vec![(10.0, true), (14.0, false)], 0));
    }
}
