//! Receipts: the result of receiving a packet.

use crate::types::event::VehicleId;

/// The result of receiving a packet, report or piggybacked outcomes.
#[derive(Debug, Clone, PartialEq)]
pub enum Receipt {
    /// The content counts from now on.
    Accepted,
    /// The content does not count.
    Refused(Refusal),
}

impl Receipt {
    /// Returns the class of the receipt, by which [`Status::counts`](crate::Status::counts) counts it.
    pub fn class(&self) -> &'static str {
        let Self::Refused(refusal) = self else { return "accepted" };
        match refusal {
            Refusal::Malformed(_) | Refusal::NoSlot { .. } => "malformed",
            Refusal::Forged(_) | Refusal::PiggybackDisabled => "forged",
            Refusal::OtherForm(_) | Refusal::OtherTeam { .. } | Refusal::TooLong { .. } => "other-team",
            Refusal::UnknownSender(_) | Refusal::NoMember(_) => "unknown-sender",
            Refusal::Duplicate => "duplicate",
            Refusal::TooOld => "too-old",
            Refusal::Conflict(_) => "conflict",
            Refusal::SlotAhead { .. } | Refusal::CounterAhead { .. } => "ahead",
            Refusal::OwnNumber(_) | Refusal::OwnReport | Refusal::NotSentByMe(_) => "own-number",
            Refusal::Unusable(_) => "unusable",
        }
    }

    /// Returns whether the content is stored: it counts, it may count later, or it shows a conflict.
    pub(crate) fn is_stored(&self) -> bool {
        let waits = matches!(self, Receipt::Refused(Refusal::SlotAhead { .. } | Refusal::CounterAhead { .. }));
        waits || self.changes_memory()
    }

    /// Returns whether the memory may have changed. Damaged, foreign and repeated frames leave it as it was.
    pub(crate) fn changes_memory(&self) -> bool {
        !matches!(
            self,
            Receipt::Refused(
                Refusal::Malformed(_)
                    | Refusal::Forged(_)
                    | Refusal::OtherForm(_)
                    | Refusal::OtherTeam { .. }
                    | Refusal::TooLong { .. }
                    | Refusal::UnknownSender(_)
                    | Refusal::Unusable(_)
                    | Refusal::PiggybackDisabled
                    | Refusal::NoMember(_)
                    | Refusal::NoSlot { .. }
                    | Refusal::Duplicate
                    | Refusal::SlotAhead { .. }
                    | Refusal::CounterAhead { .. }
            )
        )
    }
}

/// The reason why received content does not count.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The bytes are neither a summary packet nor a report, or a field is out of bounds.
    #[error("neither a summary packet nor a report: {0}")]
    Malformed(pingmap_packet::Error),
    /// The tag is wrong. The packet is damaged, or authenticated with another key.
    #[error("not of this team: {0}")]
    Forged(pingmap_packet::Error),
    /// The packet is intact but has a form that this team does not send. Its sender uses another team file.
    #[error("not of this team: the team sends no packets of the form {0}")]
    OtherForm(&'static str),
    /// The packet was formed under another team configuration, for example with another model, grid or epoch. Its
    /// sender uses another team file. A plain packet may also be damaged; its number is then arbitrary.
    #[error("formed under another team configuration{}", difference_in_words(*found, *expected))]
    OtherTeam {
        /// Number of the team configuration in an intact plain packet. `None` for an authenticated packet, which shows
        /// that the sender has the team's key but not which configuration it uses.
        found: Option<u16>,
        /// Number of this team's configuration.
        expected: u16,
    },
    /// The report is longer than the team's frames. No member sends such reports.
    #[error("report of {length} bytes, but the team's frames have at most {max}")]
    TooLong {
        /// Length of the report in bytes.
        length: usize,
        /// Length of the team's frames in bytes: [`crate::Team::frame_bytes`].
        max: usize,
    },
    /// No member has the sender's number.
    #[error("no member has number {0}")]
    UnknownSender(u8),
    /// The team does not use piggybacked outcomes: see [`crate::Team::piggyback`].
    #[error(
        "this team does not piggyback outcomes: they are not authenticated (piggyback = true in the team file allows them)"
    )]
    PiggybackDisabled,
    /// The vehicle is not a member: the sender of piggybacked outcomes, or the vehicle of an unused slot.
    #[error("{0} is not a member of the team")]
    NoMember(VehicleId),
    /// Piggybacked outcomes arrived at a time without a numbered slot.
    #[error("there is no numbered slot at {time_s} s")]
    NoSlot {
        /// Time of arrival, in seconds.
        time_s: f64,
    },
    /// The content was received before.
    #[error("already received")]
    Duplicate,
    /// The sender has sent a full window of later packets or reports.
    #[error("older than the window of its sender")]
    TooOld,
    /// Two vehicles use one number, or the sender restarted without its memory. Neither packet counts.
    #[error("another packet of the same sender has counter {0}")]
    Conflict(u16),
    /// One of the two clocks is wrong. The outcomes count as soon as this vehicle's clock allows the slot.
    #[error("slot {slot} is ahead of this vehicle's clock, which allows slots up to {latest}: it waits")]
    SlotAhead {
        /// The slot.
        slot: u32,
        /// Latest slot that the clock allows.
        latest: u32,
    },
    /// By this vehicle's clock the schedule does not allow that counter yet. The packet counts as soon as it does.
    #[error("counter {counter} is ahead of this vehicle's clock, which allows counters up to {largest}: it waits")]
    CounterAhead {
        /// The counter.
        counter: u16,
        /// Largest counter that the clock allows.
        largest: u16,
    },
    /// Another vehicle has this number, or this vehicle lost its memory. Its next counter is a full window larger.
    #[error("duplicate vehicle number: received a packet under this vehicle's own number, counter {0}")]
    OwnNumber(u16),
    /// Another vehicle has this number, or this vehicle lost its memory. The report is stored as an own report.
    #[error("duplicate vehicle number: received a report or outcomes under this vehicle's own number")]
    OwnReport,
    /// The frame was recorded as transmitted by this vehicle, but it has another number.
    #[error("sent under number {0}, which is not this vehicle's number")]
    NotSentByMe(u8),
    /// The packet does not decode to a summary, because its points coincide.
    #[error("contains no usable summary: {0}")]
    Unusable(dgpc::Error),
}

fn difference_in_words(found: Option<u16>, expected: u16) -> String {
    found.map_or_else(
        || ", with this team's key".into(),
        |found| format!(", or damaged: its configuration has number {found}, expected {expected}"),
    )
}
