//! What a vehicle remembers. All else that it knows follows from this, and from what its team agreed on.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

use dgpc::Observations;
use pingmap_packet::{Cell, ReportLayout};

use crate::agent_error::AgentError;
use crate::bounds::COORDINATE_M;
use crate::entry::Entry;
use crate::event::{Event, Link, Position, VehicleId};
use crate::events::{Change, Events, Numbered};
use crate::frames::Frames;
use crate::packets::{Arrival, PacketKey, Packets, Version};
use crate::receipt::{Receipt, Refusal};
use crate::reports::{Filed, Reports, Said};
use crate::track::{Track, along};

/// Numbers of entries from here on are no vehicle's.
const NUMBER_MAX: u64 = 1 << 48;

/// A told event, by the number of who heard or missed it, and the slot.
pub(crate) type ToldKey = (u8, u32);

/// Events that were told and have a place.
pub(crate) type ToldEvents = BTreeMap<ToldKey, Arc<Event>>;

/// Events, where it was, packets and reports. It changes only by [`Memory::apply`], and depends on nothing but the set of
/// entries.
#[derive(Debug, Clone)]
pub(crate) struct Memory {
    pub(crate) frames: Frames,
    /// The vehicle's number in the team, if it is a member.
    pub(crate) own: Option<u8>,
    pub(crate) events: Events,
    /// Where it was, in the order of time.
    fixes: Vec<(f64, Position)>,
    pub(crate) packets: Packets,
    pub(crate) reports: Reports,
    /// What of all this follows about the events of others, until something changes.
    placed: OnceLock<Placed>,
}

/// Events of others by what they told.
#[derive(Debug, Clone)]
struct Placed {
    events: Arc<ToldEvents>,
    waiting: usize,
}

/// What an entry did.
#[derive(Debug)]
pub(crate) enum Applied {
    Event(Change),
    Fix,
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
        let reports = Reports::new(frames.team.reports_per_sender_max);
        Self { frames, own, events, fixes: Vec::new(), packets, reports, placed: OnceLock::new() }
    }

    /// Remembers an entry: applying it again changes nothing. What became of it, if it is a frame.
    ///
    /// # Errors
    /// [`AgentError`] for an event that no vehicle records, and a number that none comes to; then nothing changed.
    pub(crate) fn apply(&mut self, entry: Entry) -> Result<Applied, AgentError> {
        match entry {
            Entry::Observed { number, event } => self.record(vec![Numbered { number, event }]).map(Applied::Event),
            Entry::Navigated { time_s, position } => {
                self.navigate(&[(time_s, position)])?;
                Ok(Applied::Fix)
            }
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
        self.placed = OnceLock::new();
        Ok(self.events.insert(new))
    }

    /// Remembers where it was, or none of it; of as many places as events, the latest.
    ///
    /// # Errors
    /// As [`Memory::apply`].
    pub(crate) fn navigate(&mut self, new: &[(f64, Position)]) -> Result<(), AgentError> {
        for (time_s, position) in new {
            check_time(*time_s)?;
            check_position(position)?;
        }
        self.fixes.extend(new);
        let sorted = Track::new(std::mem::take(&mut self.fixes)).fixes();
        self.fixes = sorted;
        let max = self.frames.team.limits.events_max;
        self.fixes.drain(..self.fixes.len().saturating_sub(max));
        self.placed = OnceLock::new();
        Ok(())
    }

    /// Where it was, by its navigation and by its events.
    pub(crate) fn track(&self) -> Track {
        let own = self.own_id();
        let heard = self.events.iter().filter(|event| Some(&event.receiver_id) == own);
        let heard = heard.map(|event| (event.time_s, event.link.receiver));
        Track::new(self.fixes.iter().copied().chain(heard).collect())
    }

    pub(crate) fn own_id(&self) -> Option<&VehicleId> {
        self.own.and_then(|own| self.frames.team.members.get(&own))
    }

    /// The slot of an event between members, and the number of who heard or missed it.
    pub(crate) fn slot_of(&self, event: &Event) -> Option<ToldKey> {
        let team = &self.frames.team;
        let slot = team.slots.sent_in(event.time_s, &event.transmitter_id)?;
        let receiver = team.number(&event.receiver_id)?;
        self.frames.is_heard_by(slot, receiver).then_some((receiver, slot))
    }

    /// The vehicle's own events in these slots, by number.
    pub(crate) fn numbers_of(&self, is_wanted: &dyn Fn(u32) -> bool) -> BTreeSet<u64> {
        let is_in = |known: &&Numbered| {
            let key = self.slot_of(&known.event).filter(|(receiver, _)| Some(*receiver) == self.own);
            key.is_some_and(|(_, slot)| is_wanted(slot))
        };
        self.events.numbered().iter().filter(is_in).map(|known| known.number).collect()
    }

    /// Events of others that were told and have a place: their ends are known, of others by what they told themselves. What the
    /// vehicle has recorded itself is not among them.
    pub(crate) fn told_events(&self) -> &Arc<ToldEvents> {
        &self.placed().events
    }

    /// How many told events wait until it is known where they took place.
    pub(crate) fn waiting(&self) -> usize {
        self.placed().waiting
    }

    fn placed(&self) -> &Placed {
        self.placed.get_or_init(|| self.place())
    }

    fn place(&self) -> Placed {
        let (mut events, mut waiting) = (ToldEvents::new(), 0);
        if self.reports.told().next().is_some() {
            let recorded: BTreeSet<ToldKey> = self.events.iter().filter_map(|event| self.slot_of(event)).collect();
            let track = self.track();
            for (receiver, told) in self.reports.told().filter(|(receiver, _)| Some(*receiver) != self.own) {
                let outcomes = told.outcomes.iter().filter(|(slot, _)| !recorded.contains(&(receiver, **slot)));
                for (&slot, said) in outcomes {
                    let Some((transmitter, success)) = self.opportunity(slot, *said) else { continue };
                    match self.told_event(transmitter, receiver, slot, success, &track) {
                        Some(event) => drop(events.insert((receiver, slot), Arc::new(event))),
                        None => waiting += 1,
                    }
                }
            }
        }
        Placed { events: Arc::new(events), waiting }
    }

    /// Who sent in a slot, and whether it was heard; nobody where the sender says that it was silent, or a receiver says both.
    fn opportunity(&self, slot: u32, said: Said) -> Option<(u8, bool)> {
        let transmitter = self.frames.team.number(self.frames.team.slots.sender(slot)?)?;
        let is_silent = self.reports.told_by(transmitter).is_some_and(|told| told.silent.contains(&slot));
        match said {
            _ if is_silent => None,
            Said::Contradicted => None,
            said => Some((transmitter, said == Said::Heard)),
        }
    }

    fn told_event(&self, transmitter: u8, receiver: u8, slot: u32, success: bool, own: &Track) -> Option<Event> {
        let team = &self.frames.team;
        let time_s = team.slots.begin_s(slot)?;
        let has_depth = team.model.inputs.has_depths();
        let place = |cell: Cell| team.grid.knot_position(&team.model.chart, cell, has_depth);
        let at = |member: u8| {
            let position = match Some(member) == self.own {
                true => own.at(time_s)?,
                false => {
                    let knots = &self.reports.told_by(member)?.knots;
                    along(knots, slot, &team.slots, &place, team.onward_s_max)?
                }
            };
            (position.depth_m.is_some() || !has_depth).then_some(position)
        };
        Some(Event {
            time_s,
            transmitter_id: team.members.get(&transmitter)?.clone(),
            receiver_id: team.members.get(&receiver)?.clone(),
            link: Link { transmitter: at(transmitter)?, receiver: at(receiver)? },
            kind: None,
            success,
        })
    }

    /// Remembers a frame that was heard, or sent under this number. One that is not the team's or, as a sent one, not
    /// this vehicle's changes nothing.
    pub(crate) fn put_in(&mut self, bytes: &[u8], sent: Option<u64>) -> Arrived {
        if ReportLayout::of(bytes).is_some() {
            return self.put_in_report(bytes, sent);
        }
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

    fn put_in_report(&mut self, bytes: &[u8], sent: Option<u64>) -> Arrived {
        let (sender, report) = match self.frames.report(bytes) {
            Ok(read) => read,
            Err(refusal) => return Arrived { sender: None, receipt: Receipt::Refused(refusal) },
        };
        let refused = |refusal| Arrived { sender: Some(sender), receipt: Receipt::Refused(refusal) };
        if sent.is_some() && Some(sender) != self.own {
            return refused(Refusal::NotSentByMe { number: sender });
        }
        let filed = self.reports.insert(sender, report, sent);
        self.placed = OnceLock::new();
        match filed {
            Filed::New if Some(sender) == self.own && sent.is_none() => refused(Refusal::OwnReport),
            Filed::New => Arrived { sender: Some(sender), receipt: Receipt::Accepted },
            Filed::Known => refused(Refusal::Duplicate),
            Filed::TooOld => refused(Refusal::TooOld),
        }
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
        let reports = self.own.into_iter().flat_map(|own| self.reports.all(own));
        let last = versions.filter_map(|version| version.sent.last()).max();
        last.max(reports.filter_map(|kept| kept.sent.last()).max()).map_or(0, |last| last + 1)
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
        let navigated = self.fixes.iter().map(|&(time_s, position)| Entry::Navigated { time_s, position });
        let reports = self.reports.everything().flat_map(|kept| {
            let bytes = || kept.report.bytes.clone();
            let heard = kept.sent.is_empty().then(|| Entry::Heard { bytes: bytes() });
            heard.into_iter().chain(kept.sent.iter().map(move |&number| Entry::Sent { number, bytes: bytes() }))
        });
        observed.chain(navigated).chain(frames).chain(reports)
    }
}

fn check_number(number: u64) -> Result<(), AgentError> {
    if number < NUMBER_MAX { Ok(()) } else { Err(AgentError::NumberTooLarge { number }) }
}

/// Refuses what is no time, and places that are nowhere.
fn check(event: &Event) -> Result<(), AgentError> {
    check_time(event.time_s)?;
    event.link.ends().iter().try_for_each(check_position)
}

fn check_time(time_s: f64) -> Result<(), AgentError> {
    if time_s.is_finite() { Ok(()) } else { Err(AgentError::NoTime { time_s }) }
}

fn check_position(at: &Position) -> Result<(), AgentError> {
    let mut places = [Some(at.east_m), Some(at.north_m), at.depth_m].into_iter().flatten();
    match places.find(|&value_m| COORDINATE_M.check(value_m).is_none()) {
        Some(value_m) => Err(AgentError::Nowhere { value_m }),
        None => Ok(()),
    }
}
