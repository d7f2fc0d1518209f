//! One vehicle as a state machine: events and packets in, packets and probabilities out.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use dgpc::{Posterior, Sites};

use crate::agent_error::AgentError;
use crate::beliefs::Beliefs;
use crate::entry::Entry;
use crate::event::{Event, Position, VehicleId};
use crate::fitting::FitQuality;
use crate::frames::Frames;
use crate::heard::Heard;
use crate::memory::{Applied, Arrived, Memory};
use crate::model::Model;
use crate::passing::Passing;
use crate::receipt::{Counts, Receipt};
use crate::refit::Start;
use crate::team::Team;
use crate::tellings::Aside;

/// One vehicle. Events may arrive late and in any order; packets may be lost, repeated and reordered. It does no input
/// or output and knows no clock.
///
/// What it remembers is a set of entries ([`Entry`]): its events, the packets that it heard, those that it sent. What it
/// believes follows from that set, and is held in three posteriors: of its own events alone, of what it sent alone (what
/// any listener can know by it), and of its own events with all that others sent. Each grows by what arrives, at O(n²)
/// for an event or packet on top of n events and inducing points. Nothing is fitted but by [`Agent::refit`], which is
/// due after 8 events, later after a sixteenth as many as are known; [`Agent::rebuild_posteriors`] makes everything afresh.
///
/// ```
/// use pingmap_agent::*;
/// use std::sync::Arc;
///
/// let chart = Chart::about([]);
/// let shape = dgpc::Shape::SquaredExponential;
/// let model = Model::isotropic(chart, InputSpec::Positions, shape, true, 400.0, 4.0)?;
/// let names = ["alice", "bob"].map(VehicleId::new);
/// let reach = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
/// let team = Arc::new(Team::new(names.clone(), model, reach)?);
/// let link = |east_m| Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, 0.0) };
///
/// // They send in turn, ten seconds each.
/// let mut alice = Agent::new(names[0].clone(), team.clone());
/// for (time_s, east_m, success) in [(10.0, 100.0, true), (30.0, 200.0, true), (50.0, 900.0, false)] {
///     let [receiver_id, transmitter_id] = names.clone();
///     alice.observe(Event { time_s, transmitter_id, receiver_id, link: link(east_m), kind: None, success })?;
///     if alice.refit_due() {
///         alice.refit()?;
///     }
/// }
/// let frame = alice.next_packet(60.0, 32)?.expect("there is something to tell");
/// assert!(frame.len() <= 32);
///
/// // Bob knows where he was when he sent, and alice told where she was.
/// let mut bob = Agent::new(names[1].clone(), team);
/// bob.navigate([0.0, 60.0].map(|time_s| (time_s, Position::new(0.0, 0.0))))?;
/// assert_eq!(bob.receive(&frame, 61.0), Receipt::Accepted);
/// assert_eq!(bob.receive(&frame, 62.0), Receipt::Refused(Refusal::Duplicate));
/// assert_eq!(bob.told_events(), (3, 0));
/// assert!(bob.probability(&link(150.0))? > 0.5);
/// assert!(bob.probability(&link(900.0))? < 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Agent {
    pub(crate) id: VehicleId,
    pub(crate) memory: Memory,
    pub(crate) beliefs: Beliefs,
    /// Whether it records what any receiver heard.
    owns_all_events: bool,
    /// In which ways it tells what it knows.
    pub(crate) telling: Telling,
    /// Members that it does not listen to.
    pub(crate) muted: BTreeSet<u8>,
    pub(crate) counts: Counts,
    pub(crate) heard_s: BTreeMap<u8, f64>,
    /// What it told in spare bits of late. No part of a snapshot: who lost it tells the same again.
    pub(crate) asides: Vec<Aside>,
    /// What it might pass on.
    pub(crate) passing: Passing,
    /// Whether a link longer than any that was tried may be called better than its part of that length.
    pub(crate) may_rise: bool,
}

/// In which ways a vehicle tells what it knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Telling {
    /// By map messages: points that stand for all its events.
    pub points: bool,
    /// By reports: single events and where it was.
    pub reports: bool,
}

impl Default for Telling {
    /// In both.
    fn default() -> Self {
        Self { points: true, reports: true }
    }
}

impl Agent {
    /// A vehicle that has seen nothing. Who is not a member of the team listens only.
    pub fn new(id: VehicleId, team: Arc<Team>) -> Self {
        Self {
            beliefs: Beliefs::new(&team.model),
            memory: Memory::new(Frames::new(team.clone()), team.number(&id)),
            id,
            owns_all_events: false,
            telling: Telling::default(),
            muted: BTreeSet::new(),
            counts: Counts::default(),
            heard_s: BTreeMap::new(),
            asides: Vec::new(),
            passing: Passing::default(),
            may_rise: false,
        }
    }

    /// The same vehicle, but it records the events of any receiver as its own: somebody on shore with everybody's log.
    #[must_use]
    pub fn owning_all_events(self) -> Self {
        Self { owns_all_events: true, ..self }
    }

    /// The same vehicle, but it tells what it knows in these ways alone.
    #[must_use]
    pub fn telling(self, telling: Telling) -> Self {
        Self { telling, ..self }
    }

    /// The same vehicle, but what it predicts may rise again beyond the longest link that was tried: see
    /// [`Agent::predictions`].
    #[must_use]
    pub fn rising_beyond(self) -> Self {
        Self { may_rise: true, ..self }
    }

    /// Who it is.
    pub fn id(&self) -> &VehicleId {
        &self.id
    }

    /// Whether it has a number to send under.
    pub fn is_member(&self) -> bool {
        self.memory.own.is_some()
    }

    /// What the team agreed on.
    pub fn team(&self) -> &Team {
        &self.memory.frames.team
    }

    /// The packet model.
    pub fn model(&self) -> &Model {
        &self.team().model
    }

    /// Its own events, in canonical order.
    pub fn events(&self) -> impl ExactSizeIterator<Item = &Event> + Clone {
        self.memory.events.iter()
    }

    /// Packets received, by what became of them.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// How many packets count at present, its own included.
    pub fn live_packets(&self) -> usize {
        self.memory.told().count() + self.heard().packets.len()
    }

    /// How many events of others it knows by what they reported, and how many more were told and wait until it is known where
    /// they took place. What it recorded while its clock was wrong ([`Agent::clock_ahead_slots`]) is among them.
    pub fn told_events(&self) -> (usize, usize) {
        (self.memory.placed().events.len(), self.memory.placed().waiting.len())
    }

    /// When a member was last heard by a packet that counted, itself or by who passed it on.
    pub fn heard_s(&self, member: &VehicleId) -> Option<f64> {
        self.team().number(member).and_then(|number| self.heard_s.get(&number)).copied()
    }

    /// How many counters of a member, or of the vehicle's own, stand on different packets at present: two vehicles go
    /// by its number, or it lost its memory. None of these packets counts.
    pub fn conflicts(&self, member: &VehicleId) -> usize {
        self.team().number(member).map_or(0, |number| self.memory.packets.conflicts(number))
    }

    /// Takes no more notice of a member, until [`Agent::unmute`]. What it says is remembered all the same: muting and
    /// unmuting choose from what is there, and may come before it or after. No part of a snapshot. Names that are no
    /// member's, and the vehicle's own, change nothing.
    pub fn mute(&mut self, member: &VehicleId) {
        self.muted.extend(self.team().number(member).filter(|&number| Some(number) != self.memory.own));
    }

    /// Listens to a member again.
    pub fn unmute(&mut self, member: &VehicleId) {
        if let Some(number) = self.team().number(member) {
            self.muted.remove(&number);
        }
    }

    /// How far what a member says lies from what all others and the vehicle itself know: the largest shift of the latent
    /// function that its live packets together make at one of their points, in standard deviations of what is known there
    /// without them, but for an offset that all its points share (0.5 logits, one standard deviation: ears differ); or how far
    /// the outcomes that it told contradict that ([`Posterior::contradiction`]), if that is more (section 8 of the method). `None` for
    /// who is no member, muted, or has said nothing. O(M n²) for the M points of its packets, O(n³) where it told events.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn surprise(&mut self, member: &VehicleId) -> Result<Option<f64>, AgentError> {
        self.update()?;
        let heard = self.heard();
        let others = heard.others(self.memory.own);
        let number = self.team().number(member).filter(|number| others.contains(number));
        number.map(|number| self.beliefs.surprise_of(&self.memory, &heard, number)).transpose()
    }

    /// Members whose packets and reports do not count at present, because what they say surprises by more than
    /// [`Team::surprise_max`]. They count again when they agree again. As of the last prediction or fit.
    pub fn left_out(&self) -> Vec<&VehicleId> {
        self.beliefs.left_out.iter().filter_map(|number| self.team().members.get(number)).collect()
    }

    /// What others said and counts.
    pub(crate) fn heard(&self) -> Heard {
        Heard::of(&self.memory, &self.muted)
    }

    /// What is believed of it.
    pub(crate) fn believed(&self) -> Heard {
        self.heard().without(&self.beliefs.left_out)
    }

    /// Records an event of its own, and does nothing else; [`Agent::refit_due`] says when it is time for more. Beyond
    /// [`crate::Limits::events_max`] those go that were recorded first, a sixteenth at a time. O(log N) to find its place.
    ///
    /// # Errors
    /// [`AgentError::NotMine`] for an event of another receiver (but see [`Agent::owning_all_events`]),
    /// [`AgentError::NoTime`] and [`AgentError::Nowhere`] for numbers that are none.
    pub fn observe(&mut self, event: Event) -> Result<(), AgentError> {
        self.observe_all([event])
    }

    /// Records many events in any order. O(N log N).
    ///
    /// # Errors
    /// As [`Agent::observe`], and then none is recorded.
    pub fn observe_all(&mut self, new: impl IntoIterator<Item = Event>) -> Result<(), AgentError> {
        let mut numbered = Vec::new();
        for (number, event) in (self.memory.events.count()..).zip(new) {
            self.check_owner(&event)?;
            numbered.push((number, event));
        }
        self.remember(numbered)
    }

    /// Remembers events under their numbers, or none of them.
    pub(crate) fn remember(&mut self, events: Vec<(u64, Event)>) -> Result<(), AgentError> {
        let change = self.memory.record(events)?;
        self.beliefs.note(change);
        Ok(())
    }

    /// Records where it was, by its own navigation: once a slot is often enough. Where it heard or missed something it knows
    /// from its events, too. Without either it tells nobody where it was, and so not what it heard. O(N) for N places.
    ///
    /// # Errors
    /// [`AgentError::NoTime`] and [`AgentError::Nowhere`] for numbers that are none, and then nothing is recorded.
    pub fn navigate(&mut self, fixes: impl IntoIterator<Item = (f64, Position)>) -> Result<(), AgentError> {
        self.beliefs.nothing_new_in = None;
        self.memory.navigate(&fixes.into_iter().collect::<Vec<_>>())
    }

    /// Notes what became of something that came.
    pub(crate) fn arrived(&mut self, Arrived { receipt, change, .. }: Arrived) -> Receipt {
        self.beliefs.note(change);
        if receipt == Receipt::Accepted {
            // It may say what others have of this vehicle's.
            self.beliefs.nothing_new_in = None;
        }
        self.counts.count(&receipt);
        receipt
    }

    fn check_owner(&self, event: &Event) -> Result<(), AgentError> {
        if self.owns_all_events || event.receiver_id == self.id {
            return Ok(());
        }
        Err(AgentError::NotMine { id: self.id.clone(), receiver: event.receiver_id.clone() })
    }

    /// Remembers what a journal holds. Any order will do, and parts of a journal may be applied twice or overlap with a
    /// snapshot. Fits nothing.
    ///
    /// # Errors
    /// As [`Agent::observe`], and [`AgentError::NumberTooLarge`]. A frame that is not the team's is no error: the
    /// receipt says so.
    pub fn apply(&mut self, entry: Entry) -> Result<Receipt, AgentError> {
        if let Entry::Observed { event, .. } = &entry {
            self.check_owner(event)?;
        }
        if matches!(entry, Entry::Navigated { .. } | Entry::Turn { .. }) {
            self.beliefs.nothing_new_in = None;
        }
        match self.memory.apply(entry)? {
            Applied::Fix => Ok(Receipt::Accepted),
            Applied::Event(change) => {
                self.beliefs.note(change);
                Ok(Receipt::Accepted)
            }
            Applied::Frame(arrived) => Ok(self.arrived(arrived)),
        }
    }

    /// The numbers under which its next event and the next frame that it sends are to stand in a journal: what
    /// [`Agent::observe`] and [`Agent::next_packet`] are about to use.
    pub fn numbers_next(&self) -> (u64, u64) {
        (self.memory.events.count(), self.memory.sent_next())
    }

    /// Whether it is time to [`Agent::refit`]: more events have come, were told, or have gone since the last fit than
    /// [`Limits::beside_fit`](crate::Limits::beside_fit). Predictions take them in as they come.
    pub fn refit_due(&self) -> bool {
        self.beliefs.refit_due(&self.team().limits)
    }

    /// Fits its own events and those that it was told again if any came or went since the last time, beginning at the last
    /// fit, and judges by that whom to believe; once more, where that changed. O(N³) an iteration
    /// up to [`crate::Limits::dense_events_max`] events, O(NM²) with M = [`crate::Limits::inducing_points_max`] beyond, where O(M²) for
    /// each event that came or went is enough as long as these are less than a sixteenth of those that were fitted together.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn refit(&mut self) -> Result<(), AgentError> {
        self.beliefs.refit(&self.memory, &self.heard(), Start::Near)
    }

    /// Fits its own events anew, and puts everything together in canonical order: what comes of it depends on nothing
    /// but the events, the live packets and the model it learned, if it did (`Agent::adapt`). As dear as a first
    /// [`Agent::refit`], plus O(n³).
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn rebuild_posteriors(&mut self) -> Result<(), AgentError> {
        self.beliefs.refit(&self.memory, &self.heard(), Start::Cold)
    }

    /// Takes what arrived into the posteriors.
    pub(crate) fn update(&mut self) -> Result<(), AgentError> {
        self.beliefs.update(&self.memory, &self.heard())
    }

    /// Its own events and all that others sent, put together.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn posterior(&mut self) -> Result<&Posterior, AgentError> {
        self.update()?;
        Ok(&self.beliefs.fused)
    }

    /// Its own events alone, under the team's model.
    ///
    /// # Errors
    /// [`AgentError::Method`] when the method refuses.
    pub fn own_posterior(&mut self) -> Result<&Posterior, AgentError> {
        self.update()?;
        Ok(&self.beliefs.own)
    }

    /// The sites of its own events in the last fit, under the team's model; `None` before the first.
    pub fn sites(&self) -> Option<&Sites> {
        self.beliefs.alone.as_ref().map(|alone| alone.fit.sites())
    }

    /// How the last fit to its own events went; `None` before the first.
    pub fn fit_quality(&self) -> Option<FitQuality> {
        self.beliefs.alone.as_ref().map(|alone| FitQuality::of(&alone.fit))
    }

    /// Whether its events are few enough for a dense fit.
    pub fn learns_densely(&self) -> bool {
        self.memory.events.len() <= self.team().limits.dense_events_max
    }
}
