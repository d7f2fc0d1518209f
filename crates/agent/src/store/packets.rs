//! The summary packets that a vehicle stores, and the rules by which they count.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::codec::decoded::{Packet, PacketKey};
use crate::codec::receipt::Refusal;
use crate::store::entry::FrameState;

/// A transmission of a frame by the vehicle itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Transmission {
    /// Number of frames proposed before it.
    pub(crate) number: u64,
    pub(crate) state: FrameState,
    /// Own slot of the transmission, if known.
    pub(crate) slot: Option<u32>,
}

/// The transmissions of one frame: states and slots by transmission number.
#[derive(Debug, Clone, Default)]
pub(crate) struct Transmissions(BTreeMap<u64, (FrameState, Option<u32>)>);

impl Transmissions {
    /// Adds a transmission. If one number has several states, the latest state counts, and of this state the latest
    /// slot, whatever the order.
    pub(crate) fn add(&mut self, sent: Option<Transmission>) {
        if let Some(Transmission { number, state, slot }) = sent {
            let stored = self.0.entry(number).or_insert((state, slot));
            *stored = (state, slot).max(*stored);
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = Transmission> {
        self.0.iter().map(|(&number, &(state, slot))| Transmission { number, state, slot })
    }

    /// Returns the transmissions that may have left the vehicle.
    pub(crate) fn undropped(&self) -> impl Iterator<Item = Transmission> {
        self.iter().filter(|sent| sent.state != FrameState::Dropped)
    }

    pub(crate) fn last_number(&self) -> Option<u64> {
        self.0.last_key_value().map(|(&number, _)| number)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// A packet and its transmissions by the vehicle itself. One counter may have two versions.
#[derive(Debug, Clone)]
pub(crate) struct Version {
    pub(crate) packet: Arc<Packet>,
    pub(crate) sent: Transmissions,
}

#[derive(Debug, Clone, Default)]
struct Sender {
    latest: Option<u16>,
    /// Packets by counter. If different packets have one counter, the first two in the order of their bytes are stored.
    versions: BTreeMap<u16, Vec<Version>>,
}

/// The stored packets by sender.
///
/// The packets of a sender that lie in a window up to its latest counter count. [`Clock`](crate::store::clock::Clock)
/// bounds the counters. A sender forms each packet against its own packets in the same window. The content of packets
/// that a receiver drops is therefore sent again.
#[derive(Debug, Clone)]
pub(crate) struct Packets {
    window: u16,
    senders: BTreeMap<u8, Sender>,
}

impl Packets {
    /// Creates an empty store. At most `window` packets of each sender will count.
    pub(crate) fn new(window: u16) -> Self {
        Self { window: window.max(1), senders: BTreeMap::new() }
    }

    /// Inserts a packet that was received, or transmitted by the vehicle itself.
    ///
    /// # Errors
    /// [`Refusal`] for a packet that does not count because of others. If two packets have one counter, neither counts.
    pub(crate) fn insert(
        &mut self,
        (sender, counter): PacketKey,
        packet: Packet,
        sent: Option<Transmission>,
    ) -> Result<(), Refusal> {
        let sender = self.senders.entry(sender).or_default();
        if sender.is_too_old(counter, self.window) {
            return Err(Refusal::TooOld);
        }
        let versions = sender.versions.entry(counter).or_default();
        let stored = versions.iter_mut().find(|version| version.packet.bytes == packet.bytes);
        let is_duplicate = stored.is_some();
        match stored {
            Some(version) => version.sent.add(sent),
            None => {
                let mut version = Version { packet: Arc::new(packet), sent: Transmissions::default() };
                version.sent.add(sent);
                versions.push(version);
                versions.sort_by(|a, b| a.packet.bytes.cmp(&b.packet.bytes));
                versions.truncate(2);
            }
        }
        let is_conflict = versions.len() > 1;
        sender.advance_to(counter, self.window);
        match (is_duplicate, is_conflict) {
            (true, _) => Err(Refusal::Duplicate),
            (false, true) => Err(Refusal::Conflict(counter)),
            (false, false) => Ok(()),
        }
    }

    /// Returns the packets of one sender that count, in the order of their counters.
    pub(crate) fn accepted(&self, sender: u8) -> impl Iterator<Item = (u16, &Version)> {
        let versions = self.senders.get(&sender).into_iter().flat_map(|sender| &sender.versions);
        versions.filter_map(|(&counter, versions)| match versions.as_slice() {
            [version] => Some((counter, version)),
            _ => None,
        })
    }

    /// Returns the packet with this key, if it counts.
    pub(crate) fn get(&self, (sender, counter): PacketKey) -> Option<&Arc<Packet>> {
        let sender = self.senders.get(&sender)?;
        match sender.versions.get(&counter).map(Vec::as_slice) {
            Some([version]) => Some(&version.packet),
            _ => None,
        }
    }

    /// Returns all senders with stored packets or a latest counter.
    pub(crate) fn senders(&self) -> impl Iterator<Item = u8> {
        self.senders.keys().copied()
    }

    /// Returns all stored packets of one sender, whether they count or not.
    pub(crate) fn all(&self, sender: u8) -> impl Iterator<Item = &Version> {
        self.senders.get(&sender).into_iter().flat_map(|sender| sender.versions.values().flatten())
    }

    /// Returns the number of counters of a sender that have two different packets.
    pub(crate) fn conflicts(&self, sender: u8) -> usize {
        let versions = self.senders.get(&sender).into_iter().flat_map(|sender| sender.versions.values());
        versions.filter(|versions| versions.len() > 1).count()
    }

    pub(crate) fn latest(&self, sender: u8) -> Option<u16> {
        self.senders.get(&sender)?.latest
    }

    /// Advances the latest counter of a sender to `latest`, for a counter from a snapshot.
    pub(crate) fn advance_to(&mut self, sender: u8, latest: u16) {
        self.senders.entry(sender).or_default().advance_to(latest, self.window);
    }

    /// Returns the largest counter of a packet that has the vehicle's own number but that the vehicle did not send.
    /// Another vehicle sent it, or this vehicle did before it lost its memory.
    pub(crate) fn foreign_counter(&self, own: u8) -> Option<u16> {
        let sender = self.senders.get(&own)?;
        let foreign = |(&counter, versions): (&u16, &Vec<Version>)| {
            versions.iter().any(|version| version.sent.is_empty()).then_some(counter)
        };
        sender.versions.iter().rev().find_map(foreign)
    }

    /// Returns the counter of the vehicle's next packet. It is above its latest counter. It is at least a full window
    /// above [`Packets::foreign_counter`], so that every receiver has then forgotten the foreign packets.
    pub(crate) fn next_counter(&self, own: u8) -> u32 {
        let after_latest = self.latest(own).map_or(0, |latest| u32::from(latest) + 1);
        let after_foreign = self.foreign_counter(own).map_or(0, |foreign| u32::from(foreign) + u32::from(self.window));
        after_latest.max(after_foreign)
    }
}

impl Sender {
    /// Advances the latest counter, and removes packets before the window.
    fn advance_to(&mut self, counter: u16, window: u16) {
        self.latest = self.latest.max(Some(counter));
        while self.versions.keys().next().is_some_and(|&counter| self.is_too_old(counter, window)) {
            self.versions.pop_first();
        }
    }

    fn is_too_old(&self, counter: u16, window: u16) -> bool {
        self.latest.is_some_and(|latest| u32::from(counter) + u32::from(window) <= latest.into())
    }
}
