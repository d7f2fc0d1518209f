//! Messages from the host to the vehicle.

use pingmap_agent::VehicleId;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::protocol::hex::Hex;
use crate::protocol::place::{Place, QueryLink};

/// A message from the host. Times are UTC in seconds since 1970.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Input {
    /// The first message. It names what the host expects, so that a wrong configuration is detected at once.
    Hello(Hello),
    /// A position of the vehicle from its navigation.
    Nav(Nav),
    /// A position of another member that the host knows.
    Peer(Peer),
    /// The vehicle transmitted a message.
    Sent(At),
    /// The vehicle did not transmit in its slot at this time.
    NotSent(At),
    /// The vehicle received a message.
    Heard(Heard),
    /// Whether the vehicle could receive in an interval.
    Listening(Listening),
    /// A sentence between the host and a Micro-Modem.
    Nmea(Nmea),
    /// A frame of pingmap arrived.
    FrameIn(FrameIn),
    /// Piggybacked outcomes arrived in a message of a member.
    PiggybackIn(PiggybackIn),
    /// The host can send a frame.
    FrameRequest(FrameRequest),
    /// A frame left.
    Departed(Departed),
    /// A frame did not leave and never will.
    Dropped(Token),
    /// The host has unused bits in a message.
    PiggybackRequest(PiggybackRequest),
    /// The host asks for probabilities.
    Predict(Predict),
    /// The host asks for the state of the vehicle.
    Status {},
    /// The vehicle shall store everything and end.
    Stop {},
}

/// See [`Input::Hello`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Hello {
    /// Version of the protocol: [`PROTOCOL`](crate::PROTOCOL).
    pub version: u32,
    /// The vehicle that the host expects.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    #[schemars(with = "Option<String>")]
    pub vehicle: Option<VehicleId>,
    /// Digest of the team configuration that the host expects, as `pingmap team` prints it; its beginning suffices.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub team: Option<String>,
}

/// See [`Input::Nav`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Nav {
    /// Time of the position.
    pub time: f64,
    /// Standard deviation of the clock in seconds; that of the configuration if absent.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub clock_sigma: Option<f64>,
    /// The position.
    pub position: Place,
    /// Standard deviation of the position in metres. Positions beyond the limit of the configuration do not count.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub sigma: Option<f64>,
    /// Whether the vehicle is at the surface, where its modem may not receive. It then does not listen.
    #[serde(default)]
    pub surfaced: bool,
}

/// See [`Input::Peer`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// Time of the position. For a position in a message, the time of its reception.
    pub time: f64,
    /// The member.
    #[schemars(with = "String")]
    pub member: VehicleId,
    /// The position.
    pub position: Place,
    /// How the host knows the position.
    pub source: PeerSource,
}

/// How a host knows the position of a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PeerSource {
    /// From an acoustic message of the member. The position is then known only if the message was received.
    Message,
    /// From another source, such as a fixed mooring, a plan, or a radio link.
    Other,
}

/// A transmission of the vehicle, or its absence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct At {
    /// Beginning of the transmission.
    pub time: f64,
    /// Kind of the message. It is not used.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub kind: Option<String>,
}

/// See [`Input::Heard`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Heard {
    /// Time of the reception, or of the transmission if the message states it.
    pub time: f64,
    /// The member that transmitted.
    #[schemars(with = "String")]
    pub from: VehicleId,
    /// Kind of the message. It is not used, because the kind of a missed message is unknown.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub kind: Option<String>,
    /// Frames of pingmap in the message.
    #[serde(skip_serializing_if = "Vec::is_empty", default)]
    pub frames: Vec<Hex>,
}

/// See [`Input::Listening`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Listening {
    /// Beginning of the interval.
    pub from: f64,
    /// End of the interval.
    pub to: f64,
    /// Why the vehicle could not receive. Absent: it could.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub not: Option<String>,
}

/// See [`Input::Nmea`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Nmea {
    /// Time of the sentence.
    pub time: f64,
    /// The sentence, from `$` to its checksum.
    pub sentence: String,
}

/// The link by which a frame arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FrameLink {
    /// By an acoustic message.
    #[default]
    Acoustic,
    /// By another link, such as radio at the surface.
    Other,
}

/// See [`Input::FrameIn`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameIn {
    /// Time of arrival.
    pub time: f64,
    /// The member that transmitted the acoustic message. Required for an acoustic link, because the arrival shows that
    /// its slot was heard.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    #[schemars(with = "Option<String>")]
    pub from: Option<VehicleId>,
    /// Bytes of the frame.
    pub bytes: Hex,
    /// The link. Frames count alike by every link.
    #[serde(default)]
    pub link: FrameLink,
}

/// See [`Input::PiggybackIn`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PiggybackIn {
    /// Time of arrival.
    pub time: f64,
    /// The member that sent the bits.
    #[schemars(with = "String")]
    pub from: VehicleId,
    /// The bits as a number, the first bit lowest, in hexadecimal digits: at most 16.
    pub bits: String,
    /// Number of bits: 7 to 64.
    pub n_bits: usize,
}

/// See [`Input::FrameRequest`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameRequest {
    /// Time at which the frame will leave.
    pub time: f64,
    /// Bytes that fit: 32 at least.
    pub bytes: usize,
}

/// See [`Input::Departed`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Departed {
    /// Token of the frame.
    pub token: u64,
    /// Time at which it left.
    pub time: f64,
}

/// See [`Input::Dropped`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Token {
    /// Token of the frame.
    pub token: u64,
}

/// See [`Input::PiggybackRequest`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PiggybackRequest {
    /// Time at which the message will leave.
    pub time: f64,
    /// Unused bits of the message: 7 to 64.
    pub n_bits: usize,
}

/// See [`Input::Predict`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Predict {
    /// Time of the transmissions; a typical time if absent.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub time: Option<f64>,
    /// Kind of the messages; a typical kind if absent.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub kind: Option<String>,
    /// The links: at most [`LINKS_MAX`].
    pub links: Vec<QueryLink>,
}

/// Largest number of links of one query.
pub const LINKS_MAX: usize = 1000;
