//! Restores a vehicle from the content of a store.

use std::collections::BTreeMap;
use std::sync::Arc;

use pingmap_agent::{Agent, AgentError, Entry, FrameState, Team};
use pingmap_import::Reference;
use pingmap_packet::to_hex;
use serde::{Deserialize, Serialize};

use crate::config::settings::VehicleConfig;
use crate::store::tables::Contents;
use crate::vehicle::ledger::Ledger;
use crate::vehicle::positions::StoredPosition;
use crate::vehicle::record::Record;
use crate::vehicle::state::Vehicle;
use crate::vehicle::trust::Scores;

/// Error in the content of a store.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RestoreError {
    /// The base is no snapshot of this vehicle.
    #[error("the base of the store: {0}")]
    Base(String),
    /// A record has no valid meaning.
    #[error("record {index} of the store: {problem}")]
    Record {
        /// Index of the record, from 0.
        index: usize,
        /// Description of the problem.
        problem: String,
    },
}

/// The content of a base in addition to the snapshot of the agent.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Rest {
    ledger: Ledger,
    scores: Scores,
    late_receptions: u64,
    /// Digest of the team configuration that numbers these slots and frames.
    team: String,
    /// Counters of the next own packet by the digest of each team configuration so far.
    counters: BTreeMap<String, u32>,
    silence: Option<String>,
    positions: Vec<StoredPosition>,
    open_frames: BTreeMap<u64, Option<u32>>,
    /// The recovery that no host was told of.
    #[serde(default)]
    recovery: Option<String>,
    #[serde(default)]
    late_reports: u64,
}

impl Vehicle {
    /// Returns the state as the base of a store. O(entries).
    pub(crate) fn base(&self) -> Vec<u8> {
        let snapshot = self.agent.snapshot();
        let mut counters = self.former_counters.clone();
        // Used counters are unknown if the vehicle is silent.
        let next = if self.silence.is_some() { u32::from(u16::MAX) + 1 } else { self.agent.next_counter() };
        counters.insert(self.team_digest(), next);
        let rest = Rest {
            ledger: self.ledger.clone(),
            scores: self.scores.clone(),
            late_receptions: self.late_receptions,
            team: self.team_digest(),
            counters,
            silence: self.silence.clone(),
            positions: self.positions.stored(self.ledger.clock_s().unwrap_or(f64::INFINITY)),
            open_frames: self.open_frames.clone(),
            recovery: self.recovery.clone(),
            late_reports: self.late_reports,
        };
        // Numbers are finite and keys are texts, so that this cannot fail.
        let rest = serde_json::to_vec(&rest).unwrap_or_default();
        [&(snapshot.len() as u64).to_le_bytes(), snapshot.as_slice(), &rest].concat()
    }

    /// Creates a vehicle with the content of a store. Fits nothing: the first query does.
    ///
    /// # Errors
    /// [`RestoreError`] for a base or a record that this version cannot read.
    pub fn restore(
        config: VehicleConfig,
        team: Arc<Team>,
        reference: Reference,
        contents: &Contents,
    ) -> Result<Self, RestoreError> {
        let mut vehicle = Self::from_base(config, team, reference, contents.base.as_deref())?;
        for (index, bytes) in contents.entries.iter().enumerate() {
            let applied = Record::from_bytes(bytes).and_then(|record| vehicle.apply(record));
            applied.map_err(|problem| RestoreError::Record { index, problem })?;
        }
        Ok(vehicle)
    }

    /// Creates a vehicle with the content of a store of another team configuration, with this digest. Events, positions
    /// and outcomes have times and stay. Slots and frames of the other configuration have no meaning here.
    ///
    /// # Errors
    /// [`RestoreError`] for a base or a record that this version cannot read.
    pub fn adopt(
        config: VehicleConfig,
        team: Arc<Team>,
        reference: Reference,
        contents: &Contents,
        former_digest: &[u8; 32],
    ) -> Result<Self, RestoreError> {
        let mut vehicle = Self::from_base(config, team, reference, contents.base.as_deref())?;
        let mut sent = 0;
        for (index, bytes) in contents.entries.iter().enumerate() {
            let wrong = |problem| RestoreError::Record { index, problem };
            match Record::from_bytes(bytes).map_err(wrong)? {
                Record::Entry(Entry::Sent { state: FrameState::Proposed, .. }) => sent += 1,
                Record::Entry(
                    Entry::Sent { .. } | Entry::Received { .. } | Entry::UnusedSlot { .. } | Entry::Piggyback { .. },
                ) => {}
                record => vehicle.apply(record).map_err(wrong)?,
            }
        }
        vehicle.ledger = vehicle.ledger.restarted();
        vehicle.raise_former_counter(&to_hex(former_digest), sent);
        Ok(vehicle)
    }

    fn from_base(
        config: VehicleConfig,
        team: Arc<Team>,
        reference: Reference,
        base: Option<&[u8]>,
    ) -> Result<Self, RestoreError> {
        match base {
            None => Ok(Self::new(config, team, reference)),
            Some(base) => Self::read_base(config, team, reference, base).map_err(RestoreError::Base),
        }
    }

    fn read_base(config: VehicleConfig, team: Arc<Team>, reference: Reference, base: &[u8]) -> Result<Self, String> {
        let split = || {
            let (length, rest) = base.split_first_chunk::<8>()?;
            rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)
        };
        let (snapshot, rest) = split().ok_or_else(|| format!("{} bytes are too few", base.len()))?;
        let id = config.vehicle.clone();
        let agent = Agent::restore(id, team, config.agent_options(), snapshot).map_err(|error| error.to_string())?;
        let rest: Rest = serde_json::from_slice(rest).map_err(|error| error.to_string())?;
        let mut vehicle = Self {
            scores: rest.scores,
            late_receptions: rest.late_receptions,
            late_reports: rest.late_reports,
            warnings: rest.recovery.iter().cloned().collect(),
            recovery: rest.recovery,
            ..Self::with_agent(config, agent, reference)
        };
        vehicle.positions.restore(rest.positions);
        let digest = vehicle.team_digest();
        if let Some(&next) = rest.counters.get(&digest) {
            vehicle.agent.raise_counter(next);
        }
        vehicle.former_counters = rest.counters;
        vehicle.begin_snapshot();
        Ok(match rest.team == digest {
            true => Self { ledger: rest.ledger, silence: rest.silence, open_frames: rest.open_frames, ..vehicle },
            false => Self { ledger: rest.ledger.restarted(), ..vehicle },
        })
    }

    fn team_digest(&self) -> String {
        to_hex(&self.agent.team().digest())
    }

    /// Raises the counter of a former team configuration by the frames that were sent after the base, and by one window
    /// for packets of unknown origin.
    fn raise_former_counter(&mut self, digest: &str, sent: u32) {
        let window = u32::from(self.agent.team().packets_per_sender_max);
        *self.former_counters.entry(digest.into()).or_default() += sent + window;
    }

    fn apply(&mut self, record: Record) -> Result<(), String> {
        match record {
            Record::Entry(entry) => {
                match &entry {
                    Entry::Sent { number, state: FrameState::Proposed, slot, .. } => {
                        self.open_frames.insert(*number, *slot);
                    }
                    Entry::Sent { number, .. } => drop(self.open_frames.remove(number)),
                    Entry::Navigated { time_s, position } => {
                        let id = self.id().clone();
                        self.add_position(&id, *time_s, *position, true);
                    }
                    Entry::PeerPosition { member, time_s, position, is_independent } => {
                        self.add_position(member, *time_s, *position, *is_independent);
                    }
                    _ => {}
                }
                self.agent.apply(entry).map(drop).map_err(|error: AgentError| error.to_string())?;
            }
            Record::Ledger(record) => self.ledger.apply(&record),
            Record::Score(score) => self.scores.add(score),
        }
        Ok(())
    }

    /// Continues from a snapshot after the store was damaged. Packets after the snapshot may have used further
    /// counters, so that the vehicle skips a window. Without a snapshot the used counters are unknown, and the vehicle
    /// sends nothing. Returns the base for the store.
    pub fn note_recovery(&mut self, has_snapshot: bool, problem: &str) -> Vec<u8> {
        let mut warning = format!("the store was damaged ({problem}); ");
        if has_snapshot {
            let window = u32::from(self.agent.team().packets_per_sender_max);
            self.agent.raise_counter(self.agent.next_counter() + window);
            self.former_counters.values_mut().for_each(|next| *next += window);
            warning += "the vehicle continues from its snapshot, and skips a window of counters";
        } else {
            let silence = "the store was damaged and had no snapshot, so that used counters are unknown; raise the \
                           epoch of the team (`pingmap team --epoch`) to send again";
            self.silence = Some(silence.into());
            warning += "there is no snapshot, so that the vehicle begins without data and sends nothing";
        }
        self.open_frames.clear();
        let earlier = self.recovery.take().map(|earlier| earlier + "; ").unwrap_or_default();
        self.recovery = Some(earlier + &warning);
        self.warnings.push(warning);
        self.begin_snapshot();
        self.base()
    }
}
