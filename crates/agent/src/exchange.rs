//! What a vehicle takes in from the water, and what it gives.

use dgpc::Summary;
use pingmap_packet::{Layout, MapMessage, Seal, digest};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::event::{Link, VehicleId};
use crate::live::{LivePacket, PacketKey};
use crate::planner::Planner;
use crate::receipt::{Receipt, Refusal};

impl Agent {
    /// Takes in a packet. What it says is in the next prediction.
    pub fn receive(&mut self, bytes: &[u8], time_s: f64) -> Receipt {
        let receipt = match self.take_in(bytes) {
            Ok(sender) => {
                let heard_s = self.heard_s.entry(sender).or_insert(time_s);
                *heard_s = heard_s.max(time_s);
                Receipt::Accepted
            }
            Err(refusal) => Receipt::Refused(refusal),
        };
        self.counts.count(&receipt);
        receipt
    }

    /// Reads a packet of the team without taking it in.
    ///
    /// # Errors
    /// [`Refusal`] for one that is malformed, forged, formed under another agreement, or of no member.
    pub fn read(&self, bytes: &[u8]) -> Result<(&'static Layout, MapMessage), Refusal> {
        let (layout, message) = MapMessage::decode(bytes, self.seal()).map_err(Refusal::of)?;
        if layout.frame_bytes > self.team.frame_bytes {
            let (length, max) = (layout.frame_bytes, self.team.frame_bytes);
            return Err(Refusal::Malformed(pingmap_packet::Error::TooLong { length, max }));
        }
        let expected = if layout.is_sealed { 0 } else { self.check_number(&layout.with_model_zeroed(bytes)) };
        if layout.has_depth != self.team.model.inputs.has_depths() || message.model != expected {
            return Err(Refusal::OtherModel { found: message.model, expected });
        }
        if !self.team.members.contains_key(&message.sender) {
            return Err(Refusal::UnknownSender { number: message.sender });
        }
        Ok((layout, message))
    }

    /// The bytes of a message, as this team sends them: sealed if it has a key, else with the digest of what it agreed
    /// on.
    ///
    /// # Errors
    /// As [`MapMessage::encode`].
    pub fn write(&self, layout: &Layout, message: &MapMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        if layout.is_sealed {
            return message.encode(layout, self.seal());
        }
        let unnumbered = MapMessage { model: 0, ..message.clone() };
        let model = self.check_number(&unnumbered.encode(layout, None)?);
        MapMessage { model, ..unnumbered }.encode(layout, self.seal())
    }

    /// Checks a packet and puts it among the live ones; the sender's number.
    pub(crate) fn take_in(&mut self, bytes: &[u8]) -> Result<u8, Refusal> {
        let (layout, message) = self.read(bytes)?;
        let key = (message.sender, message.counter);
        if self.live.is_too_old(key) {
            return Err(Refusal::TooOld);
        }
        if self.live.contains(key) {
            return Err(Refusal::Duplicate);
        }
        let said = message.blocks.iter().filter(|block| block.points.iter().any(|point| point.information > 0));
        let summaries: Result<Vec<Summary>, _> = said.map(|block| self.team.wire().decode(block)).collect();
        let summaries = summaries.map_err(Refusal::Unusable)?;
        self.put_in(key, LivePacket { bytes: bytes[..layout.length()].to_vec(), summaries });
        Ok(message.sender)
    }

    /// Puts a packet among the live ones and notes what that changes.
    fn put_in(&mut self, key: PacketKey, packet: LivePacket) {
        self.is_stale |= self.live.insert(key, packet);
        self.unread.insert(key);
        if Some(key.0) == self.number {
            // Its own packet, new to it: from before it lost its memory. That counter is taken.
            self.counter_next = self.counter_next.max(u32::from(key.1) + 1);
            self.nothing_new_in = None;
        }
    }

    /// The packet that tells most for a frame of so many bytes (at most the team's); `None` where nothing is worth a
    /// frame. Fits its own events again if some came since the last time. Whoever may lose its memory writes an
    /// [`Agent::snapshot`] before the packet leaves: a counter must not be used twice.
    ///
    /// # Errors
    /// [`AgentError::NotAMember`], [`AgentError::CountersUsedUp`], and [`AgentError::Team`] for a frame below 32 bytes.
    pub fn next_packet(&mut self, time_s: f64, frame_bytes: usize) -> Result<Option<Vec<u8>>, AgentError> {
        let sender = self.number.ok_or_else(|| AgentError::NotAMember { id: self.id.clone() })?;
        let layout = self.team.layout(frame_bytes.min(self.team.frame_bytes))?;
        let used_up = || AgentError::CountersUsedUp { id: self.id.clone(), epoch: self.team.epoch };
        let counter = u16::try_from(self.counter_next).map_err(|_| used_up())?;
        self.refit_if_due()?;
        self.absorb_pending()?;
        let planned = if self.nothing_new_in == Some(layout.frame_bytes) {
            None
        } else {
            self.planner(layout)?.packet(&self.public)?
        };
        let Some(planned) = planned else {
            self.nothing_new_in = Some(layout.frame_bytes);
            return Ok(self.repeat(sender));
        };
        let bytes = self.write(layout, &MapMessage { sender, counter, model: 0, blocks: planned.blocks })?;
        self.put_in((sender, counter), LivePacket { bytes: bytes.clone(), summaries: planned.summaries });
        self.heard_s.insert(sender, time_s);
        Ok(Some(bytes))
    }

    /// A packet of its own that was sent again least often, the oldest of these, unless all were sent again often
    /// enough.
    fn repeat(&mut self, sender: u8) -> Option<Vec<u8>> {
        let repeats = |counter: &u16| self.repeats.get(counter).copied().unwrap_or(0);
        let least = self.live.of(sender).map(|(&(_, counter), _)| counter).min_by_key(|counter| repeats(counter))?;
        if repeats(&least) >= self.team.repeats_max {
            return None;
        }
        *self.repeats.entry(least).or_default() += 1;
        self.live.get((sender, least)).map(|packet| packet.bytes.clone())
    }

    /// What it knows, at the places where it could send something of it.
    fn planner<'a>(&'a self, layout: &'a Layout) -> Result<Planner<'a>, AgentError> {
        let links = self.candidates();
        let inputs = self.team.model.inputs(&links)?;
        Ok(Planner { wire: self.team.wire(), layout, own: &self.own, links, inputs, worth_nats: self.team.worth_nats })
    }

    /// Links of its own events that it could tell of: those within the grid, every k-th if they are too many.
    pub fn candidates(&self) -> Vec<Link> {
        let wire = self.team.wire();
        let links: Vec<Link> = self.events.iter().map(|event| event.link).filter(|link| wire.holds(link)).collect();
        self.team.limits.spread(links.len()).into_iter().map(|place| links[place]).collect()
    }

    /// The links that a packet speaks of, by sender and counter; those of others too. Nothing for a packet that does
    /// not count.
    pub fn links_of_packets(&self) -> Vec<(VehicleId, u16, Vec<Link>)> {
        let told = |(&(sender, counter), packet): (&PacketKey, &LivePacket)| {
            let name = self.team.members.get(&sender)?.clone();
            let (_, message) = MapMessage::decode(&packet.bytes, self.seal()).ok()?;
            let points = message.blocks.iter().flat_map(|block| &block.points);
            let said: Vec<_> = points.filter(|point| point.information > 0).copied().collect();
            Some((name, counter, self.team.wire().links(&said)))
        };
        self.live.iter().filter_map(told).collect()
    }

    fn seal(&self) -> Option<Seal<'_>> {
        self.team.key.as_ref().map(|key| Seal { key, context: &self.digest })
    }

    /// The number by which an open packet shows that it is whole, and of this team: 14 bits of the digest of what the
    /// team agreed on and of the packet itself, with zeros where the number will stand.
    fn check_number(&self, unnumbered: &[u8]) -> u16 {
        let digest = digest(&[self.digest.as_slice(), unnumbered].concat());
        u16::from_le_bytes([digest[0], digest[1]]) & 0x3fff
    }
}
