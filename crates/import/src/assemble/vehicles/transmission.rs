//! Transmissions, and scheduled slots that may have been used.

use std::collections::{BTreeMap, BTreeSet};

use pingmap_agent::{MessageKind, VehicleId};

use crate::assemble::vehicles::fleet::{Fleet, Vehicle};
use crate::assemble::vehicles::message::Message;
use crate::model::recording::TransmissionRecord;
use crate::model::schedule::Schedule;

/// The evidence that a transmission took place, from the strongest to none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TransmissionEvidence {
    /// The sender recorded the transmission.
    Recorded,
    /// The schedule gives the slot to a sender that uses every slot.
    AssumedSlot,
    /// A receiver recorded the message.
    Received,
    /// The schedule gives the slot to the sender; no record shows that the slot was used.
    UnconfirmedSlot,
}

/// A transmission, or a scheduled slot that may have stayed unused.
#[derive(Debug, Clone)]
pub(crate) struct Transmission {
    pub(crate) sender: usize,
    /// Start by the clock `clock`, in seconds. If only a reception is known: its time minus the travel time of sound.
    pub(crate) time_s: f64,
    /// The vehicle whose clock the time is of.
    pub(crate) clock: usize,
    /// Whether the time derives from a reception.
    pub(crate) is_reception_time: bool,
    /// The evidence apart from receptions. [`TransmissionEvidence::Received`] does not occur here.
    pub(crate) evidence: TransmissionEvidence,
    /// The receivers with a record of the message, and the destination that each of them recorded.
    pub(crate) witnesses: BTreeMap<usize, Option<VehicleId>>,
    /// Destination by the sender's record.
    pub(crate) destination: Option<VehicleId>,
    pub(crate) frames: Option<u32>,
    pub(crate) kind: Option<MessageKind>,
    /// Frequency band by the sender's record.
    pub(crate) band: Option<String>,
}

impl Transmission {
    /// Derives the transmission from a message that a receiver recorded.
    pub(crate) fn from_reception(message: &Message, sender: usize, receiver: usize, travel_s: f64) -> Self {
        Self {
            clock: receiver,
            is_reception_time: true,
            kind: message.kind.clone(),
            ..Self::new(message.time_s - travel_s, sender, TransmissionEvidence::UnconfirmedSlot)
        }
    }

    fn from_record(record: &TransmissionRecord, sender: usize) -> Self {
        Self {
            destination: record.destination.clone(),
            frames: record.frames,
            kind: record.kind.clone(),
            band: record.band.clone(),
            ..Self::new(record.time_s, sender, TransmissionEvidence::Recorded)
        }
    }

    fn new(time_s: f64, sender: usize, evidence: TransmissionEvidence) -> Self {
        Self {
            sender,
            time_s,
            clock: sender,
            is_reception_time: false,
            evidence,
            witnesses: BTreeMap::new(),
            destination: None,
            frames: None,
            kind: None,
            band: None,
        }
    }

    /// Returns the evidence for the transmission, receptions included.
    pub(crate) fn total_evidence(&self) -> TransmissionEvidence {
        let by_reception = if self.witnesses.is_empty() { self.evidence } else { TransmissionEvidence::Received };
        self.evidence.min(by_reception)
    }

    /// Returns whether a record other than that of `receiver` shows that the transmission took place.
    ///
    /// The receiver's own record exists only if it received the message. Such evidence would count every message that
    /// is heard, and no message that is missed.
    pub(crate) fn is_confirmed_for(&self, receiver: usize) -> bool {
        self.evidence != TransmissionEvidence::UnconfirmedSlot || self.other_witnesses(receiver).next().is_some()
    }

    /// Returns the destinations that receivers other than `receiver` recorded.
    pub(crate) fn other_witnesses(&self, receiver: usize) -> impl Iterator<Item = Option<&VehicleId>> {
        let others = self.witnesses.iter().filter(move |(witness, _)| **witness != receiver);
        others.map(|(_, destination)| destination.as_ref())
    }
}

/// The reception of a transmission.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reception<'a> {
    pub(crate) sender: usize,
    pub(crate) transmission: &'a Transmission,
    pub(crate) receiver: usize,
    /// Time of the reception by the receiver's clock, in seconds.
    pub(crate) time_s: f64,
    /// Kind of message by the receiver's record.
    pub(crate) kind: Option<&'a MessageKind>,
}

/// Returns the transmissions of each vehicle in the order of time.
///
/// A vehicle with a record of its transmissions has exactly those. Another vehicle has the slots that the schedule
/// gives it.
pub(crate) fn documented_transmissions(fleet: &Fleet, schedule: Option<&Schedule>) -> Vec<Vec<Transmission>> {
    let span_s = fleet.span_s();
    let margin_s = fleet.rules.clock_offset_s_max;
    let vehicle_transmissions = |(sender, vehicle): (usize, &Vehicle)| {
        let mut transmissions: Vec<Transmission> =
            match (&vehicle.recording.transmissions, schedule, vehicle.track.span_s()) {
                (Some(records), ..) => records.iter().map(|record| Transmission::from_record(record, sender)).collect(),
                (None, Some(schedule), Some(track_s)) => {
                    let is_always_used = fleet.rules.slot_use.includes(vehicle.name);
                    let evidence = if is_always_used {
                        TransmissionEvidence::AssumedSlot
                    } else {
                        TransmissionEvidence::UnconfirmedSlot
                    };
                    let (from_s, to_s) = (track_s.0.max(span_s.0 - margin_s), track_s.1.min(span_s.1 + margin_s));
                    let starts = schedule.slot_starts_s(vehicle.name, from_s, to_s);
                    starts.into_iter().map(|time_s| Transmission::new(time_s, sender, evidence)).collect()
                }
                _ => Vec::new(),
            };
        transmissions.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // A duplicate record describes the same transmission.
        transmissions.dedup_by(|next, previous| {
            next.time_s - previous.time_s <= fleet.rules.duplicate_s && next.evidence == TransmissionEvidence::Recorded
        });
        transmissions
    };
    fleet.vehicles.iter().enumerate().map(vehicle_transmissions).collect()
}

/// Returns the vehicles with at least one transmission.
pub(crate) fn senders(transmissions: &[Vec<Transmission>]) -> BTreeSet<usize> {
    (0..transmissions.len()).filter(|&sender| !transmissions[sender].is_empty()).collect()
}
