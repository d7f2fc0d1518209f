//! What was sent, or may have been.

use std::collections::BTreeSet;

use pingmap_agent::{MessageKind, VehicleId};

use crate::fleet::Fleet;
use crate::message::Message;
use crate::schedule::Schedule;

/// How a transmission is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Proof {
    /// Its sender recorded that it was sent.
    Recorded,
    /// It was the sender's turn, and it is said to use all of them.
    AlwaysSends,
    /// Somebody received it.
    Received,
    /// It was the sender's turn; nothing says that it was used.
    Nothing,
}

/// A transmission, or a turn for one.
#[derive(Debug, Clone)]
pub(crate) struct Transmission {
    /// When it began; of one known by its reception, when that was recorded, without the time that sound took.
    pub(crate) time_s: f64,
    /// By whose clock.
    pub(crate) clock: usize,
    /// Whether the time is that of a reception.
    pub(crate) by_reception: bool,
    pub(crate) proof: Proof,
    pub(crate) destination: Option<VehicleId>,
    pub(crate) frames: Option<u32>,
    pub(crate) kind: Option<MessageKind>,
    /// In which band, where its sender recorded that of itself.
    pub(crate) band: Option<String>,
    /// Whether it may have been for one vehicle, and nobody says for whom.
    pub(crate) destination_unknown: bool,
    /// Receivers that recorded something of its sender at about that time which fits no transmission.
    pub(crate) doubtful_at: BTreeSet<usize>,
}

impl Transmission {
    /// The one that a message must have come from.
    pub(crate) fn behind(message: &Message, receiver: usize, travel_s: f64) -> Self {
        Self {
            time_s: message.time_s - travel_s,
            clock: receiver,
            by_reception: true,
            proof: Proof::Received,
            destination: message.destination.clone(),
            frames: None,
            kind: message.kind.clone(),
            band: None,
            destination_unknown: false,
            doubtful_at: BTreeSet::new(),
        }
    }
}

/// A transmission that was received.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reception<'a> {
    pub(crate) sender: usize,
    pub(crate) sent: &'a Transmission,
    pub(crate) receiver: usize,
    /// When, by the receiver's clock.
    pub(crate) time_s: f64,
}

/// What each vehicle recorded to have sent, or may have sent in its turns, in the order of time. Whoever kept a record has no turns.
pub(crate) fn known(fleet: &Fleet, schedule: Option<&Schedule>) -> Vec<Vec<Transmission>> {
    let span_s = fleet.span_s();
    let margin_s = fleet.rules.clock_off_s_max;
    let of = |(sender, vehicle): (usize, &crate::fleet::Vehicle)| {
        let of_sender = |time_s, proof| Transmission {
            time_s,
            clock: sender,
            by_reception: false,
            proof,
            destination: None,
            frames: None,
            kind: None,
            band: None,
            destination_unknown: false,
            doubtful_at: BTreeSet::new(),
        };
        let mut sent: Vec<Transmission> = match (&vehicle.recording.sent, schedule, vehicle.track.span_s()) {
            (Some(sent), ..) => {
                let recorded = |sent: &crate::recording::Sent| Transmission {
                    destination: sent.destination.clone(),
                    frames: sent.frames,
                    kind: sent.kind.clone(),
                    band: sent.band.clone(),
                    ..of_sender(sent.time_s, Proof::Recorded)
                };
                sent.iter().map(recorded).collect()
            }
            (None, Some(schedule), Some(seen_s)) => {
                let always = fleet.rules.always_send.is_said_of(vehicle.name);
                let proof = if always { Proof::AlwaysSends } else { Proof::Nothing };
                let (from_s, to_s) = (seen_s.0.max(span_s.0 - margin_s), seen_s.1.min(span_s.1 + margin_s));
                schedule
                    .turns_s(vehicle.name, from_s, to_s)
                    .into_iter()
                    .map(|time_s| of_sender(time_s, proof))
                    .collect()
            }
            _ => Vec::new(),
        };
        sent.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // A record that is there twice tells of one transmission.
        sent.dedup_by(|next, sent| {
            next.time_s - sent.time_s <= fleet.rules.same_arrival_s && next.proof == Proof::Recorded
        });
        sent
    };
    fleet.vehicles.iter().enumerate().map(of).collect()
}

/// Those of whom any transmission is known.
pub(crate) fn senders(sent: &[Vec<Transmission>]) -> BTreeSet<usize> {
    (0..sent.len()).filter(|&sender| !sent[sender].is_empty()).collect()
}
