//! The options that decide how recordings become events.

use std::collections::BTreeSet;

use pingmap_agent::VehicleId;

/// Options of [`crate::join`].
#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// Speed of sound, in metres per second.
    pub sound_m_per_s: f64,
    /// Upper limit of the difference between two clocks, in seconds. At 0 the clocks agree, and none is estimated.
    pub clock_offset_s_max: f64,
    /// Upper limit of the difference between the expected and the recorded arrival of one message, in seconds. It is
    /// lower where the sender's transmissions are close to each other.
    pub match_s: f64,
    /// The vehicle whose clock is right: times and positions are corrected to it. With `None` they stay as recorded.
    pub reference_clock: Option<VehicleId>,
    /// Longest gap between two fixes across which a position is interpolated, in seconds.
    pub nav_gap_s_max: f64,
    /// Duration of a message, in seconds. A vehicle cannot receive during its own transmission.
    pub message_s: f64,
    /// Largest time between two duplicates of one arrival, in seconds.
    pub duplicate_s: f64,
    /// The vehicles that transmit in every slot of their schedule.
    pub slot_use: SlotUse,
    /// Whether a message to one vehicle counts as an event for all other receivers, too.
    pub overhear: bool,
    /// Whether one decoded frame suffices for a message of several frames; otherwise all frames are required.
    pub any_frame: bool,
    /// Depth in metres above which a vehicle is at the surface and can neither receive nor be received.
    pub surfaced_above_m: Option<f64>,
}

/// The vehicles that transmit in every slot of their schedule.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum SlotUse {
    /// No vehicle: a slot without a reception may have stayed unused.
    #[default]
    NoSender,
    /// All vehicles.
    AllSenders,
    /// The listed vehicles.
    SomeSenders(BTreeSet<VehicleId>),
}

impl SlotUse {
    pub(crate) fn includes(&self, vehicle: &VehicleId) -> bool {
        match self {
            SlotUse::NoSender => false,
            SlotUse::AllSenders => true,
            SlotUse::SomeSenders(vehicles) => vehicles.contains(vehicle),
        }
    }
}

impl Default for Rules {
    /// Sea water, clocks that differ by at most 10 s, a position every 30 s, messages of 3 s, and
    /// arrivals up to 10 s from the expected time.
    fn default() -> Self {
        Self {
            sound_m_per_s: 1500.0,
            clock_offset_s_max: 10.0,
            match_s: 10.0,
            reference_clock: None,
            nav_gap_s_max: 30.0,
            message_s: 3.0,
            duplicate_s: 0.5,
            slot_use: SlotUse::NoSender,
            overhear: false,
            any_frame: false,
            surfaced_above_m: None,
        }
    }
}
