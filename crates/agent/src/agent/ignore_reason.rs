//! Reasons why data of a member do not count.

/// Reason why a vehicle does not use data of a member, or a part of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum IgnoreReason {
    /// The host of the vehicle muted the member.
    Muted,
    /// Its outcomes or summaries contradict those of all others: its discrepancy exceeds the threshold
    /// ([`Agent::discrepancy`](crate::Agent::discrepancy)).
    Contradicts,
    /// Its last four messages arrived outside its slots: its clock or its schedule is wrong. Its outcomes and reports
    /// do not count.
    OutOfSlot,
    /// The vehicle received it in at least three slots that it reported as unused. Its other data count.
    FalseClaims,
    /// Most receptions of the member contradict its reported track. Its outcomes count.
    WrongTrack,
    /// Some of its frames are ahead of the vehicle's clock. Its other frames count.
    Ahead,
}

impl IgnoreReason {
    /// Returns the reason as a key of files.
    pub fn name(self) -> &'static str {
        match self {
            IgnoreReason::Muted => "muted",
            IgnoreReason::Contradicts => "contradicts",
            IgnoreReason::OutOfSlot => "out-of-slot",
            IgnoreReason::FalseClaims => "false-claims",
            IgnoreReason::WrongTrack => "wrong-track",
            IgnoreReason::Ahead => "ahead",
        }
    }

    /// Returns the reason in words, as a clause about the member.
    pub fn description(self) -> &'static str {
        match self {
            IgnoreReason::Muted => "it is muted",
            IgnoreReason::Contradicts => "its outcomes or summaries contradict those of all others",
            IgnoreReason::OutOfSlot => "its messages arrive outside its slots",
            IgnoreReason::FalseClaims => "it was received in slots that it reported as unused (its other data count)",
            IgnoreReason::WrongTrack => "its reported track contradicts receptions (its outcomes count)",
            IgnoreReason::Ahead => "some of its frames are ahead of the clock (its other data count)",
        }
    }
}
