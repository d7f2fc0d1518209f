//! The memory of a vehicle as a set of entries.

use crate::store::entry::Entry;
use crate::store::memory::Memory;
use crate::store::packets::{Transmission, Transmissions};
use crate::store::reports::{EVERY_SLOT, ReportedOutcome};

impl Memory {
    /// Returns the content as entries. Applied to an empty memory they give an equal memory, except for the latest
    /// counters of senders and the clock: see [`Packets::advance_to`] and [`Memory::advance_clock`].
    pub(crate) fn entries(&self) -> impl Iterator<Item = Entry> {
        let events = self.events.recorded().iter();
        let observed =
            events.map(|recorded| Entry::Observed { number: recorded.number, event: recorded.event.clone() });
        let versions = self.packets.senders().flat_map(|sender| self.packets.all(sender));
        let frames = versions.flat_map(|version| frame_entries(&version.packet.bytes, &version.sent));
        let navigated = self.fixes.iter().map(|&(time_s, position)| Entry::Navigated { time_s, position });
        let reports = self.reports.senders().flat_map(|sender| self.reports.all(sender));
        let reports = reports.flat_map(|stored| frame_entries(&stored.report.bytes, &stored.sent));
        observed
            .chain(navigated)
            .chain(frames)
            .chain(reports)
            .chain(self.piggyback_entries())
            .chain(self.unused_slot_entries())
            .chain(self.outcome_entries())
            .chain(self.peer_position_entries())
            .chain(self.clock.waiting().cloned())
    }

    fn unused_slot_entries(&self) -> impl Iterator<Item = Entry> {
        let unused = self.reports.senders();
        let unused = unused.flat_map(|number| self.reports.unused(number, EVERY_SLOT).map(move |slot| (number, slot)));
        unused.filter_map(|(number, slot)| {
            Some(Entry::UnusedSlot { sender: self.codec.team.members.get(&number)?.clone(), slot })
        })
    }

    fn outcome_entries(&self) -> impl Iterator<Item = Entry> {
        self.outcomes.iter().map(|outcome| Entry::Outcome {
            time_s: outcome.time_s.0,
            transmitter_id: outcome.transmitter_id.clone(),
            success: outcome.success,
        })
    }

    fn peer_position_entries(&self) -> impl Iterator<Item = Entry> {
        self.peers.iter().filter_map(|(number, time_s, position, is_independent)| {
            let member = self.codec.team.members.get(&number)?.clone();
            Some(Entry::PeerPosition { member, time_s, position, is_independent })
        })
    }

    /// Returns the entry of the frame with a transmission number, if it is stored.
    pub(crate) fn frame_sent_as(&self, number: u64) -> Option<Entry> {
        self.own_frames().find_map(|(bytes, sent)| {
            let Transmission { state, slot, .. } = sent.iter().find(|sent| sent.number == number)?;
            Some(Entry::Sent { number, state, slot, bytes: bytes.clone() })
        })
    }

    /// Returns the piggybacked outcomes: one entry for each slot and outcome.
    fn piggyback_entries(&self) -> impl Iterator<Item = Entry> {
        let all = self.reports.senders();
        let all = all.flat_map(|number| self.reports.piggybacked(number).map(move |outcome| (number, outcome)));
        all.flat_map(move |(number, (newest, outcome))| {
            let both = [(ReportedOutcome::Missed, false), (ReportedOutcome::Heard, true)].into_iter();
            let reported = both.filter(move |(one, _)| outcome == *one || outcome == ReportedOutcome::Contradictory);
            reported.filter_map(move |(_, heard)| {
                let sender = self.codec.team.members.get(&number)?.clone();
                Some(Entry::Piggyback { sender, newest, outcomes: vec![heard] })
            })
        })
    }
}

/// Returns the entries of a frame: one for each transmission by the vehicle, or a single one for a received frame.
fn frame_entries(bytes: &[u8], sent: &Transmissions) -> impl Iterator<Item = Entry> {
    let received = sent.is_empty().then(|| Entry::Received { time_s: None, bytes: bytes.to_vec() });
    let as_sent = |Transmission { number, state, slot }| Entry::Sent { number, state, slot, bytes: bytes.to_vec() };
    received.into_iter().chain(sent.iter().map(as_sent))
}
