//! Events: the outcomes of single transmissions that a vehicle records, and their parts.

use std::cmp::Ordering;
use std::fmt;

use serde::{Deserialize, Serialize};

/// The name of a vehicle in the event log.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct VehicleId(String);

impl VehicleId {
    /// Returns the identifier with this name.
    pub fn new(name: impl Into<String>) -> Self {
        Self(name.into())
    }

    /// Returns the name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for VehicleId {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(&self.0)
    }
}

/// The name of a message kind. Kinds differ in their success probability, for example by rate, band, level or length.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MessageKind(String);

impl MessageKind {
    /// Returns the kind with this name.
    pub fn new(name: impl Into<String>) -> Self {
        Self(name.into())
    }

    /// Returns the name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for MessageKind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.pad(&self.0)
    }
}

/// Shortest movement, in metres, that gives a course.
const COURSE_MOVEMENT_MIN_M: f64 = 2.0;

/// A position, in metres, and the heading of the vehicle there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Distance east of the log's origin, in metres.
    pub east_m: f64,
    /// Distance north of the log's origin, in metres.
    pub north_m: f64,
    /// Depth below the surface, in metres, if known.
    pub depth_m: Option<f64>,
    /// Heading of the vehicle, in degrees clockwise from north, if known.
    pub heading_deg: Option<f64>,
}

impl Position {
    /// Returns a position of unknown depth and heading.
    pub fn new(east_m: f64, north_m: f64) -> Self {
        Self { east_m, north_m, depth_m: None, heading_deg: None }
    }

    /// Returns the position without its heading.
    #[must_use]
    pub fn without_heading(self) -> Self {
        Self { heading_deg: None, ..self }
    }

    /// Returns the position at a share of the way from `self` to `to`: `self` for a share of 0, `to` for 1. The depth
    /// is known if both depths are. The heading is unknown.
    #[must_use]
    pub fn between(&self, to: &Position, share: f64) -> Position {
        let along = |from: f64, to: f64| from + share * (to - from);
        Position {
            east_m: along(self.east_m, to.east_m),
            north_m: along(self.north_m, to.north_m),
            depth_m: self.depth_m.zip(to.depth_m).map(|(from_m, to_m)| along(from_m, to_m)),
            heading_deg: None,
        }
    }

    /// Returns the horizontal distance to another position, in metres.
    pub fn distance_m(&self, other: &Position) -> f64 {
        (self.east_m - other.east_m).hypot(self.north_m - other.north_m)
    }

    /// Returns the course from this position to another one, in degrees clockwise from north, from 0 to 360.
    ///
    /// Returns `None` for positions that are less than two metres apart.
    pub fn course_deg(&self, to: &Position) -> Option<f64> {
        let (east_m, north_m) = (to.east_m - self.east_m, to.north_m - self.north_m);
        let has_moved = east_m.hypot(north_m) >= COURSE_MOVEMENT_MIN_M;
        has_moved.then(|| east_m.atan2(north_m).to_degrees().rem_euclid(360.0))
    }
}

/// The positions of both ends of a transmission.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Position of the transmitter.
    pub transmitter: Position,
    /// Position of the receiver.
    pub receiver: Position,
}

impl Link {
    /// Returns the positions of the transmitter and the receiver, in this order.
    pub fn ends(&self) -> [Position; 2] {
        [self.transmitter, self.receiver]
    }

    /// Returns the horizontal distance between the ends, in metres.
    pub fn range_m(&self) -> f64 {
        self.transmitter.distance_m(&self.receiver)
    }

    /// Returns the link with its ends exchanged.
    #[must_use]
    pub fn swapped(&self) -> Self {
        Self { transmitter: self.receiver, receiver: self.transmitter }
    }

    /// Returns the first `range_m` metres of the link, from the transmitter on. Returns the link unchanged if it is not
    /// longer.
    #[must_use]
    pub fn shortened_to(&self, range_m: f64) -> Self {
        let Self { transmitter: from, receiver: to } = *self;
        let share = range_m / self.range_m();
        if share.is_nan() || share >= 1.0 {
            return *self;
        }
        let between = from.between(&to, share);
        let depth_m = between.depth_m.or(to.depth_m);
        Self { receiver: Position { depth_m, heading_deg: to.heading_deg, ..between }, ..*self }
    }
}

/// One transmission as its receiver observed it: heard or missed. The event belongs to its receiver.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Time of transmission, in seconds.
    pub time_s: f64,
    /// Vehicle that transmitted.
    pub transmitter_id: VehicleId,
    /// Vehicle that listened.
    pub receiver_id: VehicleId,
    /// Positions of both ends.
    pub link: Link,
    /// Message kind, if known.
    pub kind: Option<MessageKind>,
    /// Outcome: true if the receiver decoded the message.
    pub success: bool,
}

impl Event {
    /// Compares two events in canonical order, which does not depend on their order of arrival.
    ///
    /// The order is by time, transmitter, receiver, positions, kind and outcome.
    pub fn canonical_order(&self, other: &Event) -> Ordering {
        let coordinates = |event: &Event| {
            let Link { transmitter: t, receiver: r } = event.link;
            // An unknown depth or heading sorts before all known ones.
            let depth = |end: Position| end.depth_m.unwrap_or(f64::NEG_INFINITY);
            let heading = |end: Position| end.heading_deg.unwrap_or(f64::NEG_INFINITY);
            let positions = [t.east_m, t.north_m, depth(t), r.east_m, r.north_m, depth(r)];
            positions.into_iter().chain([heading(t), heading(r)])
        };
        let by_position = || {
            let pairs = coordinates(self).zip(coordinates(other));
            pairs.map(|(a, b)| a.total_cmp(&b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
        };
        self.time_s
            .total_cmp(&other.time_s)
            .then_with(|| self.transmitter_id.cmp(&other.transmitter_id))
            .then_with(|| self.receiver_id.cmp(&other.receiver_id))
            .then_with(by_position)
            .then_with(|| self.kind.cmp(&other.kind))
            .then_with(|| self.success.cmp(&other.success))
    }
}
