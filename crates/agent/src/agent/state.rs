//! One vehicle: it records events, exchanges frames, and predicts links.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

use dgpc::{Posterior, Sites};

use crate::agent::ignore_reason::IgnoreReason;
use crate::agent::options::AgentOptions;
use crate::codec::receipt::Receipt;
use crate::codec::team_codec::TeamCodec;
use crate::error::AgentError;
use crate::inference::accepted::AcceptedData;
use crate::inference::event_fit::RefitStart;
use crate::inference::posteriors::{IntervalPosteriors, Posteriors};
use crate::store::entry::Entry;
use crate::store::memory::{Effect, Memory};
use crate::team::config::Team;
use crate::types::event::{Event, Position, VehicleId};
use crate::types::interrupt::Interrupt;

/// One vehicle of a team, as a state machine without input or output, clock, or threads.
///
/// A host records what the vehicle observes, passes on received frames, asks for the next frame to send, and asks for
/// predictions. Events may arrive late and in any order. Packets may be lost, repeated and reordered.
///
/// The vehicle stores a set of entries ([`Entry`]). Two posteriors follow from it: one of its own events, and one that
/// fuses these with the data of other members. Queries absorb new data at O(n²) an event, for n events and inducing
/// points. Only [`Agent::refit`] fits again; [`Agent::refit_due`] tells when.
///
/// ```
/// use pingmap_agent::*;
/// use std::sync::Arc;
///
/// // What the team fixes before the mission: members, model, area, and a cycle of slots of ten seconds.
/// let chart = Chart::about([]);
/// let shape = dgpc::Shape::SquaredExponential;
/// let model = Model::isotropic(chart, InputSpec::Positions, shape, true, 400.0, 4.0)?;
/// let area = [Position::new(-1000.0, -1000.0), Position::new(1000.0, 1000.0)];
/// let [alice, bob] = ["alice", "bob"].map(VehicleId::new);
/// let team = Arc::new(Team::new([alice.clone(), bob.clone()], model, area)?);
/// let link = |east_m| Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, 0.0) };
///
/// // Alice listens in the slots of Bob, and records what she heard and what she missed.
/// let mut agent = Agent::new(alice.clone(), team.clone(), AgentOptions::default());
/// for (time_s, east_m, success) in [(10.0, 100.0, true), (30.0, 200.0, true), (50.0, 900.0, false)] {
///     let (transmitter_id, receiver_id) = (bob.clone(), alice.clone());
///     agent.record([Event { time_s, transmitter_id, receiver_id, link: link(east_m), kind: None, success }])?;
/// }
/// agent.refit()?;
///
/// // In her own slot she sends a frame of at most 32 bytes.
/// let frame = agent.next_frame(Some(60.0), 32)?.expect("three new outcomes");
/// assert!(frame.bytes.len() <= 32);
///
/// // Bob knows where he was when he transmitted. The frame says where Alice was.
/// let mut other = Agent::new(bob, team, AgentOptions::default());
/// other.record_positions([0.0, 60.0].map(|time_s| (time_s, Position::new(0.0, 0.0))))?;
/// assert_eq!(other.receive(&frame.bytes, Some(61.0)).receipt, Receipt::Accepted);
/// assert_eq!(other.status().located_events, 3);
/// assert!(other.probability(link(150.0))? > 0.5);
/// assert!(other.probability(link(900.0))? < 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Agent {
    pub(crate) id: VehicleId,
    /// Options. They may change at any time; recorded data stay.
    pub options: AgentOptions,
    pub(crate) memory: Memory,
    pub(crate) posteriors: Posteriors,
    /// Number of received packets by [`Receipt::class`].
    pub(crate) counts: BTreeMap<&'static str, u64>,
    pub(crate) last_heard_s: BTreeMap<u8, f64>,
    /// Times since when data of members are not used.
    pub(crate) ignored_since_s: BTreeMap<(u8, IgnoreReason), f64>,
    /// Data of all members that are not muted; computed on demand after a change.
    accepted: OnceLock<AcceptedData>,
    /// Whether the posteriors include all data.
    is_current: bool,
    /// Length of the longest observed link: see [`Status::longest_link_m`](crate::Status::longest_link_m).
    pub(crate) longest_cache: OnceLock<Option<f64>>,
    /// Posteriors by expectation propagation, from which intervals follow.
    pub(crate) interval_cache: OnceLock<Arc<IntervalPosteriors>>,
}

/// A posterior from which a vehicle predicts.
#[derive(Debug, Clone, Copy)]
pub enum Which<'a> {
    /// Of the vehicle's own events, under the team's model.
    Own,
    /// Of own events and of the data of trusted members, under the vehicle's own model if it learned one.
    Fused,
    /// A given one, under the model of [`Which::Fused`].
    Given(&'a Posterior),
}

impl Agent {
    /// Creates a vehicle without any data. A vehicle that is no member of the team receives and predicts, but sends
    /// nothing.
    pub fn new(id: VehicleId, team: Arc<Team>, options: AgentOptions) -> Self {
        Self {
            posteriors: Posteriors::new(&team.model),
            memory: Memory::new(TeamCodec::new(team.clone()), team.number(&id)),
            id,
            options,
            counts: BTreeMap::new(),
            last_heard_s: BTreeMap::new(),
            ignored_since_s: BTreeMap::new(),
            accepted: OnceLock::new(),
            is_current: false,
            longest_cache: OnceLock::new(),
            interval_cache: OnceLock::new(),
        }
    }

    /// Returns the name of the vehicle.
    pub fn id(&self) -> &VehicleId {
        &self.id
    }

    /// Returns the team.
    pub fn team(&self) -> &Team {
        &self.memory.codec.team
    }

    /// Returns the codec of the team, which encodes and decodes its packets.
    pub fn codec(&self) -> &TeamCodec {
        &self.memory.codec
    }

    /// Returns the vehicle's own events, in canonical order.
    pub fn events(&self) -> impl ExactSizeIterator<Item = &Event> + DoubleEndedIterator + Clone {
        self.memory.events.iter()
    }

    /// Mutes a member, or uses its data again. No frame of a muted member has any effect: no outcome, unused slot,
    /// position, summary, or acknowledgement. The vehicle still stores its frames, so that muting may come before or
    /// after them. O(N) for N events. Unknown names, and the vehicle's own, change nothing.
    pub fn set_muted(&mut self, member: &VehicleId, is_muted: bool) {
        let Some(number) = self.team().number(member).filter(|&number| Some(number) != self.memory.own) else { return };
        let change = self.memory.set_muted(number, is_muted);
        self.posteriors.note(change);
        self.data_changed();
        self.posteriors.nothing_to_send = None;
    }

    /// Returns the discrepancy of a member: the largest standardised shift of the posterior by its summaries, or the
    /// contradiction of its outcomes ([`Posterior::contradiction`]), whichever is larger. A common offset of one
    /// standard deviation of 0.5 logits is allowed for, because receivers differ. A member is excluded above
    /// [`Team::exclusion_threshold_sd`]. `None` for an unknown or muted member, and for one without data. O(Mn²) for M
    /// inducing points of its packets; O(n³) if it sent outcomes. See docs/method/faulty-members.md.
    ///
    /// # Errors
    /// [`AgentError::Method`] for a numerical failure.
    pub fn discrepancy(&mut self, member: &VehicleId) -> Result<Option<f64>, AgentError> {
        self.update()?;
        let data = self.accepted();
        let others = data.members(self.memory.own);
        let number = self.team().number(member).filter(|number| others.contains(number));
        number.map(|number| self.posteriors.discrepancy_of(&self.memory, data, number)).transpose()
    }

    /// Data of all members that are not muted.
    pub(crate) fn accepted(&self) -> &AcceptedData {
        self.accepted.get_or_init(|| AcceptedData::new(&self.memory))
    }

    /// Data of all trusted members.
    pub(crate) fn trusted(&self) -> AcceptedData {
        self.accepted().without(&self.posteriors.excluded)
    }

    /// Muted and excluded members.
    pub(crate) fn ignored_members(&self) -> BTreeSet<u8> {
        self.memory.muted.union(&self.posteriors.excluded).copied().collect()
    }

    pub(crate) fn data_changed(&mut self) {
        self.accepted.take();
        self.longest_cache.take();
        self.interval_cache.take();
        self.is_current = false;
    }

    /// Records events of which the vehicle is the receiver, in any order. Beyond
    /// [`Limits::events_max`](crate::Limits::events_max) the events that were recorded first are forgotten, a sixteenth
    /// at a time. O(log N) for one event, O(N log N) for many. After [`Agent::average_with`] it also costs a
    /// prediction of each event. Returns the entries for the journal of the host.
    ///
    /// # Errors
    /// [`AgentError::NotMine`] for an event of another receiver, unless [`AgentOptions::record_all_receivers`] is set.
    /// [`AgentError::NoTime`], [`AgentError::Nowhere`] and [`AgentError::NoHeading`] for numbers out of bounds.
    /// [`AgentError::Method`] for a numerical failure of that prediction. Then none is recorded.
    pub fn record(&mut self, events: impl IntoIterator<Item = Event>) -> Result<Vec<Entry>, AgentError> {
        let numbered: Vec<(u64, Event)> = (self.memory.events.next_number()..).zip(events).collect();
        numbered.iter().try_for_each(|(_, event)| self.check_receiver(event))?;
        let difference = self.score_difference(numbered.iter().map(|(_, event)| event))?;
        let entries = numbered.iter().map(|(number, event)| Entry::Observed { number: *number, event: event.clone() });
        let entries = entries.collect();
        self.record_numbered(numbered)?;
        self.posteriors.alternative.iter_mut().for_each(|alternative| alternative.add_score(difference));
        Ok(entries)
    }

    pub(crate) fn record_numbered(&mut self, events: Vec<(u64, Event)>) -> Result<(), AgentError> {
        let latest_s = events.iter().map(|(_, event)| event.time_s).reduce(f64::max);
        let change = self.memory.record(events)?;
        self.posteriors.note(change);
        self.data_changed();
        self.advance_clock(latest_s);
        Ok(())
    }

    /// Records positions of the vehicle by time, from its navigation; one a slot is enough. The positions in its own
    /// events are known without that. Reports need positions. O(N) for N positions. Returns the entries for the journal
    /// of the host.
    ///
    /// # Errors
    /// [`AgentError::NoTime`], [`AgentError::Nowhere`] and [`AgentError::NoHeading`] for numbers out of bounds;
    /// then none is recorded.
    pub fn record_positions(
        &mut self,
        fixes: impl IntoIterator<Item = (f64, Position)>,
    ) -> Result<Vec<Entry>, AgentError> {
        let fixes: Vec<(f64, Position)> = fixes.into_iter().collect();
        self.memory.record_positions(&fixes)?;
        self.posteriors.nothing_to_send = None;
        self.data_changed();
        self.advance_clock(fixes.iter().map(|&(time_s, _)| time_s).reduce(f64::max));
        Ok(fixes.into_iter().map(|(time_s, position)| Entry::Navigated { time_s, position }).collect())
    }

    /// Records that the vehicle did not transmit in its own slots at these times. Its next reports include that, so
    /// that other members do not count these slots as missed. Returns the entries for the journal of the host.
    ///
    /// # Errors
    /// [`AgentError::NotMyTurn`] for a time outside the vehicle's own slots; then nothing is recorded.
    pub fn record_unused_slots(&mut self, times_s: impl IntoIterator<Item = f64>) -> Result<Vec<Entry>, AgentError> {
        let id = self.id.clone();
        let slot = |time_s: f64| {
            let slot = self.memory.own.and_then(|_| self.team().slots.sent_in(time_s, &id));
            slot.ok_or_else(|| AgentError::NotMyTurn { id: id.clone(), time_s })
        };
        let slots = times_s.into_iter().map(slot).collect::<Result<Vec<u32>, AgentError>>()?;
        let effect = self.memory.insert_unused_slots(&id, &slots).unwrap_or_else(Effect::refused);
        self.note_effect(effect);
        self.posteriors.nothing_to_send = None;
        Ok(slots.into_iter().map(|slot| Entry::UnusedSlot { sender: id.clone(), slot }).collect())
    }

    /// Advances the clock to a time, if it is known and finite. Frames that waited for it count from now on.
    pub(crate) fn advance_clock(&mut self, time_s: Option<f64>) {
        let effects = time_s.filter(|time_s| time_s.is_finite()).map(|time_s| self.memory.advance_clock(time_s));
        effects.into_iter().flatten().for_each(|effect| drop(self.note_effect(effect)));
    }

    pub(crate) fn note_effect(&mut self, Effect { receipt, change, .. }: Effect) -> Receipt {
        self.posteriors.note(change);
        if receipt.changes_memory() {
            self.data_changed();
            // It may acknowledge own reports.
            self.posteriors.nothing_to_send = None;
        }
        receipt
    }

    fn check_receiver(&self, event: &Event) -> Result<(), AgentError> {
        if self.options.record_all_receivers || event.receiver_id == self.id {
            return Ok(());
        }
        Err(AgentError::NotMine { id: self.id.clone(), receiver: event.receiver_id.clone() })
    }

    /// Applies an entry of a journal. Entries may come in any order, and repeatedly. Fits nothing.
    ///
    /// # Errors
    /// As [`Agent::record`], and [`AgentError::NumberTooLarge`]. A frame of another team is no error: the receipt says
    /// so.
    pub fn apply(&mut self, entry: Entry) -> Result<Receipt, AgentError> {
        if let Entry::Observed { event, .. } = &entry {
            self.check_receiver(event)?;
        }
        let is_received = matches!(entry, Entry::Received { .. } | Entry::Piggyback { .. });
        let time_s = match &entry {
            Entry::Observed { event, .. } => Some(event.time_s),
            Entry::Navigated { time_s, .. } | Entry::Outcome { time_s, .. } | Entry::PeerPosition { time_s, .. } => {
                Some(*time_s)
            }
            Entry::Received { time_s, .. } => *time_s,
            Entry::Sent { .. } | Entry::UnusedSlot { .. } | Entry::Piggyback { .. } => None,
        };
        let effect = self.memory.apply(entry)?;
        self.advance_clock(time_s);
        if is_received {
            *self.counts.entry(effect.receipt.class()).or_default() += 1;
        }
        // A frame that was sent again is a duplicate, but a report may acknowledge its new slot.
        self.data_changed();
        self.posteriors.nothing_to_send = None;
        Ok(self.note_effect(effect))
    }

    /// Returns whether [`Agent::refit`] is due: since the last fit more events came or went than
    /// [`Limits::refit_threshold`](crate::Limits::refit_threshold).
    pub fn refit_due(&self) -> bool {
        self.posteriors.refit_due(&self.team().limits)
    }

    /// Fits own and remote events again, beginning at the last fit, and detects faulty members. O(N³) an iteration up
    /// to [`Limits::dense_events_max`](crate::Limits::dense_events_max) events; beyond that O(NM²) with M inducing
    /// points, or O(M²) for each changed event if these are less than a sixteenth.
    ///
    /// # Errors
    /// [`AgentError::Method`] for a numerical failure.
    pub fn refit(&mut self) -> Result<(), AgentError> {
        self.fit(RefitStart::Incremental)
    }

    /// Fits everything from nothing, in canonical order. The result depends only on the events, the packets that count
    /// and the models. As expensive as a first [`Agent::refit`], plus O(n³).
    ///
    /// # Errors
    /// [`AgentError::Method`] for a numerical failure.
    pub fn rebuild(&mut self) -> Result<(), AgentError> {
        self.fit(RefitStart::Cold)
    }

    fn fit(&mut self, start: RefitStart) -> Result<(), AgentError> {
        let data = self.accepted.get_or_init(|| AcceptedData::new(&self.memory));
        self.posteriors.refit(&self.memory, data, start)?;
        self.interval_cache.take();
        self.posteriors_changed();
        Ok(())
    }

    /// Absorbs new data into the posteriors. O(1) without any. Every query calls it, so that an [`Interrupt`] stops a
    /// host between its queries.
    pub(crate) fn update(&mut self) -> Result<(), AgentError> {
        Interrupt::check()?;
        if self.is_current {
            return Ok(());
        }
        let data = self.accepted.get_or_init(|| AcceptedData::new(&self.memory));
        self.posteriors.update(&self.memory, data)?;
        self.posteriors_changed();
        Ok(())
    }

    fn posteriors_changed(&mut self) {
        self.longest_cache.take();
        self.is_current = true;
        self.note_ignored();
    }

    /// Returns a posterior, after it has absorbed new data.
    ///
    /// # Errors
    /// [`AgentError::Method`] for a numerical failure.
    pub fn posterior<'a>(&'a mut self, which: Which<'a>) -> Result<&'a Posterior, AgentError> {
        self.update()?;
        Ok(self.current_posterior(which))
    }

    pub(crate) fn current_posterior<'a>(&'a self, which: Which<'a>) -> &'a Posterior {
        match which {
            Which::Own => &self.posteriors.pair.own,
            Which::Fused => self.posteriors.pair.fused(),
            Which::Given(posterior) => posterior,
        }
    }

    /// Returns the sites of the vehicle's own events in the last fit, under the team's model; `None` before the first.
    pub fn sites(&self) -> Option<&Sites> {
        self.posteriors.own_fit.as_ref().map(|own| own.fit.sites())
    }
}
