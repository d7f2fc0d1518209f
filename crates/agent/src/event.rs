//! What a vehicle records: who tried to reach whom, from where to where, and whether it worked.

use std::cmp::Ordering;
use std::fmt;

/// The name of a vehicle, as it stands in the event log.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct VehicleId(String);

impl VehicleId {
    /// The vehicle called `name`.
    pub fn new(name: impl Into<String>) -> Self {
        Self(name.into())
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for VehicleId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(&self.0)
    }
}

/// What kind of message it was, as far as kinds get through differently: rate, band, level, length, whatever the log says.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MessageKind(String);

impl MessageKind {
    /// The kind called `name`.
    pub fn new(name: impl Into<String>) -> Self {
        Self(name.into())
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for MessageKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(&self.0)
    }
}

/// A place, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Metres east of the log's origin.
    pub east_m: f64,
    /// Metres north of the log's origin.
    pub north_m: f64,
    /// Metres below the surface, where known.
    pub depth_m: Option<f64>,
}

impl Position {
    /// A place of unknown depth.
    pub fn new(east_m: f64, north_m: f64) -> Self {
        Self { east_m, north_m, depth_m: None }
    }
}

/// Both ends of an attempted transmission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Where the transmitter was.
    pub transmitter: Position,
    /// Where the receiver was.
    pub receiver: Position,
}

impl Link {
    /// Transmitter, then receiver.
    pub fn ends(&self) -> [Position; 2] {
        [self.transmitter, self.receiver]
    }

    /// Horizontal distance between the ends, in metres.
    pub fn range_m(&self) -> f64 {
        let east = self.transmitter.east_m - self.receiver.east_m;
        let north = self.transmitter.north_m - self.receiver.north_m;
        east.hypot(north)
    }

    /// The same with its ends exchanged.
    #[must_use]
    pub fn swapped(&self) -> Self {
        Self { transmitter: self.receiver, receiver: self.transmitter }
    }

    /// The part of it from the transmitter on that is `range_m` long; itself, if it is no longer.
    #[must_use]
    pub fn shortened_to(&self, range_m: f64) -> Self {
        let Self { transmitter: from, receiver: to } = *self;
        let share = range_m / self.range_m();
        if share.is_nan() || share >= 1.0 {
            return *self;
        }
        let along = |from: f64, to: f64| from + share * (to - from);
        let receiver = Position {
            east_m: along(from.east_m, to.east_m),
            north_m: along(from.north_m, to.north_m),
            depth_m: to.depth_m.map(|to_m| from.depth_m.map_or(to_m, |from_m| along(from_m, to_m))),
        };
        Self { receiver, ..*self }
    }
}

/// One attempted transmission, as its receiver knows it: heard or missed. The receiver owns the event.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When it was sent, in seconds.
    pub time_s: f64,
    /// Who sent.
    pub transmitter_id: VehicleId,
    /// Who should have heard it.
    pub receiver_id: VehicleId,
    /// From where to where.
    pub link: Link,
    /// What kind of message, where that is known.
    pub kind: Option<MessageKind>,
    /// Whether it was heard.
    pub success: bool,
}

impl Event {
    /// The order in which events are kept, whatever the order in which they arrive: by time, then transmitter, receiver,
    /// place and kind. Events that are equal in all of these but not in outcome are ordered by outcome.
    pub fn canonical_order(&self, other: &Event) -> Ordering {
        let place = |event: &Event| {
            let Link { transmitter: t, receiver: r } = event.link;
            // Unknown depth comes before any.
            let depth = |end: Position| end.depth_m.unwrap_or(f64::NEG_INFINITY);
            [t.east_m, t.north_m, depth(t), r.east_m, r.north_m, depth(r)]
        };
        let by_place = || {
            let pairs = place(self).into_iter().zip(place(other));
            pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
        };
        self.time_s
            .total_cmp(&other.time_s)
            .then_with(|| self.transmitter_id.cmp(&other.transmitter_id))
            .then_with(|| self.receiver_id.cmp(&other.receiver_id))
            .then_with(by_place)
            .then_with(|| self.kind.cmp(&other.kind))
            .then_with(|| self.success.cmp(&other.success))
    }
}
