//! What a team agrees on before the mission.

use std::collections::BTreeMap;

use pingmap_packet::{Key, Layout};

use crate::attempt::Party;
use crate::bounds::Bounds;
use crate::event::{Position, VehicleId};
use crate::grid::Grid;
use crate::limits::Limits;
use crate::model::Model;
use crate::slots::Slots;
use crate::wire::Wire;

/// Version of `team.toml`. A newer one is refused.
pub const TEAM_SCHEMA: u32 = 3;

/// Inducing points of all live packets together, where the team does not say how many packets each sender may have.
const LIVE_POINTS: usize = 2560;

/// What a team agrees on before the mission.
#[derive(Debug, Clone)]
pub struct Team {
    /// The number by which packets name each member.
    pub members: BTreeMap<u8, VehicleId>,
    /// The packet model: what packets are formed and read under, fixed for the mission.
    pub model: Model,
    /// The chart and the mission's time in cells.
    pub grid: Grid,
    /// Bytes of a frame: 32, 64 or 256, or what the link has beyond one of these.
    pub frame_bytes: usize,
    /// Who sends when.
    pub slots: Slots,
    /// The secret that packets are sealed with, if any.
    pub key: Option<Key>,
    /// Number of the key epoch: packets of another epoch are foreign, and counters begin again.
    pub epoch: u32,
    /// Packets of every sender that count, those behind its latest: bounds everybody's memory. A sender says again what
    /// falls out.
    pub packets_per_sender_max: u16,
    /// Reports of every sender that count, those about its latest slots: bounds everybody's memory.
    pub reports_per_sender_max: u16,
    /// How often a vehicle reports the same transmission at most, as long as there are frames for it: reports get lost. One that
    /// nobody can have heard does not count.
    pub tellings_max: u8,
    /// Whether to read what others say in spare bits of their hosts' messages; if nothing is said, where the team has no key:
    /// nothing shows who wrote them.
    pub spare_bits: Option<bool>,
    /// How far the track that a vehicle tells may be off where it was, in metres.
    pub track_off_max_m: f64,
    /// For how long others are taken to go straight on behind the last place that they told, in seconds. Where what came between was
    /// lost, too.
    pub onward_s_max: f64,
    /// A packet is sent if it brings what others can know by it closer to what the sender knows by so many nats an
    /// event at least: mean Kullback-Leibler divergence at the sender's own events.
    pub worth_nats: f64,
    /// A member whose packets or reports surprise by more standard deviations than this is left out: see
    /// [`crate::Agent::surprise`].
    pub surprise_max: f64,
    /// How often a packet is sent again at most, when there is nothing new to tell: what lossy water needs.
    pub repeats_max: u8,
    /// Bounds on work and memory of every vehicle.
    pub limits: Limits,
}

/// What makes no team.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TeamError {
    /// Not TOML, or a key that is unknown, missing or of the wrong kind.
    #[error("{0}")]
    Syntax(String),
    /// Written by a newer version of this software.
    #[error("schema {found}, but this version reads schema {TEAM_SCHEMA}; it was written by a newer version")]
    Newer {
        /// The schema of the text.
        found: u32,
    },
    /// A number out of its range.
    #[error("{key} must be {expected}, found {value}")]
    OutOfRange {
        /// The key.
        key: String,
        /// What it should be.
        expected: Bounds,
        /// What it is.
        value: f64,
    },
    /// More members than packets can tell apart, or none.
    #[error("a team has 1 to 256 members, found {found}")]
    Members {
        /// How many there are.
        found: usize,
    },
    /// Two members with one number.
    #[error("members {first} and {second} both have number {number}")]
    SameNumber {
        /// The number.
        number: u8,
        /// One of them.
        first: VehicleId,
        /// The other.
        second: VehicleId,
    },
    /// Two members with one name.
    #[error("two members are called {name}")]
    SameName {
        /// The name.
        name: VehicleId,
    },
    /// Orders of slots that do not follow one another in time.
    #[error("slots.changes: {from_s} s is no later than the change before, or the beginning")]
    ChangesBackwards {
        /// When the order begins.
        from_s: f64,
    },
    /// An order of slots among those who send at will.
    #[error("slots: where all send at_will there is no order, and no changes of one")]
    OrderAtWill,
    /// A slot for somebody who is not in the team.
    #[error("slots: {name} is not a member")]
    UnknownMember {
        /// The name.
        name: VehicleId,
    },
    /// A team that its file would not say as it is: members or slots that are no team's, numbers beyond those that files
    /// may hold, a key without a file, or a file without a key.
    #[error("the file of this team would not say the same: {problem}")]
    Unwritable {
        /// What is lost.
        problem: String,
    },
    /// No packet fits into such a frame.
    #[error("frame_bytes must be at least 32, found {found}")]
    FrameTooSmall {
        /// Bytes of the frame.
        found: usize,
    },
}

impl Team {
    /// A team with the defaults of this software: members numbered in the order given, frames of 32 bytes, no key, and
    /// a grid over all these positions.
    ///
    /// # Errors
    /// [`TeamError::Members`] for none or more than 256.
    pub fn new(
        members: impl IntoIterator<Item = VehicleId>,
        model: Model,
        positions: impl IntoIterator<Item = Position>,
    ) -> Result<Self, TeamError> {
        let names: Vec<VehicleId> = members.into_iter().collect();
        let found = names.len();
        let members: BTreeMap<u8, VehicleId> =
            names.iter().enumerate().map_while(|(n, name)| Some((u8::try_from(n).ok()?, name.clone()))).collect();
        if members.is_empty() || members.len() < found {
            return Err(TeamError::Members { found });
        }
        if let Some(name) = names.iter().enumerate().find_map(|(n, name)| names[..n].contains(name).then_some(name)) {
            return Err(TeamError::SameName { name: name.clone() });
        }
        let grid = Grid::covering(&model.chart, positions);
        Ok(Self {
            track_off_max_m: TRACK_OFF_CELLS * grid.cell_m,
            grid,
            packets_per_sender_max: packets_per_sender_max(members.len(), FRAME_BYTES),
            members,
            model,
            frame_bytes: FRAME_BYTES,
            slots: Slots::in_turn(SLOT_S, names),
            reports_per_sender_max: REPORTS_PER_SENDER_MAX,
            tellings_max: TELLINGS_MAX,
            onward_s_max: ONWARD_S_MAX,
            spare_bits: None,
            key: None,
            epoch: 0,
            worth_nats: WORTH_NATS,
            surprise_max: SURPRISE_MAX,
            repeats_max: 0,
            limits: Limits::default(),
        })
    }

    /// The same team with other frames, and as many live packets as fit its memory.
    #[must_use]
    pub fn with_frames(self, frame_bytes: usize) -> Self {
        let packets_per_sender_max = packets_per_sender_max(self.members.len(), frame_bytes);
        Self { frame_bytes, packets_per_sender_max, ..self }
    }

    /// The number of a member.
    pub fn number(&self, id: &VehicleId) -> Option<u8> {
        self.members.iter().find(|(_, name)| *name == id).map(|(&number, _)| number)
    }

    /// Whether spare bits are read and written: see [`Team::spare_bits`].
    pub fn has_spare_bits(&self) -> bool {
        !self.slots.at_will && self.spare_bits.unwrap_or(self.key.is_none())
    }

    /// The form of a packet in a frame of so many bytes.
    ///
    /// # Errors
    /// [`TeamError::FrameTooSmall`] below 32.
    pub fn layout(&self, frame_bytes: usize) -> Result<&'static Layout, TeamError> {
        let has_depth = self.model.inputs.has_depths();
        let layout = Layout::for_frame(frame_bytes, has_depth, self.key.is_some());
        layout.ok_or(TeamError::FrameTooSmall { found: frame_bytes })
    }

    /// What the numbers of a packet mean: where its points lie, and what a typical vehicle would say of them.
    pub fn wire(&self) -> Wire<'_> {
        Wire { model: &self.model, grid: &self.grid, receiver: Party::Typical }
    }

    /// What the numbers of a packet mean that this member sends: it speaks of what it hears itself.
    pub fn wire_of(&self, sender: u8) -> Wire<'_> {
        Wire { receiver: self.members.get(&sender).map_or(Party::New, Party::from), ..self.wire() }
    }
}

/// Bytes of a frame where nothing else is said: what every acoustic modem carries.
pub(crate) const FRAME_BYTES: usize = 32;

/// Slot length that is assumed where none is given.
pub(crate) const SLOT_S: f64 = 10.0;

/// The default of [`Team::surprise_max`]. Over ten splits of five trials, 340 cases, no honest member came above 4.2; members
/// whose reports turned every outcome into a miss came to 5.4 and more.
pub(crate) const SURPRISE_MAX: f64 = 4.5;

/// The default of [`Team::reports_per_sender_max`].
pub(crate) const REPORTS_PER_SENDER_MAX: u16 = 256;

/// The default of [`Team::tellings_max`].
pub(crate) const TELLINGS_MAX: u8 = 8;

/// The default of [`Team::onward_s_max`].
pub(crate) const ONWARD_S_MAX: f64 = 120.0;

/// The default of [`Team::track_off_max_m`], in cells of the grid.
pub(crate) const TRACK_OFF_CELLS: f64 = 0.5;

/// The default of [`Team::worth_nats`].
pub(crate) const WORTH_NATS: f64 = 3e-5;

/// Packets of a sender that count, such that those of all have about [`LIVE_POINTS`].
pub(crate) fn packets_per_sender_max(members: usize, frame_bytes: usize) -> u16 {
    let points = Layout::for_frame(frame_bytes, false, false).map_or(1, Layout::points_in_all);
    (LIVE_POINTS / points / members.saturating_sub(1).max(1)).clamp(2, 64) as u16
}
