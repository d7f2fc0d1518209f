//! The state of one vehicle.

use std::collections::BTreeMap;
use std::sync::Arc;

use pingmap_agent::{Agent, Event, Position, Team, VehicleId};
use pingmap_import::{ModemStream, Reference};

use crate::config::settings::VehicleConfig;
use crate::protocol::output::Message;
use crate::vehicle::copies::Copies;
use crate::vehicle::ledger::{Ledger, LedgerRecord};
use crate::vehicle::positions::Positions;
use crate::vehicle::record::Record;
use crate::vehicle::trust::{RangeModel, Scores};
use crate::vehicle::unconfirmed_nav::UnconfirmedNav;

/// One step that the process takes after an input. It takes all of them in their order.
#[derive(Debug, Clone, PartialEq)]
pub enum Output {
    /// Append these records to the store. They must survive a crash before the next step. After a failure call
    /// [`Vehicle::store_failed`] instead of the remaining steps.
    Store(Vec<Vec<u8>>),
    /// Replace the base of the store, and write it as a snapshot next to the store. Call [`Vehicle::snapshot_failed`]
    /// if only the snapshot could not be written.
    Base(Vec<u8>),
    /// Send a message to the host.
    Send(Message),
}

/// One vehicle as a state machine without input or output, clock, or threads.
///
/// [`Vehicle::handle`] takes a message of the host. The times in messages are the only clock. Equal inputs give equal
/// outputs. [`Vehicle::restore`] begins with the content of a store.
///
/// The vehicle counts the slots of other members. A slot of a member counts as heard or missed if the vehicle could
/// receive during the whole slot. It counts a few seconds after its end, when the positions of both ends are known.
/// Nothing in this rule depends on whether the message was heard.
pub struct Vehicle {
    pub(crate) config: VehicleConfig,
    pub(crate) reference: Reference,
    pub(crate) agent: Agent,
    pub(crate) ledger: Ledger,
    pub(crate) scores: Scores,
    pub(crate) by_range: RangeModel,
    pub(crate) positions: Positions,
    pub(crate) copies: Copies,
    pub(crate) modem: ModemStream,
    /// Frames that neither departed nor were dropped, with their expected slots.
    pub(crate) open_frames: BTreeMap<u64, Option<u32>>,
    /// Why the vehicle sends nothing.
    pub(crate) silence: Option<String>,
    /// The failure of the store.
    pub(crate) store_problem: Option<String>,
    /// Warning of the last recovery, until a host has received it.
    pub(crate) recovery: Option<String>,
    /// Warnings of the start, for the greeting.
    pub(crate) warnings: Vec<String>,
    pub(crate) has_greeted: bool,
    /// Whether the clock has not moved since the process or its host started. No slot counts until then.
    pub(crate) is_starting: bool,
    /// Navigation after a gap or far behind the clock, until a later report confirms it.
    pub(crate) unconfirmed: Option<UnconfirmedNav>,
    /// Latest time of a reported reception by member, in seconds.
    pub(crate) arrivals_s: BTreeMap<VehicleId, f64>,
    pub(crate) inputs: u64,
    pub(crate) late_receptions: u64,
    /// Transmissions and deaf intervals that were reported after their slots had been counted.
    pub(crate) late_reports: u64,
    /// Time of the last stored own position.
    pub(crate) stored_nav_s: Option<f64>,
    /// Time of the last navigation.
    pub(crate) nav_s: Option<f64>,
    /// Time of the last base.
    pub(crate) base_s: Option<f64>,
    /// Counter of the next own packet in the last snapshot.
    pub(crate) snapshot_counter: u32,
    /// That of the snapshot before it. It applies again if the last snapshot cannot be written.
    pub(crate) former_snapshot_counter: u32,
    /// A counter that no own packet has reached, by the digest of each team configuration so far.
    pub(crate) former_counters: BTreeMap<String, u32>,
    /// Records since the last base.
    pub(crate) records_after_base: usize,
    /// Whether the present input needs a base and a snapshot.
    pub(crate) wants_base: bool,
    /// Records and messages of the present input.
    pub(crate) records: Vec<Record>,
    pub(crate) messages: Vec<Message>,
}

impl Vehicle {
    /// Creates a vehicle without data.
    pub fn new(config: VehicleConfig, team: Arc<Team>, reference: Reference) -> Self {
        let agent = Agent::new(config.vehicle.clone(), team, config.agent_options());
        Self::with_agent(config, agent, reference)
    }

    pub(crate) fn with_agent(config: VehicleConfig, mut agent: Agent, reference: Reference) -> Self {
        // A snapshot may have other muted members than the configuration.
        let members: Vec<VehicleId> = agent.team().members.values().cloned().collect();
        members.iter().for_each(|member| agent.set_muted(member, config.muted.contains(member)));
        Self {
            modem: ModemStream::new(config.modem_ids()),
            config,
            reference,
            agent,
            ledger: Ledger::default(),
            scores: Scores::default(),
            by_range: RangeModel::default(),
            positions: Positions::default(),
            copies: Copies::default(),
            open_frames: BTreeMap::new(),
            silence: None,
            store_problem: None,
            recovery: None,
            warnings: Vec::new(),
            has_greeted: false,
            is_starting: true,
            unconfirmed: None,
            arrivals_s: BTreeMap::new(),
            inputs: 0,
            late_receptions: 0,
            late_reports: 0,
            stored_nav_s: None,
            nav_s: None,
            base_s: None,
            snapshot_counter: 0,
            former_snapshot_counter: 0,
            former_counters: BTreeMap::new(),
            records_after_base: 0,
            wants_base: false,
            records: Vec::new(),
            messages: Vec::new(),
        }
    }

    /// Returns the agent: its events, posteriors and team.
    pub fn agent(&self) -> &Agent {
        &self.agent
    }

    /// Returns the own events that count: those in slots that their senders used, as far as the vehicle knows.
    pub fn counting_events(&self) -> impl Iterator<Item = &Event> {
        let is_used = |event: &&Event| self.agent.has_transmitted(&event.transmitter_id, event.time_s);
        self.agent.events().filter(is_used)
    }

    /// Returns the name of the vehicle.
    pub fn id(&self) -> &VehicleId {
        self.agent.id()
    }

    /// Adds a position that the host knows, or that the store holds.
    pub(crate) fn add_position(&mut self, id: &VehicleId, time_s: f64, position: Position, is_independent: bool) {
        let clock_s = self.ledger.clock_s().unwrap_or(f64::NEG_INFINITY);
        self.positions.add(id, time_s, position, is_independent, clock_s);
    }

    /// Returns the position of a vehicle at the time of the clock; its own one from the first navigation on.
    pub(crate) fn latest_position(&self, id: &VehicleId) -> Option<Position> {
        let first = self.unconfirmed.as_ref().filter(|_| id == self.id());
        let known = self.positions.latest(id, self.ledger.clock_s().unwrap_or(f64::INFINITY));
        known.or(first.map(|first| first.position))
    }

    /// Applies a change of the ledger, and notes it for the store.
    pub(crate) fn change_ledger(&mut self, record: LedgerRecord) {
        self.ledger.apply(&record);
        self.records.push(Record::Ledger(record));
    }

    pub(crate) fn send(&mut self, message: Message) {
        self.messages.push(message);
    }

    /// Returns the longest time between two positions of which a position in between is known, in seconds.
    pub(crate) fn gap_s_max(&self) -> f64 {
        2.0 * self.agent.team().extrapolation_s_max
    }
}
