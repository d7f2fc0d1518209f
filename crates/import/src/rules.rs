//! What is decided by whoever imports.

use std::collections::BTreeSet;

use pingmap_agent::VehicleId;

/// How what was recorded becomes events.
#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// Speed of sound, metres a second.
    pub sound_m_per_s: f64,
    /// Clocks differ by no more than this, in seconds; 0: they do not differ, and nothing is estimated.
    pub clock_off_s_max: f64,
    /// A reception belongs to a transmission if it came within so many seconds of when it should.
    pub match_s: f64,
    /// Whose clock is right: times and places are corrected to it. Nobody's: they stay as recorded.
    pub right_clock: Option<VehicleId>,
    /// Where a vehicle was between two fixes is not known if they are farther apart than this, in seconds.
    pub nav_gap_s_max: f64,
    /// How long a message lasts, in seconds: for so long before and after a message of its own a vehicle hears nothing.
    pub message_s: f64,
    /// The same arrival seen twice: from one sender within so many seconds.
    pub same_arrival_s: f64,
    /// Whose turns in the schedule are all used.
    pub always_send: AlwaysSend,
    /// Whether messages to one vehicle count for the others, too.
    pub overhear: bool,
    /// Whether a message of several frames counts as heard with any of them; else with all.
    pub any_frame: bool,
    /// Vehicles at depths smaller than this are at the surface, and hear and reach nobody.
    pub surfaced_above_m: Option<f64>,
}

/// Whose turns are all used.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum AlwaysSend {
    /// Nobody's: a turn that nobody heard may not have been used.
    #[default]
    Nobody,
    /// Everybody's.
    Everybody,
    /// Those of some.
    These(BTreeSet<VehicleId>),
}

impl AlwaysSend {
    pub(crate) fn is_said_of(&self, vehicle: &VehicleId) -> bool {
        match self {
            AlwaysSend::Nobody => false,
            AlwaysSend::Everybody => true,
            AlwaysSend::These(these) => these.contains(vehicle),
        }
    }
}

impl Default for Rules {
    /// Sea water, clocks off by ten seconds at most, positions every half a minute, messages of three seconds.
    fn default() -> Self {
        Self {
            sound_m_per_s: 1500.0,
            clock_off_s_max: 10.0,
            match_s: 1.0,
            right_clock: None,
            nav_gap_s_max: 30.0,
            message_s: 3.0,
            same_arrival_s: 0.5,
            always_send: AlwaysSend::Nobody,
            overhear: false,
            any_frame: false,
            surfaced_above_m: None,
        }
    }
}
