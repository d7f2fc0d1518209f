//! Receives frames of other members.

use crate::agent::state::Agent;
use crate::codec::decoded::PacketKey;
use crate::codec::receipt::Receipt;
use crate::store::entry::Entry;
use crate::store::memory::Effect;
use crate::types::event::{Link, VehicleId};

/// The result of [`Agent::receive`] and [`Agent::receive_piggyback`].
#[derive(Debug, Clone, PartialEq)]
pub struct Reception {
    /// Whether the content counts.
    pub receipt: Receipt,
    /// Entry for the journal of the host. `None` for content that is not stored.
    pub entry: Option<Entry>,
}

impl Agent {
    /// Receives a frame. The next prediction uses its content. `time_s` is the present time, which advances the
    /// vehicle's clock; `None` if it is unknown. A frame that is more than ten minutes or two cycles ahead of the clock
    /// waits for it. O(log N + length).
    pub fn receive(&mut self, bytes: &[u8], time_s: Option<f64>) -> Reception {
        self.advance_clock(time_s);
        let effect = self.memory.insert_frame(bytes, None).unwrap_or_else(Effect::refused);
        *self.counts.entry(effect.receipt.class()).or_default() += 1;
        if effect.receipt == Receipt::Accepted {
            effect.sender.into_iter().for_each(|sender| self.note_time(sender, time_s));
        }
        let receipt = self.note_effect(effect);
        let entry = receipt.is_stored().then(|| Entry::Received { time_s, bytes: bytes.to_vec() });
        Reception { receipt, entry }
    }

    pub(crate) fn note_time(&mut self, sender: u8, time_s: Option<f64>) {
        if let Some(time_s) = time_s.filter(|time_s| time_s.is_finite()) {
            let last_s = self.last_heard_s.entry(sender).or_insert(time_s);
            *last_s = last_s.max(time_s);
        }
    }

    /// Returns the links of the inducing points in each summary packet that counts, by sender and counter.
    pub fn links_of_packets(&self) -> Vec<(VehicleId, u16, Vec<Link>)> {
        let mut keys: Vec<PacketKey> =
            self.memory.own_packets().chain(self.accepted().packets.iter().copied()).collect();
        keys.sort_unstable();
        let links = |key: PacketKey| {
            let name = self.team().members.get(&key.0)?.clone();
            let blocks = self.memory.codec.blocks(&self.memory.packets.get(key)?.bytes);
            let queries = blocks.iter().flat_map(|block| self.team().quantizer().queries(block));
            Some((name, key.1, queries.map(|query| query.link).collect()))
        };
        keys.into_iter().filter_map(links).collect()
    }
}
