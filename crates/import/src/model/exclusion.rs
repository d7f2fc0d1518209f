//! Reasons for which a transmission yields no event for a receiver.

/// The reason for which the outcome of a transmission is unknown for a receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum ExclusionReason {
    /// No record but the receiver's own shows that the transmission took place.
    Unconfirmed,
    /// The sender addresses single vehicles, and no record but the receiver's own states the destination of this
    /// message.
    DestinationUnknown,
    /// The receiver's modem was not active yet or not active any more.
    NotRecording,
    /// The receiver's log is damaged at that time, so that a record of a reception may be lost.
    DamagedLog,
    /// The receiver's modem was not listening, as stated by the user.
    NotListening,
    /// The receiver was transmitting.
    Transmitting,
    /// The receiver's modem was starting.
    Rebooting,
    /// The receiver used another rate or band, or was ranging.
    OtherMode,
    /// The offset between the two clocks is unknown.
    ClockUncertain,
    /// The position of the sender or the receiver is unknown.
    NoNavigation,
    /// The sender or the receiver was at the surface.
    Surfaced,
}

impl ExclusionReason {
    /// All reasons, in the order of the checks.
    pub const ALL: [ExclusionReason; 11] = [
        ExclusionReason::Unconfirmed,
        ExclusionReason::DestinationUnknown,
        ExclusionReason::NotRecording,
        ExclusionReason::DamagedLog,
        ExclusionReason::NotListening,
        ExclusionReason::Transmitting,
        ExclusionReason::Rebooting,
        ExclusionReason::OtherMode,
        ExclusionReason::ClockUncertain,
        ExclusionReason::NoNavigation,
        ExclusionReason::Surfaced,
    ];

    /// Describes the reason in at most four words, for tables.
    pub fn description(self) -> &'static str {
        match self {
            ExclusionReason::Unconfirmed => "unconfirmed",
            ExclusionReason::DestinationUnknown => "destination unknown",
            ExclusionReason::NotRecording => "not recording",
            ExclusionReason::DamagedLog => "damaged log",
            ExclusionReason::NotListening => "not listening",
            ExclusionReason::Transmitting => "transmitting",
            ExclusionReason::Rebooting => "rebooting",
            ExclusionReason::OtherMode => "other mode",
            ExclusionReason::ClockUncertain => "clock uncertain",
            ExclusionReason::NoNavigation => "no navigation",
            ExclusionReason::Surfaced => "surfaced",
        }
    }

    /// Returns the key of the reason in JSON.
    pub fn key(self) -> &'static str {
        match self {
            ExclusionReason::Unconfirmed => "unconfirmed",
            ExclusionReason::DestinationUnknown => "destination_unknown",
            ExclusionReason::NotRecording => "not_recording",
            ExclusionReason::DamagedLog => "damaged_log",
            ExclusionReason::NotListening => "not_listening",
            ExclusionReason::Transmitting => "transmitting",
            ExclusionReason::Rebooting => "rebooting",
            ExclusionReason::OtherMode => "other_mode",
            ExclusionReason::ClockUncertain => "clock_uncertain",
            ExclusionReason::NoNavigation => "no_navigation",
            ExclusionReason::Surfaced => "surfaced",
        }
    }
}
