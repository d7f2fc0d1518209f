//! The packets that a vehicle remembers, and which of them count.

use std::collections::BTreeMap;
use std::sync::Arc;

use dgpc::Summary;

/// A packet by its sender's number and counter.
pub(crate) type PacketKey = (u8, u16);

/// A counter farther than this ahead of all that is believed of its sender waits for another packet within the same
/// distance: one stray packet must not make all that follow it look old.
pub const COUNTER_LEAP_MAX: u16 = 1024;

/// A packet as it came, and what it says.
#[derive(Debug)]
pub(crate) struct Packet {
    pub(crate) bytes: Vec<u8>,
    pub(crate) summaries: Vec<Summary>,
    /// The longest link that it speaks of; 0 where it speaks of none.
    pub(crate) longest_m: f64,
}

/// What became of a packet that was put in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// It counts.
    New,
    /// It was there.
    Known,
    /// Another one has its counter: neither counts.
    Conflict,
    /// It is far ahead of its sender's latest, and counts once another packet confirms it.
    Unconfirmed,
    /// It has fallen out of the window behind its sender's latest.
    TooOld,
}

/// That the vehicle sent a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Departure {
    /// Its number among all that it sent.
    pub(crate) number: u64,
    /// In which slot of its own, where that is known.
    pub(crate) slot: Option<u32>,
}

/// When the vehicle sent a frame: slots by numbers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Sent(BTreeMap<u64, Option<u32>>);

impl Sent {
    /// Notes that it was sent. Of two slots under one number the later one, of whatever is said in any order.
    pub(crate) fn note(&mut self, sent: Option<Departure>) {
        if let Some(Departure { number, slot }) = sent {
            let known = self.0.entry(number).or_insert(slot);
            *known = slot.max(*known);
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = Departure> {
        self.0.iter().map(|(&number, &slot)| Departure { number, slot })
    }

    pub(crate) fn last_number(&self) -> Option<u64> {
        self.0.last_key_value().map(|(&number, _)| number)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }
}

impl From<Option<Departure>> for Sent {
    fn from(sent: Option<Departure>) -> Self {
        Self(sent.map(|Departure { number, slot }| (number, slot)).into_iter().collect())
    }
}

/// One packet under some counter, and when the vehicle sent it, if it did.
#[derive(Debug, Clone)]
pub(crate) struct Version {
    pub(crate) packet: Arc<Packet>,
    pub(crate) sent: Sent,
}

/// What is remembered of one sender.
#[derive(Debug, Clone, Default)]
struct Sender {
    /// The largest counter that is believed.
    latest: Option<u16>,
    /// By counter; of different packets with one counter, the first two in the order of their bytes.
    versions: BTreeMap<u16, Vec<Version>>,
}

/// Packets. Which are there and which of them count depends on the set of those that arrived and not on their order or
/// number: putting in is commutative, associative and idempotent. Of every sender those count that lie in a window
/// behind its latest; it forms its packets against its own last ones in the same window, so that whatever a receiver
/// drops is said again in time.
#[derive(Debug, Clone)]
pub(crate) struct Packets {
    window: u16,
    senders: BTreeMap<u8, Sender>,
}

impl Packets {
    /// None yet; at most so many of every sender will count.
    pub(crate) fn new(window: u16) -> Self {
        Self { window: window.max(1), senders: BTreeMap::new() }
    }

    /// Puts in a packet, heard or sent by the vehicle.
    pub(crate) fn insert(&mut self, (sender, counter): PacketKey, packet: Packet, sent: Option<Departure>) -> Arrival {
        let window = self.window;
        self.senders.entry(sender).or_default().insert(counter, packet, sent, window)
    }

    /// The packets of one sender that count, in the order of sending.
    pub(crate) fn believed(&self, sender: u8) -> impl Iterator<Item = (u16, &Version)> {
        self.senders.get(&sender).into_iter().flat_map(Sender::believed)
    }

    /// The packet with this name, if it counts.
    pub(crate) fn get(&self, (sender, counter): PacketKey) -> Option<&Arc<Packet>> {
        let sender = self.senders.get(&sender)?;
        match sender.versions.get(&counter).map(Vec::as_slice) {
            Some([version]) if Some(counter) <= sender.latest => Some(&version.packet),
            _ => None,
        }
    }

    /// Senders of which something is remembered.
    pub(crate) fn senders(&self) -> impl Iterator<Item = u8> {
        self.senders.keys().copied()
    }

    /// Everything of one sender that is remembered, whether it counts or not.
    pub(crate) fn all(&self, sender: u8) -> impl Iterator<Item = &Version> {
        self.senders.get(&sender).into_iter().flat_map(|sender| sender.versions.values().flatten())
    }

    /// How many counters of a sender stand on different packets at present.
    pub(crate) fn conflicts(&self, sender: u8) -> usize {
        self.senders
            .get(&sender)
            .map_or(0, |sender| sender.versions.values().filter(|versions| versions.len() > 1).count())
    }

    /// The largest counter of a sender that is believed.
    pub(crate) fn latest(&self, sender: u8) -> Option<u16> {
        self.senders.get(&sender)?.latest
    }

    /// Believes that a sender has come so far, as a snapshot says.
    pub(crate) fn reach(&mut self, sender: u8, latest: u16) {
        let window = self.window;
        let sender = self.senders.entry(sender).or_default();
        sender.latest = sender.latest.max(Some(latest));
        sender.settle(window);
    }

    /// Of the vehicle's own number: the largest believed counter of a packet that it did not send, which another
    /// vehicle did, or itself before it lost its memory.
    pub(crate) fn strange(&self, own: u8) -> Option<u16> {
        let sender = self.senders.get(&own)?;
        let strange = |(&counter, versions): (&u16, &Vec<Version>)| {
            versions.iter().any(|version| version.sent.is_empty()).then_some(counter)
        };
        sender.versions.range(..=sender.latest?).rev().find_map(strange)
    }

    /// The counter of the vehicle's next packet: behind its latest, and a whole window behind packets under its number
    /// that it did not send, so that everybody has forgotten those when it speaks again.
    pub(crate) fn counter_next(&self, own: u8) -> u32 {
        let behind = self.latest(own).map_or(0, |latest| u32::from(latest) + 1);
        let strange = self.strange(own).map_or(0, |strange| u32::from(strange) + u32::from(self.window));
        behind.max(strange)
    }
}

impl Sender {
    fn insert(&mut self, counter: u16, packet: Packet, sent: Option<Departure>, window: u16) -> Arrival {
        if self.is_too_old(counter, window) {
            return Arrival::TooOld;
        }
        let versions = self.versions.entry(counter).or_default();
        let known = versions.iter_mut().find(|version| version.packet.bytes == packet.bytes);
        let is_known = known.is_some();
        match known {
            Some(version) => version.sent.note(sent),
            None => {
                versions.push(Version { packet: Arc::new(packet), sent: sent.into() });
                versions.sort_by(|a, b| a.packet.bytes.cmp(&b.packet.bytes));
                versions.truncate(2);
            }
        }
        let is_conflict = versions.len() > 1;
        // What the vehicle sent itself needs nobody's confirmation.
        if sent.is_some() {
            self.latest = self.latest.max(Some(counter));
        }
        self.settle(window);
        match self.latest {
            _ if is_known => Arrival::Known,
            _ if is_conflict => Arrival::Conflict,
            Some(latest) if counter <= latest => Arrival::New,
            _ => Arrival::Unconfirmed,
        }
    }

    /// Believes what has come within reach, and forgets what has fallen out of the window.
    fn settle(&mut self, window: u16) {
        let waiting: Vec<u16> = match self.latest {
            Some(latest) => self.versions.range(latest.saturating_add(1)..).map(|(&counter, _)| counter).collect(),
            None => self.versions.keys().copied().collect(),
        };
        for (place, &counter) in waiting.iter().enumerate() {
            // Nothing believed is as good as a packet before the first.
            let begin = self.latest.map_or(0, |latest| u32::from(latest) + 1);
            let is_near = u32::from(counter) < begin + u32::from(COUNTER_LEAP_MAX);
            let is_confirmed = waiting.get(place + 1).is_some_and(|next| next - counter <= COUNTER_LEAP_MAX);
            if is_near || is_confirmed {
                self.latest = self.latest.max(Some(counter));
            }
        }
        while let Some(entry) = self.versions.first_entry()
            && self.latest.is_some_and(|latest| u32::from(*entry.key()) + u32::from(window) <= latest.into())
        {
            entry.remove();
        }
    }

    fn is_too_old(&self, counter: u16, window: u16) -> bool {
        self.latest.is_some_and(|latest| u32::from(counter) + u32::from(window) <= latest.into())
    }

    fn believed(&self) -> impl Iterator<Item = (u16, &Version)> {
        let reached = self.versions.iter().filter(|(counter, _)| Some(**counter) <= self.latest);
        reached.filter_map(|(&counter, versions)| match versions.as_slice() {
            [version] => Some((counter, version)),
            _ => None,
        })
    }
}
