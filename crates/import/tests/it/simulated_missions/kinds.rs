//! The kinds of missions, and the random numbers that each mission is drawn from.

/// A kind of mission, by the property that makes its records hard to join.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MissionKind {
    /// Packets of 1 to 5 s. Receptions are recorded at the end of the packet.
    MixedLengths,
    /// Some senders record the start of a packet and others its end. Some receivers record each reception late.
    MixedStamps,
    /// The records of a receiver carry the time of its next poll.
    PollingLoggers,
    /// A receiver that decodes a message addressed to it acknowledges it within 3 s.
    Acknowledgements,
    /// The host of a receiver replies within 3 s to a message that it received.
    Replies,
    /// One clock steps by 2 to 8 s.
    ClockStep,
}

impl MissionKind {
    pub(super) const ALL: [Self; 6] = [
        Self::MixedLengths,
        Self::MixedStamps,
        Self::PollingLoggers,
        Self::Acknowledgements,
        Self::Replies,
        Self::ClockStep,
    ];
}
