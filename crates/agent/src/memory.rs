//! What a vehicle remembers. All else that it knows follows from this, and from what its team agreed on.

use dgpc::Observations;

use crate::agent_error::AgentError;
use crate::bounds::COORDINATE_M;
use crate::entry::Entry;
use crate::event::Event;
use crate::events::{Change, Events, Numbered};
use crate::frames::Frames;
use crate::packets::{Arrival, PacketKey, Packets, Version};
use crate::receipt::{Receipt, Refusal};

/// Numbers of entries from here on are no vehicle's.
const NUMBER_MAX: u64 = 1 << 48;

/// Events and packets. It changes only by [`Memory::apply`], and depends on nothing but the set of entries.
#[derive(Debug, Clone)]
pub(crate) struct Memory {
    pub(crate) frames: Frames,
    /// The vehicle's number in the team, if it is a member.
    pub(crate) own: Option<u8>,
    pub(crate) events: Events,
    pub(crate) packets: Packets,
}

/// What an entry did.
#[derive(Debug)]
pub(crate) enum Applied {
    Event(Change),
    Frame(Arrived),
}

/// What became of a frame.
#[derive(Debug)]
pub(crate) struct Arrived {
    /// Who sent it, where that could be told.
    pub(crate) sender: Option<u8>,
    pub(crate) receipt: Receipt,
}

impl Memory {
    pub(crate) fn new(frames: Frames, own: Option<u8>) -> Self {
        let events = Events::new(frames.team.limits.events_max);
        let packets = Packets::new(frames.team.packets_per_sender_max);
        Self { frames, own, events, packets }
    }

    /// Remembers an entry: applying it again changes nothing. What became of it, if it is a frame.
    ///
    /// # Errors
    /// [`AgentError`] for an event that no vehicle records, and a number that none comes to; then nothing changed.
    pub(crate) fn apply(&mut self, entry: Entry) -> Result<Applied, AgentError> {
        match entry {
            Entry::Observed { number, event } => self.record(vec![Numbered { number, event }]).map(Applied::Event),
            Entry::Heard { bytes } => Ok(Applied::Frame(self.put_in(&bytes, None))),
            Entry::Sent { number, bytes } => {
                check_number(number)?;
                Ok(Applied::Frame(self.put_in(&bytes, Some(number))))
            }
        }
    }

    /// One of its events as the method sees it, with the weight that it has beside those before it.
    pub(crate) fn observation(&self, event: &Event) -> dgpc::Result<Observations> {
        self.frames.team.model.observation_beside(event, self.events.before(event))
    }

    /// Remembers many events, or none of them.
    ///
    /// # Errors
    /// As [`Memory::apply`].
    pub(crate) fn record(&mut self, new: Vec<Numbered>) -> Result<Change, AgentError> {
        for entry in &new {
            check_number(entry.number)?;
            check(&entry.event)?;
        }
        Ok(self.events.insert(new))
    }

    /// Remembers a frame that was heard, or sent under this number. One that is not the team's or, as a sent one, not
    /// this vehicle's changes nothing.
    pub(crate) fn put_in(&mut self, bytes: &[u8], sent: Option<u64>) -> Arrived {
        let (key, packet) = match self.frames.packet(bytes) {
            Ok(read) => read,
            Err(refusal) => return Arrived { sender: None, receipt: Receipt::Refused(refusal) },
        };
        let sender = Some(key.0);
        if sent.is_some() && sender != self.own {
            let refusal = Refusal::NotSentByMe { number: key.0 };
            return Arrived { sender, receipt: Receipt::Refused(refusal) };
        }
        let arrival = self.packets.insert(key, packet, sent);
        Arrived { sender, receipt: self.receipt(key, arrival, sent.is_some()) }
    }

    /// What an arrival means to a receiver.
    fn receipt(&self, (sender, counter): PacketKey, arrival: Arrival, was_sent: bool) -> Receipt {
        Receipt::Refused(match arrival {
            Arrival::New if Some(sender) == self.own && !was_sent => Refusal::OwnNumber { counter },
            Arrival::New => return Receipt::Accepted,
            Arrival::Known => Refusal::Duplicate,
            Arrival::Conflict => Refusal::Conflict { counter },
            Arrival::Unconfirmed => Refusal::Unconfirmed { counter, latest: self.packets.latest(sender) },
            Arrival::TooOld => Refusal::TooOld,
        })
    }

    /// The number under which it sends its next frame.
    pub(crate) fn sent_next(&self) -> u64 {
        let versions = self.own.into_iter().flat_map(|own| self.packets.all(own));
        versions.filter_map(|version| version.sent.last()).max().map_or(0, |last| last + 1)
    }

    /// The packets of the vehicle's own that others may hold, and will when it has sent another one.
    pub(crate) fn told(&self) -> impl Iterator<Item = (u16, &Version)> {
        let strange = self.own.and_then(|own| self.packets.strange(own));
        let sent = self.own.into_iter().flat_map(|own| self.packets.believed(own));
        sent.filter(move |(counter, version)| !version.sent.is_empty() && Some(*counter) > strange)
    }

    /// The packets of others that count, by sender and counter.
    pub(crate) fn heard(&self) -> impl Iterator<Item = PacketKey> {
        let others = self.packets.senders().filter(|&sender| Some(sender) != self.own);
        others.flat_map(|sender| self.packets.believed(sender).map(move |(counter, _)| (sender, counter)))
    }

    /// Everything in it, as entries: applied to an empty memory they make this one, but for how far senders have come
    /// ([`Packets::reach`]).
    pub(crate) fn entries(&self) -> impl Iterator<Item = Entry> {
        let events = self.events.numbered().iter();
        let observed = events.map(|known| Entry::Observed { number: known.number, event: known.event.clone() });
        let versions = self.packets.senders().flat_map(|sender| self.packets.all(sender));
        let frames = versions.flat_map(|version| {
            let bytes = || version.packet.bytes.clone();
            let heard = version.sent.is_empty().then(|| Entry::Heard { bytes: bytes() });
            heard.into_iter().chain(version.sent.iter().map(move |&number| Entry::Sent { number, bytes: bytes() }))
        });
        observed.chain(frames)
    }
}

fn check_number(number: u64) -> Result<(), AgentError> {
    if number < NUMBER_MAX { Ok(()) } else { Err(AgentError::NumberTooLarge { number }) }
}

/// Refuses what is no time, and places that are nowhere.
fn check(event: &Event) -> Result<(), AgentError> {
    if !event.time_s.is_finite() {
        return Err(AgentError::NoTime { time_s: event.time_s });
    }
    let ends = event.link.ends().into_iter();
    let mut places = ends.flat_map(|end| [Some(end.east_m), Some(end.north_m), end.depth_m]).flatten();
    match places.find(|&value_m| COORDINATE_M.check(value_m).is_none()) {
        Some(value_m) => Err(AgentError::Nowhere { value_m }),
        None => Ok(()),
    }
}
