//! Messages from the vehicle to the host.

use std::collections::BTreeMap;

use pingmap_agent::VehicleId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::protocol::fault::Fault;
use crate::protocol::hex::Hex;

/// Version of the host protocol.
pub const PROTOCOL: u32 = 1;

/// A message to the host. `input` is the number of the line that it answers, from 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Message {
    /// The answer to `hello`.
    Hello(Greeting),
    /// The input was handled.
    Ok {
        /// Number of the input.
        input: u64,
        /// Whether its content is stored, and survives a crash. False after the store failed.
        stored: bool,
    },
    /// The input was not handled.
    Error {
        /// Number of the input. 0 for a fault that belongs to no input.
        input: u64,
        /// The fault.
        #[serde(flatten)]
        fault: Fault,
    },
    /// The vehicle learned from a slot of another member.
    Event(LearnedEvent),
    /// Whether the content of a frame or of piggybacked outcomes counts.
    Acknowledgement {
        /// Number of the input.
        input: u64,
        /// Whether it counts.
        counts: bool,
        /// Why it does not count.
        #[serde(skip_serializing_if = "Option::is_none", default)]
        reason: Option<String>,
    },
    /// A frame to send.
    Frame {
        /// Number of the input.
        input: u64,
        /// Token of the frame, for `departed` or `dropped`.
        token: u64,
        /// Bytes of the frame.
        bytes: Hex,
    },
    /// There is nothing worth sending.
    Nothing {
        /// Number of the input.
        input: u64,
    },
    /// Bits to put into a message.
    Piggyback {
        /// Number of the input.
        input: u64,
        /// The bits as a number, the first bit lowest, in hexadecimal digits.
        bits: String,
        /// Number of bits.
        n_bits: usize,
    },
    /// Probabilities of the links of a query, in its order.
    Prediction {
        /// Number of the input.
        input: u64,
        /// How well the map predicted the latest events.
        trust: Trust,
        /// The answers.
        links: Vec<Answer>,
    },
    /// The state of the vehicle.
    Status(Box<StatusReport>),
    /// The last message. Everything is stored, unless the store failed before.
    Stopped {
        /// Number of the last input.
        inputs: u64,
    },
}

/// See [`Message::Hello`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Greeting {
    /// Version of the protocol.
    pub version: u32,
    /// Version of the program.
    pub program: String,
    /// The vehicle.
    #[schemars(with = "String")]
    pub vehicle: VehicleId,
    /// Digest of the team configuration.
    pub team: String,
    /// Epoch of the team.
    pub epoch: u32,
    /// Events that were restored from the store.
    pub events: usize,
    /// Warnings of the start, such as a store that was damaged.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub warnings: Vec<String>,
}

/// See [`Message::Event`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LearnedEvent {
    /// Beginning of the slot.
    pub time: f64,
    /// The member that transmitted.
    #[schemars(with = "String")]
    pub from: VehicleId,
    /// Whether the vehicle heard it.
    pub heard: bool,
    /// Probability that the map gave before it learned from the slot. Absent where a position was not known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub probability: Option<f64>,
    /// Probability by range alone.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub by_range: Option<f64>,
}

/// The answer for one link.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Answer {
    /// Probability that a message is received.
    pub probability: f64,
    /// Lower end of the interval that holds nine in ten of the true probabilities.
    pub low: f64,
    /// Upper end of that interval.
    pub high: f64,
    /// Share of the prior variance that the data explain: 0 far from all data.
    pub explained: f64,
    /// Probability by range alone.
    pub by_range: f64,
    /// Whether the map deserves trust: see [`Trust`].
    pub trusted: bool,
    /// Why it does not.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub reason: Option<String>,
}

/// How well the map predicted the latest own events, in comparison with range alone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Trust {
    /// Events that are compared: the latest ones, at most 200.
    pub events: usize,
    /// Weight of the map in the mixture of both: its posterior probability, given these events.
    pub map_weight: f64,
    /// Mean negative log-likelihood of the map in nats per event.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub map_nll: Option<f64>,
    /// Mean negative log-likelihood of range alone in nats per event.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub range_nll: Option<f64>,
}

/// See [`Message::Status`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StatusReport {
    /// Number of the input. 0 for a report that was not requested.
    pub input: u64,
    /// Time of the clock.
    pub time: f64,
    /// State of the store.
    pub store: StoreState,
    /// Warnings of the start, as in `hello`.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub warnings: Vec<String>,
    /// Trust in the map.
    pub trust: Trust,
    /// Own events with positions.
    pub own_events: usize,
    /// Events of other members, and own outcomes, that are located.
    pub located_events: usize,
    /// Events of other members, and own outcomes, that wait for a position.
    pub unlocated_events: usize,
    /// Slots of other members that did not count, by reason.
    pub excluded_slots: BTreeMap<String, u64>,
    /// Receptions that arrived after their slot was counted.
    pub late_receptions: u64,
    /// Transmissions and deaf intervals that the host reported after their slots were counted.
    pub late_reports: u64,
    /// Frames that neither departed nor were dropped.
    pub open_frames: usize,
    /// Numbers of accepted frames, and of refused frames by reason.
    pub frames: BTreeMap<String, u64>,
    /// Offset of the vehicle's own clock in slots, if the receptions show one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub clock_offset_slots: Option<i32>,
    /// Every other member.
    #[schemars(with = "BTreeMap<String, MemberReport>")]
    pub members: BTreeMap<VehicleId, MemberReport>,
}

/// State of the store.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "state", rename_all = "snake_case")]
pub enum StoreState {
    /// Every acknowledged input is stored.
    Stored,
    /// The vehicle continues in memory, and sends nothing.
    Failed {
        /// The failure.
        problem: String,
    },
}

/// State of one member.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MemberReport {
    /// Time of the last frame that counted.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub last_heard: Option<f64>,
    /// Why data of the member do not count, and since when. Empty if all count.
    pub ignored: BTreeMap<String, f64>,
    /// Its frames that wait for the clock of the vehicle.
    pub waiting_frames: usize,
    /// Clock offset of the member in slots, if the receptions show one.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub clock_offset_slots: Option<i32>,
}
