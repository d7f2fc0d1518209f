//! What became of a packet.

use crate::event::VehicleId;

/// What became of a packet.
#[derive(Debug, Clone, PartialEq)]
pub enum Receipt {
    /// It counts from now on.
    Accepted,
    /// It does not count.
    Refused(Refusal),
}

/// Why a packet does not count.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Neither a map message nor a report, or one whose fields are out of bounds.
    #[error("neither a map message nor a report: {0}")]
    Malformed(pingmap_packet::Error),
    /// The tag does not fit: damaged, or sealed with another key.
    #[error("not of this team: {0}")]
    Forged(pingmap_packet::Error),
    /// Whole, but a form of packet that this team does not send: its sender has another team file.
    #[error("not of this team: {name} is none of the forms that it sends")]
    OtherForm {
        /// Name of the form in the `.proto`.
        name: &'static str,
    },
    /// Formed under another agreement (model, grid, members, slots, epoch…): its sender has another team file. Or an
    /// open packet that was damaged on its way, which then names some number by chance.
    #[error("formed under another agreement{}", numbers(*found, *expected))]
    OtherTeam {
        /// The number of the agreement it was formed under, if it is whole; `None` of a sealed packet, which shows that
        /// the sender has the team's key but not which agreement.
        found: Option<u16>,
        /// The number of this team's.
        expected: u16,
    },
    /// A number that no member has.
    #[error("no member has number {number}")]
    UnknownSender {
        /// The number.
        number: u8,
    },
    /// Spare bits, of which nothing shows who wrote them, in a team with a key: see [`crate::Team::spare_bits`].
    #[error("spare bits are read by no team with a key, unless its file says so")]
    SpareBits,
    /// Spare bits of somebody who is no member.
    #[error("{id} is no member")]
    NoMember {
        /// Who sent them.
        id: VehicleId,
    },
    /// Spare bits of a time of which there are no slots.
    #[error("no slot has a number at {time_s} s")]
    NoSlot {
        /// When they came, in seconds.
        time_s: f64,
    },
    /// It was received before.
    #[error("received before")]
    Duplicate,
    /// Its sender has sent more than a window of packets since.
    #[error("older than the window of its sender")]
    TooOld,
    /// Another packet has the same sender and counter: two vehicles under one number, or one that began again without
    /// its memory. Neither of the two packets counts.
    #[error("another packet of the same sender has counter {counter}")]
    Conflict {
        /// The counter.
        counter: u16,
    },
    /// Farther ahead of all that is known of its sender than packets get lost in a row: it counts once another one
    /// confirms it.
    #[error("counter {counter} is far ahead of {}: one packet alone is not believed", after(*latest))]
    Unconfirmed {
        /// The counter.
        counter: u16,
        /// The largest counter of the sender that is believed, if any is.
        latest: Option<u16>,
    },
    /// It has the vehicle's own number, and the vehicle did not send it: another one goes by that number, or it sent
    /// the packet before it lost its memory. It goes on a window of counters behind.
    #[error("not sent by this vehicle, whose number it has: counter {counter}")]
    OwnNumber {
        /// The counter.
        counter: u16,
    },
    /// A report, or spare bits, with the vehicle's own number that it did not send: another one goes by that number, or it sent
    /// this before it lost its memory. What a report says counts as told.
    #[error("a report not sent by this vehicle, whose number it has")]
    OwnReport,
    /// Said to be sent by this vehicle, which has another number.
    #[error("sent under number {number}, which is not that of this vehicle")]
    NotSentByMe {
        /// The number in the packet.
        number: u8,
    },
    /// Its numbers make no message, because its points coincide.
    #[error("says nothing usable: {0}")]
    Unusable(dgpc::Error),
}

/// What is known of two agreements, in words.
fn numbers(found: Option<u16>, expected: u16) -> String {
    found.map_or_else(
        || ", with this team's key".into(),
        |found| format!(", or damaged: it says number {found}, expected {expected}"),
    )
}

/// The counter that a sender has come to, in words.
fn after(latest: Option<u16>) -> String {
    latest.map_or_else(|| "a sender that was not heard before".into(), |latest| format!("its sender's {latest}"))
}

/// Packets received, by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Count from then on.
    pub accepted: u64,
    /// See [`Refusal::Malformed`] and [`Refusal::NoSlot`].
    pub malformed: u64,
    /// See [`Refusal::Forged`] and [`Refusal::SpareBits`].
    pub forged: u64,
    /// See [`Refusal::OtherTeam`] and [`Refusal::OtherForm`].
    pub other_team: u64,
    /// See [`Refusal::UnknownSender`] and [`Refusal::NoMember`].
    pub unknown_sender: u64,
    /// See [`Refusal::Duplicate`].
    pub duplicate: u64,
    /// See [`Refusal::TooOld`].
    pub too_old: u64,
    /// See [`Refusal::Conflict`].
    pub conflict: u64,
    /// See [`Refusal::Unconfirmed`].
    pub unconfirmed: u64,
    /// See [`Refusal::OwnNumber`].
    pub own_number: u64,
    /// See [`Refusal::Unusable`].
    pub unusable: u64,
}

impl Counts {
    pub(crate) fn count(&mut self, receipt: &Receipt) {
        let counter = match receipt {
            Receipt::Accepted => &mut self.accepted,
            Receipt::Refused(refusal) => self.of(refusal),
        };
        *counter += 1;
    }

    fn of(&mut self, refusal: &Refusal) -> &mut u64 {
        match refusal {
            Refusal::Malformed(_) | Refusal::NoSlot { .. } => &mut self.malformed,
            Refusal::Forged(_) | Refusal::SpareBits => &mut self.forged,
            Refusal::OtherForm { .. } | Refusal::OtherTeam { .. } => &mut self.other_team,
            Refusal::UnknownSender { .. } | Refusal::NoMember { .. } => &mut self.unknown_sender,
            Refusal::Duplicate => &mut self.duplicate,
            Refusal::TooOld => &mut self.too_old,
            Refusal::Conflict { .. } => &mut self.conflict,
            Refusal::Unconfirmed { .. } => &mut self.unconfirmed,
            Refusal::OwnNumber { .. } | Refusal::OwnReport | Refusal::NotSentByMe { .. } => &mut self.own_number,
            Refusal::Unusable(_) => &mut self.unusable,
        }
    }
}
