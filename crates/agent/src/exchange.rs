//! What a vehicle takes in from the water, and what it gives.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::spread_out;
use pingmap_packet::{Block, Earlier, Layout, MapMessage, Report as ReportMessage, ReportLayout};

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::attempt::{Attempt, Kind, Party};
use crate::entry::Entry;
use crate::event::{Event, Link, VehicleId};
use crate::frames::ToldKey;
use crate::heard::{Packets, counting};
use crate::packets::PacketKey;
use crate::passing::Worthy;
use crate::planner::Planner;
use crate::receipt::{Receipt, Refusal};
use crate::reporter::Reporter;
use crate::reports::{Said, Worth};
use crate::tellings::Tellings;
use crate::wire::Wire;

/// A vehicle begins to report when it is done within so many frames,
const FRAMES_BEFORE: usize = 3;

/// and so many for each that it has sent.
const FRAMES_AGAIN: usize = 2;

/// What may go next.
enum Next {
    Own(Vec<u8>),
    Passed(Worthy),
}

impl Agent {
    /// Takes in a packet. What it says is in the next prediction. `time_s` is when it was heard, in the turn of whoever sent it:
    /// others who heard that one then have it, too. One that came by another link, or nobody knows when, has a time that is not finite.
    pub fn receive(&mut self, bytes: &[u8], time_s: f64) -> Receipt {
        self.note_report(bytes, time_s);
        let arrived = self.memory.put_in(bytes, None);
        if arrived.receipt == Receipt::Accepted {
            arrived.sender.into_iter().for_each(|sender| self.note_time(sender, time_s));
        }
        self.arrived(arrived)
    }

    /// Notes in which slot a report went over the water, if the vehicle could hear somebody in it: it may be worth passing on.
    fn note_report(&mut self, bytes: &[u8], time_s: f64) {
        let could_hear = |slot: &u32| self.memory.own.is_some_and(|own| self.memory.frames.is_heard_by(*slot, own));
        let Some(slot) = self.team().slots.turn_at(self.memory.reckoning.team_s(time_s)).filter(could_hear) else {
            return;
        };
        let Ok((sender, report)) = self.memory.frames.report(bytes) else { return };
        // What it speaks of must not be so long ago, or to come, that nobody keeps it.
        let is_kept = |about: u32| (about.abs_diff(slot) as usize) < self.team().limits.slots_back_max;
        let told = report.outcomes.iter().chain(&report.turns).map(|said| said.0);
        if told.chain(report.knots.iter().map(|knot| knot.0)).chain([report.first]).all(is_kept) {
            self.passing.note(sender, Arc::new(report), slot);
        }
    }

    /// The share that was heard of the events of others that it knows, and of those that wait until it is known where they took place;
    /// `None` of none. Whether an event waits does not depend on what became of it; but whose tracks are lost may well be who is
    /// seldom heard. O(told).
    pub fn told_shares_heard(&self) -> [Option<f64>; 2] {
        let placed = self.memory.placed();
        let is_heard = |&(receiver, slot): &ToldKey| match Some(receiver) == self.memory.own {
            true => self.memory.reckoning.outcomes.get(&slot) == Some(&true),
            false => self.memory.reports.outcomes(receiver, slot..slot + 1).any(|(_, said, _)| said == Said::Heard),
        };
        let heard = [
            placed.events.values().filter(|event| event.success).count(),
            placed.waiting.iter().filter(|key| is_heard(key)).count(),
        ];
        let all = [placed.events.len(), placed.waiting.len()];
        std::array::from_fn(|nth| (all[nth] > 0).then(|| heard[nth] as f64 / all[nth] as f64))
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

    /// Reads a report of the team without taking it in: its form, what it says, and how many bytes it has.
    ///
    /// # Errors
    /// As [`Agent::read`].
    pub fn read_report(&self, bytes: &[u8]) -> Result<(&'static ReportLayout, ReportMessage, usize), Refusal> {
        self.memory.frames.read_report(bytes)
    }

    /// The bytes of a report, in the form of the team: see [`Agent::write`].
    ///
    /// # Errors
    /// As [`ReportMessage::encode`].
    pub fn write_report(&self, report: &ReportMessage) -> Result<Vec<u8>, pingmap_packet::Error> {
        self.memory.frames.write_report(report)
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
    /// and the events beside it; `None` where nothing is worth a frame. It is a report, of single events and where it was, or a
    /// map message, of what all its events say: reports go first where they are soon done (docs/method.md, section 8); or another's
    /// report as it was heard, where others say that they missed it and may be expected to learn more of that. Fits nothing:
    /// whoever has time to [`Agent::refit`] before does. `time_s` is when the frame leaves: who heard the vehicle in that slot has
    /// it. Whoever may lose its memory writes an [`Agent::snapshot`] or an [`Entry::Sent`] before the packet leaves: a counter
    /// must not be used twice. Reports of others need no entry.
    ///
    /// # Errors
    /// [`AgentError::NotAMember`], [`AgentError::CountersUsedUp`], and [`AgentError::Team`] for a frame below 32 bytes.
    pub fn next_packet(&mut self, time_s: f64, frame_bytes: usize) -> Result<Option<Vec<u8>>, AgentError> {
        let sender = self.memory.own.ok_or_else(|| AgentError::NotAMember { id: self.id.clone() })?;
        let frame_bytes = frame_bytes.min(self.team().frame_bytes);
        let layout = self.team().layout(frame_bytes)?;
        let used_up = || AgentError::CountersUsedUp { id: self.id.clone(), epoch: self.team().epoch };
        let counter = u16::try_from(self.memory.packets.counter_next(sender)).map_err(|_| used_up())?;
        let slot = self.memory.reckoning.departs_in(&self.team().slots, &self.id, time_s);
        let about = slot.or_else(|| self.team().slots.next_turn(self.memory.reckoning.team_s(time_s), &self.id));
        self.update()?;
        let next = match self.beliefs.nothing_new_in == Some(layout.frame_bytes) {
            true => None,
            false => self.next(sender, counter, layout, frame_bytes, about)?,
        };
        let bytes = match next {
            Some(Next::Own(bytes)) => bytes,
            Some(Next::Passed(worthy)) => return Ok(Some(self.passing.pass_on(worthy, slot))),
            None => {
                self.beliefs.nothing_new_in = Some(layout.frame_bytes);
                let Some(again) = self.repeat() else { return Ok(None) };
                again
            }
        };
        let number = self.memory.sent_next();
        self.memory.apply(Entry::Sent { number, slot, bytes: bytes.clone() })?;
        self.note_time(sender, time_s);
        Ok(Some(bytes))
    }

    /// What goes next: another's report if others may be expected to learn more of it than of any of its own.
    fn next(
        &mut self,
        sender: u8,
        counter: u16,
        layout: &Layout,
        frame_bytes: usize,
        slot: Option<u32>,
    ) -> Result<Option<Next>, AgentError> {
        let doubted = self.doubted();
        let tellings = Tellings::new(&self.memory, sender, slot, &doubted);
        self.beliefs.recall_told(&self.memory, &tellings)?;
        let reporter =
            self.telling.reports.then(|| Reporter::new(&self.memory, sender, frame_bytes, counter, tellings));
        if let Some(reporter) = &reporter
            && let Some(worthy) = self.passing.best(&self.memory, slot, &doubted, frame_bytes)
            && worthy.value > reporter.value()
        {
            return Ok(Some(Next::Passed(worthy)));
        }
        Ok(self.plan(sender, counter, layout, reporter)?.map(Next::Own))
    }

    /// Members of whom nothing counts.
    pub(crate) fn doubted(&self) -> BTreeSet<u8> {
        self.muted.union(&self.beliefs.left_out).copied().collect()
    }

    /// A report or a map message. Events that are told one by one tell more than points do, because everybody can fit them together
    /// with all others; but a few points tell something of all that the vehicle knows, and most of a long mission is long untold.
    /// Nothing says how many frames will follow, but that some were sent. So reports go first where all is told within twice as many
    /// and three more; before and after that a map message does, where one is worth a frame.
    fn plan(
        &self,
        sender: u8,
        counter: u16,
        layout: &Layout,
        reporter: Option<Reporter<'_>>,
    ) -> Result<Option<Vec<u8>>, AgentError> {
        let planner = self.planner(layout)?;
        let frames_max = FRAMES_BEFORE + FRAMES_AGAIN * self.memory.sent_next() as usize;
        let begins = |reporter: &&Reporter<'_>| (1..=frames_max).contains(&reporter.frames_needed());
        let report = |reporter: &Reporter<'_>| -> Result<Option<Vec<u8>>, AgentError> {
            let report = self.plan_report(&planner, reporter)?;
            Ok(report.map(|report| self.write_report(&report)).transpose()?)
        };
        if let Some(reporter) = reporter.as_ref().filter(begins)
            && let Some(bytes) = report(reporter)?
        {
            return Ok(Some(bytes));
        }
        if self.telling.points
            && let Some(blocks) = self.plan_map(&planner, sender, reporter.as_ref())?
        {
            return Ok(Some(self.write(layout, &MapMessage { sender, counter, model: 0, blocks })?));
        }
        reporter.as_ref().map_or(Ok(None), report)
    }

    /// The blocks that tell most of what no report did, or could tell yet: no event is to be told twice.
    fn plan_map(
        &self,
        planner: &Planner<'_>,
        sender: u8,
        reporter: Option<&Reporter<'_>>,
    ) -> Result<Option<Vec<Block>>, AgentError> {
        let memory = &self.memory;
        let planned = match memory.reports.told_by(sender) {
            None => planner.packet(&self.beliefs.public)?,
            Some(reported) => {
                let told = self.own_packets(sender);
                // Reports will tell what is not too long ago.
                let will_be = |slot: u32| reporter.is_some_and(|reporter| reporter.begin() <= Some(slot));
                let is_told = |slot: u32| will_be(slot) || reported.outcomes.contains_key(&slot);
                planner.packet(&self.beliefs.public_of(memory, &told, &is_told)?)?
            }
        };
        Ok(planned.map(|planned| planned.blocks))
    }

    /// That of the reports which leaves least untold. Map messages that were sent before the first report speak of the same events:
    /// they count for what they say beyond, or for nothing, whichever leaves less. Later ones are about other events.
    fn plan_report(&self, planner: &Planner<'_>, reporter: &Reporter<'_>) -> Result<Option<ReportMessage>, AgentError> {
        let (memory, sender) = (&self.memory, reporter.sender());
        let mut reports = reporter.reports();
        let Some(mut report) = reports.pop() else { return Ok(None) };
        let known = memory.reports.told_by(sender);
        let is_earlier = |worth: Worth| known.is_none() || worth < Worth::All;
        let (earlier, others): (Packets, Packets) =
            self.own_packets(sender).into_iter().partition(|(_, worth)| is_earlier(*worth));
        if reports.is_empty() && earlier.is_empty() {
            return Ok(Some(report));
        }
        let is_known = |slot: u32| reporter.is_known(slot);
        let beyond: Packets = earlier.keys().map(|&key| (key, Worth::Beyond)).chain(others.clone()).collect();
        // What earlier packets say beyond follows from all that is told; without them it is enough to add what is new.
        let public = earlier.is_empty().then(|| self.beliefs.public_of(memory, &others, &is_known)).transpose()?;
        let left = |report: &ReportMessage, packets: &Packets| -> Result<f64, AgentError> {
            let mut new = reporter.slots_told(report);
            let public = match &public {
                Some(public) => {
                    new.retain(|&slot| !is_known(slot));
                    self.beliefs.public_with(memory, public, &new)?
                }
                None => self.beliefs.public_of(memory, packets, &|slot| new.contains(&slot) || is_known(slot))?,
            };
            Ok(planner.left(&public)?)
        };
        let mut least = left(&report, &beyond)?;
        for other in reports {
            let left = left(&other, &beyond)?;
            if left < least {
                (report, least) = (other, left);
            }
        }
        let counts = !earlier.is_empty() && least < left(&report, &others)?;
        report.earlier = report.earlier.map(|earlier| Earlier { counts, ..earlier });
        Ok(Some(report))
    }

    /// What it sent as map messages, by what of them counts.
    fn own_packets(&self, sender: u8) -> Packets {
        counting(&self.memory, self.memory.told().map(|(counter, _)| (sender, counter)))
    }

    /// A packet of its own that was sent again least often, the oldest of these, unless all were sent again often
    /// enough.
    fn repeat(&self) -> Option<Vec<u8>> {
        let counts = |&(counter, _): &(u16, _)| {
            let own = self.memory.own.map(|own| (own, counter));
            own.is_some_and(|key| !counting(&self.memory, [key].into_iter()).is_empty())
        };
        let (_, least) = self.memory.told().filter(counts).min_by_key(|(_, version)| version.sent.len())?;
        (least.sent.len() <= usize::from(self.team().repeats_max)).then(|| least.packet.bytes.clone())
    }

    /// What it knows, at the places where it could send something of it.
    fn planner<'a>(&'a self, layout: &'a Layout) -> Result<Planner<'a>, AgentError> {
        Ok(Planner::new(self.wire(), layout, &self.beliefs, self.candidates(), self.team().worth_nats)?)
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
        let mut counting: Vec<PacketKey> = own.chain(self.heard().packets.into_keys()).collect();
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
