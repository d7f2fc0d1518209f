//! What became of a packet.

/// What became of a packet.
#[derive(Debug, Clone, PartialEq)]
pub enum Receipt {
    /// It counts from now on.
    Accepted,
    /// It changed nothing.
    Refused(Refusal),
}

/// Why a packet changed nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Not a map message, or one whose fields are out of bounds.
    #[error("not a map message: {0}")]
    Malformed(pingmap_packet::Error),
    /// The tag does not fit, or a sealed packet met an open team or the other way round.
    #[error("not of this team: {0}")]
    Forged(pingmap_packet::Error),
    /// Formed under another model, grid, member list or epoch, or damaged on its way.
    #[error("formed under another agreement, or damaged: check number {found}, expected {expected}")]
    OtherModel {
        /// The check number in the packet.
        found: u16,
        /// What it would be in this team.
        expected: u16,
    },
    /// A number that no member has.
    #[error("no member has number {number}")]
    UnknownSender {
        /// The number.
        number: u8,
    },
    /// It was received before.
    #[error("received before")]
    Duplicate,
    /// Its sender has sent more than a window of packets since.
    #[error("older than the window of its sender")]
    TooOld,
    /// Its numbers make no message, because its points coincide.
    #[error("says nothing usable: {0}")]
    Unusable(dgpc::Error),
}

impl Refusal {
    /// What a decoder's error means to a receiver.
    pub(crate) fn of(error: pingmap_packet::Error) -> Self {
        match error {
            pingmap_packet::Error::Forged | pingmap_packet::Error::Seal(_) => Refusal::Forged(error),
            other => Refusal::Malformed(other),
        }
    }
}

/// Packets received, by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Count from then on.
    pub accepted: u64,
    /// See [`Refusal::Malformed`].
    pub malformed: u64,
    /// See [`Refusal::Forged`].
    pub forged: u64,
    /// See [`Refusal::OtherModel`].
    pub other_model: u64,
    /// See [`Refusal::UnknownSender`].
    pub unknown_sender: u64,
    /// See [`Refusal::Duplicate`].
    pub duplicate: u64,
    /// See [`Refusal::TooOld`].
    pub too_old: u64,
    /// See [`Refusal::Unusable`].
    pub unusable: u64,
}

impl Counts {
    pub(crate) fn count(&mut self, receipt: &Receipt) {
        let counter = match receipt {
            Receipt::Accepted => &mut self.accepted,
            Receipt::Refused(Refusal::Malformed(_)) => &mut self.malformed,
            Receipt::Refused(Refusal::Forged(_)) => &mut self.forged,
            Receipt::Refused(Refusal::OtherModel { .. }) => &mut self.other_model,
            Receipt::Refused(Refusal::UnknownSender { .. }) => &mut self.unknown_sender,
            Receipt::Refused(Refusal::Duplicate) => &mut self.duplicate,
            Receipt::Refused(Refusal::TooOld) => &mut self.too_old,
            Receipt::Refused(Refusal::Unusable(_)) => &mut self.unusable,
        };
        *counter += 1;
    }
}
