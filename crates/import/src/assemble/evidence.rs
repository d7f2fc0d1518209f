//! Completion of transmissions by the receptions that match them.

use std::collections::BTreeSet;

use crate::assemble::matching::MatchTable;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Transmission, TransmissionEvidence};

/// Records the witnesses of each transmission, and fills in kinds that the sender did not record.
pub(crate) fn complete_from_receptions(fleet: &Fleet, transmissions: &mut [Vec<Transmission>], matched: &MatchTable) {
    let has_kinds = recorded_by_sender(transmissions, |transmission| transmission.kind.is_some());
    for (&(receiver, sender), matches) in matched {
        for (&index, &message) in &matches.assigned {
            let message = &fleet.vehicles[receiver].messages[&sender][message];
            let transmission = &mut transmissions[sender][index];
            transmission.witnesses.insert(receiver, message.destination.clone());
            transmission.kind =
                transmission.kind.take().or_else(|| message.kind.clone().filter(|_| !has_kinds[sender]));
        }
    }
    for (sender, sender_transmissions) in transmissions.iter_mut().enumerate() {
        // A kind that only heard messages have would seem to be heard always.
        let lacks_kind = |transmission: &Transmission| {
            transmission.kind.is_none() && transmission.total_evidence() != TransmissionEvidence::UnconfirmedSlot
        };
        if !has_kinds[sender] && sender_transmissions.iter().any(lacks_kind) {
            sender_transmissions.iter_mut().for_each(|transmission| transmission.kind = None);
        }
    }
}

/// Returns the senders whose destinations only receptions state. Their transmissions without a reception may have had
/// any destination.
pub(crate) fn undocumented_destinations(transmissions: &[Vec<Transmission>]) -> BTreeSet<usize> {
    let has_destinations = recorded_by_sender(transmissions, |transmission| transmission.destination.is_some());
    let is_addressed = |transmission: &Transmission| transmission.witnesses.values().any(Option::is_some);
    let addresses_by_reception =
        |sender: &usize| !has_destinations[*sender] && transmissions[*sender].iter().any(is_addressed);
    (0..transmissions.len()).filter(addresses_by_reception).collect()
}

/// Returns for each sender whether any transmission in its own record has a property.
fn recorded_by_sender(transmissions: &[Vec<Transmission>], has_property: fn(&Transmission) -> bool) -> Vec<bool> {
    let has_recorded = |transmissions: &Vec<Transmission>| {
        transmissions
            .iter()
            .any(|transmission| transmission.evidence == TransmissionEvidence::Recorded && has_property(transmission))
    };
    transmissions.iter().map(has_recorded).collect()
}

/// Returns the senders with scheduled slots that may have stayed unused.
pub(crate) fn unconfirmed_slot_owners(transmissions: &[Vec<Transmission>]) -> BTreeSet<usize> {
    let is_unconfirmed =
        |transmission: &Transmission| transmission.total_evidence() == TransmissionEvidence::UnconfirmedSlot;
    (0..transmissions.len()).filter(|sender| transmissions[*sender].iter().any(is_unconfirmed)).collect()
}
