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
    sent: &mut [Vec<Transmission>],
    matched: &MatchTable,
) -> BTreeSet<usize> {
    let has_destinations = recorded_by_sender(sent, |sent| sent.destination.is_some());
    let has_kinds = recorded_by_sender(sent, |sent| sent.kind.is_some());
    let mut received = BTreeSet::new();
    for (&(receiver, sender), matches) in matched {
        for (&index, &message) in matches {
            let message = &fleet.vehicles[receiver].messages[&sender][message];
            let sent = &mut sent[sender][index];
            sent.evidence = sent.evidence.min(TransmissionEvidence::Received);
            let destination = || message.destination.clone().filter(|_| !has_destinations[sender]);
            sent.destination = sent.destination.take().or_else(destination);
            sent.kind = sent.kind.take().or_else(|| message.kind.clone().filter(|_| !has_kinds[sender]));
            received.insert((sender, index));
        }
    }
    let mut destinations_by_reception = BTreeSet::new();
    for (sender, all) in sent.iter_mut().enumerate() {
        if !has_destinations[sender] && all.iter().any(|sent| sent.destination.is_some()) {
            let unheard = all.iter_mut().enumerate().filter(|(index, _)| !received.contains(&(sender, *index)));
            unheard.for_each(|(_, sent)| sent.destination_unknown = true);
            let is_any_unknown = all.iter().any(|sent| sent.destination_unknown);
            destinations_by_reception.extend(is_any_unknown.then_some(sender));
        }
        // A kind that only heard messages have would seem to be heard always.
        let lacks_kind =
            |sent: &Transmission| sent.kind.is_none() && sent.evidence != TransmissionEvidence::ScheduledOnly;
        if !has_kinds[sender] && all.iter().any(lacks_kind) {
            all.iter_mut().for_each(|sent| sent.kind = None);
        }
    }
    destinations_by_reception
}

/// Returns for each sender whether any transmission in its own record has a property.
fn recorded_by_sender(sent: &[Vec<Transmission>], has_property: fn(&Transmission) -> bool) -> Vec<bool> {
    let has_recorded = |sent: &Vec<Transmission>| {
        sent.iter().any(|sent| sent.evidence == TransmissionEvidence::Recorded && has_property(sent))
    };
    sent.iter().map(has_recorded).collect()
}

/// Returns the senders with scheduled slots that may have stayed unused.
pub(crate) fn unconfirmed_slot_owners(sent: &[Vec<Transmission>]) -> BTreeSet<usize> {
    let is_unconfirmed = |sent: &Transmission| sent.evidence == TransmissionEvidence::ScheduledOnly;
    (0..sent.len()).filter(|sender| sent[*sender].iter().any(is_unconfirmed)).collect()
}
