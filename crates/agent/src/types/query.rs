//! Queries: the link, vehicles, time and message kind for which a model predicts an outcome.

use pingmap_packet::digest;

use crate::types::event::{Event, Link, MessageKind, VehicleId};

/// The vehicle at one end of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Vehicle {
    /// An average vehicle, whose own offset is zero.
    #[default]
    Typical,
    /// A vehicle without data, drawn from the population of vehicles. Its offset has the prior's variance.
    New,
    /// A specific vehicle.
    Named(Label),
}

/// The numeric form of a name in the inputs: 48 bits of the name's digest. All vehicles compute equal labels without
/// prior agreement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label(u64);

impl Label {
    fn from_name(name: &str) -> Self {
        let mut bytes = [0; 8];
        bytes[..6].copy_from_slice(&digest(name.as_bytes())[..6]);
        Self(u64::from_le_bytes(bytes))
    }
}

/// Label of a typical vehicle, kind or time. It is negative, so label terms have no offset. No name has it.
const TYPICAL_LABEL: f64 = -1.0;

/// Label of a new vehicle. It is not a whole number, so no name has it.
const NEW_VEHICLE_LABEL: f64 = 0.5;

impl Vehicle {
    pub(crate) fn label(self) -> f64 {
        match self {
            Vehicle::Typical => TYPICAL_LABEL,
            Vehicle::New => NEW_VEHICLE_LABEL,
            Vehicle::Named(Label(number)) => number as f64,
        }
    }
}

impl From<&VehicleId> for Vehicle {
    fn from(id: &VehicleId) -> Self {
        Vehicle::Named(Label::from_name(id.as_str()))
    }
}

/// The message kind of a query.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// An average kind, whose offset is zero. Unknown kinds count as typical.
    #[default]
    Typical,
    /// A specific kind.
    Named(Label),
}

impl Kind {
    pub(crate) fn label(self) -> f64 {
        match self {
            Kind::Typical => TYPICAL_LABEL,
            Kind::Named(Label(number)) => number as f64,
        }
    }
}

impl From<&MessageKind> for Kind {
    fn from(kind: &MessageKind) -> Self {
        Kind::Named(Label::from_name(kind.as_str()))
    }
}

/// The transmission time of a query. It matters if the model has a term that varies with time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Time {
    /// An average time, at which time-dependent terms are zero.
    #[default]
    Typical,
    /// A time far from all data. Time-dependent terms have their prior variance.
    AnotherDay,
    /// A specific time, in seconds.
    At(f64),
}

/// Time at which the correlation with every specific time is zero, in seconds.
const ANOTHER_DAY_S: f64 = 1e300;

impl Time {
    /// Returns the two input columns of the time: seconds, and the label of the water. The label is negative at a
    /// typical time.
    pub(crate) fn columns(self) -> [f64; 2] {
        match self {
            Time::Typical => [0.0, TYPICAL_LABEL],
            Time::AnotherDay => [ANOTHER_DAY_S, 0.0],
            Time::At(time_s) => [time_s, 0.0],
        }
    }
}

/// A transmission whose outcome a model predicts: link, vehicles, time and message kind.
///
/// A [`Link`] converts into the query of typical vehicles at a typical time with a typical message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinkQuery {
    /// Positions of both ends.
    pub link: Link,
    /// Vehicle that transmits.
    pub transmitter: Vehicle,
    /// Vehicle that listens.
    pub receiver: Vehicle,
    /// Time of transmission.
    pub when: Time,
    /// Message kind.
    pub kind: Kind,
    /// Treatment of an end whose heading is unknown.
    pub unknown_heading: UnknownHeading,
}

/// Treatment of an end whose heading is unknown, if the model has an aspect term of that end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnknownHeading {
    /// The prediction is the mean over headings.
    #[default]
    Averaged,
    /// The aspect term of that end is left out, as in the events from which the vehicle learns.
    LeftOut,
}

impl From<Link> for LinkQuery {
    fn from(link: Link) -> Self {
        let (transmitter, receiver) = (Vehicle::Typical, Vehicle::Typical);
        let unknown_heading = UnknownHeading::default();
        Self { link, transmitter, receiver, when: Time::Typical, kind: Kind::Typical, unknown_heading }
    }
}

impl From<&Link> for LinkQuery {
    fn from(link: &Link) -> Self {
        Self::from(*link)
    }
}

impl From<&LinkQuery> for LinkQuery {
    fn from(query: &LinkQuery) -> Self {
        *query
    }
}

impl Event {
    /// Returns the query of this event's transmission.
    pub fn query(&self) -> LinkQuery {
        LinkQuery {
            link: self.link,
            transmitter: (&self.transmitter_id).into(),
            receiver: (&self.receiver_id).into(),
            when: Time::At(self.time_s),
            kind: self.kind.as_ref().map_or(Kind::Typical, Kind::from),
            unknown_heading: UnknownHeading::LeftOut,
        }
    }
}
