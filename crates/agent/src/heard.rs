//! What was heard of others and counts.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use dgpc::Summary;

use crate::memory::Memory;
use crate::packets::{Packet, PacketKey};
use crate::placing::ToldEvents;
use crate::reports::Worth;

/// Packets by sender and counter, and what each of them counts for.
pub(crate) type Packets = BTreeMap<PacketKey, Worth>;

/// What was heard of others and counts: packets, and events that they told.
#[derive(Debug, Clone, Default)]
pub(crate) struct Heard {
    pub(crate) packets: Packets,
    pub(crate) told: Arc<ToldEvents>,
}

impl Heard {
    /// All that a vehicle heard of members that it listens to.
    pub(crate) fn of(memory: &Memory, muted: &BTreeSet<u8>) -> Self {
        let packets = memory.heard().filter(|(sender, _)| !muted.contains(sender));
        let all = Self { packets: counting(memory, packets), told: memory.placed().events.clone() };
        all.without(muted)
    }

    /// The same but for what these members say.
    pub(crate) fn without(&self, members: &BTreeSet<u8>) -> Self {
        if members.is_empty() {
            return self.clone();
        }
        self.part(|member| !members.contains(&member))
    }

    /// What one member says.
    pub(crate) fn of_member(&self, member: u8) -> Self {
        self.part(|other| other == member)
    }

    fn part(&self, is_wanted: impl Fn(u8) -> bool) -> Self {
        let packets = self.packets.iter().filter(|(key, _)| is_wanted(key.0));
        let told = match self.told.keys().all(|key| is_wanted(key.0)) {
            true => self.told.clone(),
            false => {
                let told = self.told.iter().filter(|(key, _)| is_wanted(key.0));
                Arc::new(told.map(|(&key, event)| (key, event.clone())).collect())
            }
        };
        Self { packets: packets.map(|(&key, &worth)| (key, worth)).collect(), told }
    }

    /// Who says something, but for the vehicle itself.
    pub(crate) fn others(&self, own: Option<u8>) -> BTreeSet<u8> {
        let all = self.packets.keys().map(|key| key.0).chain(self.told.keys().map(|key| key.0));
        all.filter(|&member| Some(member) != own).collect()
    }
}

/// Those of these packets that count, and for what.
pub(crate) fn counting(memory: &Memory, packets: impl Iterator<Item = PacketKey>) -> Packets {
    let latest = |sender| memory.packets.latest(sender).unwrap_or_default();
    packets
        .map(|key| (key, memory.reports.worth(key, latest(key.0))))
        .filter(|&(_, worth)| worth > Worth::Nothing)
        .collect()
}

/// Those of these packets that are worth so much.
pub(crate) fn said(memory: &Memory, packets: &Packets, worth: Worth) -> Vec<Arc<Packet>> {
    let wanted = packets.iter().filter(|(_, found)| **found == worth);
    wanted.filter_map(|(&key, _)| memory.packets.get(key).cloned()).collect()
}

/// What packets say.
pub(crate) fn summaries(packets: &[Arc<Packet>]) -> Vec<&Summary> {
    packets.iter().flat_map(|packet| &packet.summaries).collect()
}
