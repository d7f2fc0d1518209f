//! The data of other members that count: their summaries and located events.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::{Prior, Summary};

use crate::codec::decoded::{Packet, PacketKey};
use crate::store::event_location::RemoteEvents;
use crate::store::memory::Memory;

#[derive(Debug, Clone, Default)]
pub(crate) struct AcceptedData {
    pub(crate) packets: Arc<BTreeSet<PacketKey>>,
    pub(crate) events: Arc<RemoteEvents>,
}

impl AcceptedData {
    /// Returns the data of all members that are not muted.
    pub(crate) fn new(memory: &Memory) -> Self {
        let all =
            Self { packets: Arc::new(memory.packets_of_others().collect()), events: memory.located().events.clone() };
        all.without(&memory.muted)
    }

    pub(crate) fn without(&self, members: &BTreeSet<u8>) -> Self {
        if members.is_empty() {
            return self.clone();
        }
        self.filtered(|member| !members.contains(&member))
    }

    pub(crate) fn of_member(&self, member: u8) -> Self {
        self.filtered(|other| other == member)
    }

    fn filtered(&self, is_wanted: impl Fn(u8) -> bool) -> Self {
        let events = match self.events.keys().all(|key| is_wanted(key.0)) {
            true => self.events.clone(),
            false => {
                let wanted = self.events.iter().filter(|(key, _)| is_wanted(key.0));
                Arc::new(wanted.map(|(&key, event)| (key, event.clone())).collect())
            }
        };
        let packets = self.packets.iter().copied().filter(|key| is_wanted(key.0));
        Self { packets: Arc::new(packets.collect()), events }
    }

    /// Returns the members with any data, without the vehicle itself.
    pub(crate) fn members(&self, own: Option<u8>) -> BTreeSet<u8> {
        let all = self.packets.iter().map(|key| key.0).chain(self.events.keys().map(|key| key.0));
        all.filter(|&member| Some(member) != own).collect()
    }
}

pub(crate) fn packets_with<'a>(memory: &Memory, keys: impl IntoIterator<Item = &'a PacketKey>) -> Vec<Arc<Packet>> {
    keys.into_iter().filter_map(|&key| memory.packets.get(key).cloned()).collect()
}

/// Returns the summaries in some packets, as messages under another prior.
pub(crate) fn summaries_under<'a>(packets: &'a [Arc<Packet>], prior: &Prior) -> dgpc::Result<Vec<Cow<'a, Summary>>> {
    summaries(packets).into_iter().map(|summary| summary.read_under(prior)).collect()
}

pub(crate) fn summaries(packets: &[Arc<Packet>]) -> Vec<&Summary> {
    packets.iter().flat_map(|packet| &packet.summaries).collect()
}
