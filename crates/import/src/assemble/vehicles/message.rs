//! Assembly of received frames into messages.

use std::collections::BTreeSet;

use pingmap_agent::{MessageKind, VehicleId};

use crate::assemble::rules::Rules;
use crate::model::recording::Arrival;

/// Longest interval between two successive frames of one message, in seconds.
const FRAME_S_MAX: f64 = 5.0;

/// A message as one modem received it.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    /// Time of its first frame.
    pub(crate) time_s: f64,
    /// Time of its latest frame.
    pub(crate) last_s: f64,
    pub(crate) destination: Option<VehicleId>,
    pub(crate) kind: Option<MessageKind>,
    /// Number of the latest frame; `None` if frames have no numbers.
    frame: Option<u32>,
    /// Largest number of frames that any arrival states or implies.
    frames: u32,
    decoded: BTreeSet<u32>,
    /// Whether an arrival without a frame number was decoded, which stands for the whole message.
    is_whole: bool,
}

impl Message {
    fn new(arrival: &Arrival) -> Self {
        let mut message = Self {
            time_s: arrival.time_s,
            last_s: arrival.time_s,
            destination: arrival.destination.clone(),
            kind: arrival.kind.clone(),
            frame: arrival.frame,
            frames: 0,
            decoded: BTreeSet::new(),
            is_whole: false,
        };
        message.absorb(arrival);
        message
    }

    fn absorb(&mut self, arrival: &Arrival) {
        let frame = arrival.frame.unwrap_or(1);
        self.last_s = arrival.time_s;
        self.frame = arrival.frame;
        self.frames = self.frames.max(frame).max(arrival.frames.unwrap_or(0));
        self.decoded.extend(arrival.good.then_some(frame));
        self.is_whole |= arrival.good && arrival.frame.is_none();
    }

    /// Returns whether at least one frame was decoded.
    pub(crate) fn is_any_decoded(&self) -> bool {
        self.is_whole || !self.decoded.is_empty()
    }

    /// Returns whether the message counts as heard. `frames_sent` is the number of frames by the sender's record.
    pub(crate) fn is_decoded(&self, frames_sent: Option<u32>, any_frame: bool) -> bool {
        let frames = self.frames.max(frames_sent.unwrap_or(0)) as usize;
        self.is_whole || if any_frame { !self.decoded.is_empty() } else { self.decoded.len() >= frames }
    }
}

/// Returns the messages of one sender in the order of time, and the number of duplicate arrivals. O(n log n).
pub(crate) fn assemble_messages(mut arrivals: Vec<&Arrival>, rules: &Rules) -> (Vec<Message>, usize) {
    arrivals.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.frame.cmp(&b.frame)));
    let mut messages: Vec<Message> = Vec::new();
    let mut duplicates = 0;
    for arrival in arrivals {
        let Some(latest) = messages.last_mut() else {
            messages.push(Message::new(arrival));
            continue;
        };
        let is_duplicate = arrival.frame == latest.frame && arrival.time_s - latest.last_s <= rules.duplicate_s;
        let is_next = arrival.frame.zip(latest.frame).is_some_and(|(frame, previous)| frame > previous)
            && arrival.time_s - latest.last_s <= FRAME_S_MAX
            && arrival.destination == latest.destination;
        if is_duplicate || is_next {
            duplicates += usize::from(is_duplicate);
            latest.absorb(arrival);
        } else {
            messages.push(Message::new(arrival));
        }
    }
    (messages, duplicates)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrival(time_s: f64, frame: Option<u32>, frames: Option<u32>, good: bool) -> Arrival {
        Arrival { time_s, source: VehicleId::new("a"), destination: None, frame, frames, good, kind: None }
    }

    fn outcomes(arrivals: &[Arrival], any_frame: bool) -> (Vec<(f64, bool)>, usize) {
        let (messages, duplicates) = assemble_messages(arrivals.iter().collect(), &Rules::default());
        (messages.iter().map(|message| (message.time_s, message.is_decoded(None, any_frame))).collect(), duplicates)
    }

    #[test]
    fn a_message_is_heard_if_all_its_frames_are_decoded() {
        let whole = [
            arrival(10.0, Some(1), Some(3), true),
            arrival(11.0, Some(2), None, true),
            arrival(12.0, Some(3), None, true),
        ];
        assert_eq!(outcomes(&whole, false), (vec![(10.0, true)], 0));
        assert_eq!(outcomes(&whole[..2], false), (vec![(10.0, false)], 0));
        assert_eq!(outcomes(&whole[..2], true), (vec![(10.0, true)], 0));
        let broken = [arrival(10.0, Some(1), None, true), arrival(11.0, Some(2), None, false)];
        assert_eq!(outcomes(&broken, false), (vec![(10.0, false)], 0));
        let (first, _) = assemble_messages(broken[..1].iter().collect(), &Rules::default());
        assert!(first[0].is_decoded(Some(1), false) && !first[0].is_decoded(Some(2), false));
        // An arrival without a frame number stands for the whole message. Frames far apart belong to two messages.
        let (whole, _) = assemble_messages([arrival(10.0, None, None, true)].iter().collect(), &Rules::default());
        assert!(whole[0].is_decoded(Some(3), false));
        let two = [arrival(20.2, Some(1), Some(2), true), arrival(50.2, Some(2), Some(2), true)];
        assert_eq!(outcomes(&two, false), (vec![(20.2, false), (50.2, false)], 0));
    }

    #[test]
    fn a_retransmission_is_a_new_message_and_an_echo_is_a_duplicate() {
        let sent_again =
            [arrival(10.0, None, None, true), arrival(10.2, None, None, true), arrival(14.0, None, None, true)];
        assert_eq!(outcomes(&sent_again, false), (vec![(10.0, true), (14.0, true)], 1));
        let frames_again = [arrival(10.0, Some(1), None, true), arrival(14.0, Some(1), None, false)];
        assert_eq!(outcomes(&frames_again, false), (vec![(10.0, true), (14.0, false)], 0));
    }
}
