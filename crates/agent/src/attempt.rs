//! What is asked of a model: which link, between whom, when, for what kind of message.

use pingmap_packet::digest;

use crate::event::{Event, Link, MessageKind, VehicleId};

/// Who is at one end of a link, as far as vehicles differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Party {
    /// A vehicle in the middle of all: its own offset is zero.
    #[default]
    Typical,
    /// A vehicle that nobody has met, drawn from those that there are: its offset may be any.
    New,
    /// A certain vehicle.
    Vehicle(Label),
}

/// A name as a number that inputs can hold: 48 bits of its digest, so that everybody has the same without having agreed on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label(u64);

impl Label {
    fn of(name: &str) -> Self {
        let mut bytes = [0; 8];
        bytes[..6].copy_from_slice(&digest(name.as_bytes())[..6]);
        Self(u64::from_le_bytes(bytes))
    }
}

/// The labels of nobody and of somebody new, which no name has.
const NOBODY: f64 = -1.0;
const SOMEBODY_NEW: f64 = 0.5;

impl Party {
    /// The number that stands for it in the inputs.
    pub(crate) fn label(self) -> f64 {
        match self {
            Party::Typical => NOBODY,
            Party::New => SOMEBODY_NEW,
            Party::Vehicle(Label(number)) => number as f64,
        }
    }
}

impl From<&VehicleId> for Party {
    fn from(id: &VehicleId) -> Self {
        Party::Vehicle(Label::of(id.as_str()))
    }
}

/// What kind of message it is, as far as kinds get through differently.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kind {
    /// A kind in the middle of all: its offset is zero. What is not known counts as this.
    #[default]
    Typical,
    /// A certain kind.
    Named(Label),
}

impl Kind {
    /// The number that stands for it in the inputs.
    pub(crate) fn label(self) -> f64 {
        match self {
            Kind::Typical => NOBODY,
            Kind::Named(Label(number)) => number as f64,
        }
    }
}

impl From<&MessageKind> for Kind {
    fn from(kind: &MessageKind) -> Self {
        Kind::Named(Label::of(kind.as_str()))
    }
}

/// When a message is sent, as far as the water changes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum When {
    /// In the middle of all times: what changes with time counts for nothing.
    #[default]
    Typical,
    /// At a time far from all that is known: what changes with time may be any.
    AnotherDay,
    /// At this time, in seconds.
    At(f64),
}

/// The time that has nothing in common with any other.
const ANOTHER_DAY_S: f64 = 1e300;

impl When {
    /// The numbers that stand for it in the inputs: a time, and a label that is negative where time does not count.
    pub(crate) fn columns(self) -> [f64; 2] {
        match self {
            When::Typical => [0.0, NOBODY],
            When::AnotherDay => [ANOTHER_DAY_S, 0.0],
            When::At(time_s) => [time_s, 0.0],
        }
    }
}

/// One attempt to get a message through: over which link, between whom, when, and what kind of message. A [`Link`] alone is
/// the attempt of typical vehicles at a typical time with a typical message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attempt {
    /// From where to where.
    pub link: Link,
    /// Who sends.
    pub transmitter: Party,
    /// Who is to hear it.
    pub receiver: Party,
    /// When.
    pub when: When,
    /// What kind of message.
    pub kind: Kind,
}

impl From<Link> for Attempt {
    fn from(link: Link) -> Self {
        let (transmitter, receiver) = (Party::Typical, Party::Typical);
        Self { link, transmitter, receiver, when: When::Typical, kind: Kind::Typical }
    }
}

impl From<&Link> for Attempt {
    fn from(link: &Link) -> Self {
        Self::from(*link)
    }
}

impl From<&Attempt> for Attempt {
    fn from(attempt: &Attempt) -> Self {
        *attempt
    }
}

impl Event {
    /// What was attempted.
    pub fn attempt(&self) -> Attempt {
        Attempt {
            link: self.link,
            transmitter: (&self.transmitter_id).into(),
            receiver: (&self.receiver_id).into(),
            when: When::At(self.time_s),
            kind: self.kind.as_ref().map_or(Kind::Typical, Kind::from),
        }
    }
}
