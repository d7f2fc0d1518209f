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

/// Pseudo-random numbers of the generator SplitMix64.
pub(super) struct Random(u64);

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Self(seed);
        random.next();
        random
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^ (bits >> 31)
    }

    /// Returns a number from `low` to `high`.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.between(0.0, 1.0) < probability
    }

    /// Returns an index below `count`.
    pub(super) fn index(&mut self, count: usize) -> usize {
        (self.next() % count as u64) as usize
    }
}
