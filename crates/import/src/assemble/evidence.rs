//! Completion of transmissions by the receptions that match them.

use std::collections::BTreeSet;

use crate::assemble::matching::MatchTable;
use crate::assemble::vehicles::fleet::Fleet;
use crate::assemble::vehicles::transmission::{Transmission, TransmissionEvidence};

/// Raises the evidence of received transmissions, and fills in destinations and kinds that the sender did not record.
///
/// A destination from a reception holds for all receivers, so that exclusion by destination does not depend on the
/// outcome. Returns the senders whose destinations only receptions state. Their transmissions without a reception may
/// have had any destination.
pub(crate) fn complete_from_receptions(
    fleet: &Fleet,
    transmissions: &mut [Vec<Transmission>],
    matched: &MatchTable,
) -> BTreeSet<usize> {
    let has_destinations = recorded_by_sender(transmissions, |transmission| transmission.destination.is_some());
    let has_kinds = recorded_by_sender(transmissions, |transmission| transmission.kind.is_some());
    let mut received = BTreeSet::new();
    for (&(receiver, sender), matches) in matched {
        for (&index, &message) in matches {
            let message = &fleet.vehicles[receiver].messages[&sender][message];
            let transmission = &mut transmissions[sender][index];
            transmission.evidence = transmission.evidence.min(TransmissionEvidence::Received);
            let destination = || message.destination.clone().filter(|_| !has_destinations[sender]);
            transmission.destination = transmission.destination.take().or_else(destination);
            transmission.kind =
                transmission.kind.take().or_else(|| message.kind.clone().filter(|_| !has_kinds[sender]));
            received.insert((sender, index));
        }
    }
    let mut undocumented_destinations = BTreeSet::new();
    for (sender, sender_transmissions) in transmissions.iter_mut().enumerate() {
        if !has_destinations[sender]
            && sender_transmissions.iter().any(|transmission| transmission.destination.is_some())
        {
            let unreceived =
                sender_transmissions.iter_mut().enumerate().filter(|(index, _)| !received.contains(&(sender, *index)));
            unreceived.for_each(|(_, transmission)| transmission.destination_unknown = true);
            let is_any_unknown = sender_transmissions.iter().any(|transmission| transmission.destination_unknown);
            undocumented_destinations.extend(is_any_unknown.then_some(sender));
        }
        // A kind that only heard messages have would seem to be heard always.
        let lacks_kind = |transmission: &Transmission| {
            transmission.kind.is_none() && transmission.evidence != TransmissionEvidence::UnconfirmedSlot
        };
        if !has_kinds[sender] && sender_transmissions.iter().any(lacks_kind) {
            sender_transmissions.iter_mut().for_each(|transmission| transmission.kind = None);
        }
    }
    undocumented_destinations
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
    let is_unconfirmed = |transmission: &Transmission| transmission.evidence == TransmissionEvidence::UnconfirmedSlot;
    (0..transmissions.len()).filter(|sender| transmissions[*sender].iter().any(is_unconfirmed)).collect()
}
