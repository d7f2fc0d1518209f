//! The packets that count: of every sender those within a window behind its latest.

use std::collections::BTreeMap;

use dgpc::Summary;

/// A packet by its sender's number and counter.
pub(crate) type PacketKey = (u8, u16);

/// A packet as it came, and what it says.
#[derive(Debug, Clone)]
pub(crate) struct LivePacket {
    pub(crate) bytes: Vec<u8>,
    pub(crate) summaries: Vec<Summary>,
}

/// Live packets. Which packets are live depends on the set of packets that arrived and not on their order or number:
/// putting in is commutative, associative and idempotent. A sender forms its packets against its own last ones in the
/// same window, so that whatever a receiver drops is said again in time.
#[derive(Debug, Clone)]
pub(crate) struct LivePackets {
    per_sender_max: u16,
    packets: BTreeMap<PacketKey, LivePacket>,
}

impl LivePackets {
    /// None yet; at most so many of every sender.
    pub(crate) fn new(per_sender_max: u16) -> Self {
        Self { per_sender_max: per_sender_max.max(1), packets: BTreeMap::new() }
    }

    /// Puts in a packet that is neither there nor too old; whether older ones of its sender had to go for it.
    pub(crate) fn insert(&mut self, key: PacketKey, packet: LivePacket) -> bool {
        self.packets.insert(key, packet);
        let old: Vec<PacketKey> = self.of(key.0).map(|(&key, _)| key).filter(|&key| self.is_too_old(key)).collect();
        old.iter().for_each(|key| drop(self.packets.remove(key)));
        !old.is_empty()
    }

    /// Whether a packet like this is there.
    pub(crate) fn contains(&self, key: PacketKey) -> bool {
        self.packets.contains_key(&key)
    }

    /// Whether it has fallen out of the window behind its sender's latest packet.
    pub(crate) fn is_too_old(&self, (sender, counter): PacketKey) -> bool {
        self.latest(sender).is_some_and(|latest| u32::from(counter) + u32::from(self.per_sender_max) <= latest.into())
    }

    /// The packets of one sender, in the order of sending.
    pub(crate) fn of(&self, sender: u8) -> impl DoubleEndedIterator<Item = (&PacketKey, &LivePacket)> {
        self.packets.range((sender, 0)..=(sender, u16::MAX))
    }

    fn latest(&self, sender: u8) -> Option<u16> {
        self.of(sender).next_back().map(|(&(_, counter), _)| counter)
    }

    /// All, by sender and counter.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&PacketKey, &LivePacket)> {
        self.packets.iter()
    }

    pub(crate) fn get(&self, key: PacketKey) -> Option<&LivePacket> {
        self.packets.get(&key)
    }

    pub(crate) fn len(&self) -> usize {
        self.packets.len()
    }
}
