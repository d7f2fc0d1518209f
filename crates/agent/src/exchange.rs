//! What a vehicle takes in from the water, and what it gives.

use dgpc::spread_out;
use pingmap_packet::{Layout, MapMessage};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::attempt::{Attempt, Kind, Party};
use crate::entry::Entry;
use crate::event::{Event, Link, VehicleId};
use crate::memory::Arrived;
use crate::packets::PacketKey;
use crate::planner::Planner;
use crate::receipt::{Receipt, Refusal};
use crate::wire::Wire;

impl Agent {
    /// Takes in a packet. What it says is in the next prediction. (A time that is not finite is not noted.)
    pub fn receive(&mut self, bytes: &[u8], time_s: f64) -> Receipt {
        let Arrived { sender, receipt } = self.memory.put_in(bytes, None);
        if receipt == Receipt::Accepted {
            sender.into_iter().for_each(|sender| self.note_time(sender, time_s));
        }
        self.counts.count(&receipt);
        receipt
    }

    fn note_time(&mut self, sender: u8, time_s: f64) {
        if time_s.is_finite() {
            let heard_s = self.heard_s.entry(sender).or_insert(time_s);
            *heard_s = heard_s.max(time_s);
        }
    }

    /// Reads a packet of the team without taking it in.
    ///
    /// # Errors
    /// [`Refusal`] for one that is malformed, forged, formed under another agreement, or of no member.
    pub fn read(&self, bytes: &[u8]) -> Result<(&'static Layout, MapMessage), Refusal> {
        self.memory.frames.read(bytes)
    }

    /// The bytes of a message, as this team sends them: sealed if it has a key, else with the digest of what it agreed
    /// on.
    ///
    /// # Errors
    /// As [`MapMessage::encode`].
    pub fn write(&self, layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        self.memory.frames.write(layout, message)
    }

    /// The packet that tells most for a frame of so many bytes (at most the team's), of what is known by the last fit
    /// and the events beside it; `None` where nothing is worth a frame. Fits nothing: whoever has time to
    /// [`Agent::refit`] before does. Whoever may lose its memory writes an [`Agent::snapshot`] or an [`Entry::Sent`]
    /// before the packet leaves: a counter must not be used twice.
    ///
    /// # Errors
    /// [`AgentError::NotAMember`], [`AgentError::CountersUsedUp`], and [`AgentError::Team`] for a frame below 32 bytes.
    pub fn next_packet(&mut self, time_s: f64, frame_bytes: usize) -> Result<Option<Vec<u8>>, AgentError> {
        let sender = self.memory.own.ok_or_else(|| AgentError::NotAMember { id: self.id.clone() })?;
        let layout = self.team().layout(frame_bytes.min(self.team().frame_bytes))?;
        let used_up = || AgentError::CountersUsedUp { id: self.id.clone(), epoch: self.team().epoch };
        let counter = u16::try_from(self.memory.packets.counter_next(sender)).map_err(|_| used_up())?;
        self.update()?;
        let planned = if self.beliefs.nothing_new_in == Some(layout.frame_bytes) {
            None
        } else {
            self.planner(layout)?.packet(&self.beliefs.public)?
        };
        let bytes = match planned {
            Some(planned) => self.write(layout, &MapMessage { sender, counter, model: 0, blocks: planned.blocks })?,
            None => {
                self.beliefs.nothing_new_in = Some(layout.frame_bytes);
                let Some(again) = self.repeat() else { return Ok(None) };
                again
            }
        };
        self.memory.apply(Entry::Sent { number: self.memory.sent_next(), bytes: bytes.clone() })?;
        self.note_time(sender, time_s);
        Ok(Some(bytes))
    }

    /// A packet of its own that was sent again least often, the oldest of these, unless all were sent again often
    /// enough.
    fn repeat(&self) -> Option<Vec<u8>> {
        let (_, least) = self.memory.told().min_by_key(|(_, version)| version.sent.len())?;
        (least.sent.len() <= usize::from(self.team().repeats_max)).then(|| least.packet.bytes.clone())
    }

    /// What it knows, at the places where it could send something of it.
    fn planner<'a>(&'a self, layout: &'a Layout) -> Result<Planner<'a>, AgentError> {
        let (team, attempts) = (self.team(), self.candidates());
        let inputs = self.model().inputs(&attempts)?;
        Ok(Planner { wire: self.wire(), layout, own: &self.beliefs.own, attempts, inputs, worth_nats: team.worth_nats })
    }

    /// What the numbers of a packet of its own mean.
    pub fn wire(&self) -> Wire<'_> {
        self.memory.own.map_or_else(|| self.team().wire(), |number| self.team().wire_of(number))
    }

    /// What its own events tried and it could tell of: those within the grid, of a typical transmitter and kind of message,
    /// spread over time if they are too many.
    pub fn candidates(&self) -> Vec<Attempt> {
        let wire = self.team().wire();
        let held: Vec<&Event> = self.events().filter(|event| wire.holds(&event.link)).collect();
        let spread = spread_out(held.len(), self.team().limits.candidates_max).into_iter();
        let typical = |attempt| Attempt { transmitter: Party::Typical, kind: Kind::Typical, ..attempt };
        spread.map(|place| typical(held[place].attempt())).collect()
    }

    /// The links that a packet speaks of, by sender and counter; those of others too. Nothing for a packet that does
    /// not count.
    pub fn links_of_packets(&self) -> Vec<(VehicleId, u16, Vec<Link>)> {
        let own = self.memory.told().filter_map(|(counter, _)| Some((self.memory.own?, counter)));
        let mut counting: Vec<PacketKey> = own.chain(self.heard()).collect();
        counting.sort_unstable();
        let told = |key: PacketKey| {
            let name = self.team().members.get(&key.0)?.clone();
            let blocks = self.memory.frames.blocks(&self.memory.packets.get(key)?.bytes);
            let said = blocks.iter().flat_map(|block| self.team().wire().attempts(block));
            Some((name, key.1, said.map(|attempt| attempt.link).collect()))
        };
        counting.into_iter().filter_map(told).collect()
    }
}
