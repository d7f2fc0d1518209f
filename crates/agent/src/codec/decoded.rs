//! Decoded packets.

use dgpc::Summary;
use pingmap_packet::Cell;

/// Key of a remote event: number of the receiver, and slot.
pub(crate) type EventKey = (u8, u32);

/// Key of a summary packet: number of the sender, and counter.
pub(crate) type PacketKey = (u8, u16);

/// A decoded summary packet and its bytes.
#[derive(Debug)]
pub(crate) struct Packet {
    pub(crate) bytes: Vec<u8>,
    pub(crate) summaries: Vec<Summary>,
    /// Length of the longest link among its inducing points, in metres; 0 without any.
    pub(crate) longest_m: f64,
}

/// A decoded report and its bytes.
#[derive(Debug)]
pub(crate) struct Report {
    pub(crate) bytes: Vec<u8>,
    /// First slot of the report.
    pub(crate) first: u32,
    /// Outcomes by slot: whether the sender heard the message of that slot.
    pub(crate) outcomes: Vec<(u32, bool)>,
    /// Slots of the sender in which it did not transmit.
    pub(crate) unused: Vec<u32>,
    /// Waypoints of the sender by slot.
    pub(crate) waypoints: Vec<(u32, Cell)>,
}

impl Report {
    pub(crate) fn latest_slot(&self) -> u32 {
        let outcome = self.outcomes.last().map(|&(slot, _)| slot);
        let waypoint = self.waypoints.last().map(|&(slot, _)| slot);
        [outcome, waypoint, self.unused.last().copied()].into_iter().flatten().fold(self.first, u32::max)
    }
}
