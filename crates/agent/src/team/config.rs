//! The team configuration, which is fixed before the mission.

use std::collections::BTreeMap;

use pingmap_packet::{Key, Layout};

use crate::model::link_model::Model;
use crate::team::grid::Grid;
use crate::team::members::Members;
use crate::team::slots::Slots;
use crate::types::bounds::Bounds;
use crate::types::event::{Position, VehicleId};
use crate::types::limits::Limits;

/// Schema version of `team.toml`. A newer version is refused.
pub const TEAM_SCHEMA: u32 = 4;

/// Number of inducing points in all live packets together, by which the default of [`Team::packets_per_sender_max`] is
/// computed.
const DEFAULT_LIVE_POINTS: usize = 2560;

/// The team configuration: everything that a team fixes before the mission.
#[derive(Debug, Clone)]
pub struct Team {
    /// Members and their numbers in packets.
    pub members: Members,
    /// The packet model, under which packets are encoded and decoded. It is fixed for the mission.
    pub model: Model,
    /// Cells of position and time.
    pub grid: Grid,
    /// Largest frame, in bytes: 32, 64, 256, or another capacity of the link. A summary packet has the largest form
    /// that fits.
    pub frame_bytes: usize,
    /// Transmission schedule.
    pub slots: Slots,
    /// Secret key that authenticates packets, if any.
    pub key: Option<Key>,
    /// Number of the key epoch. Packets of another epoch are foreign, and counters begin again at 0.
    pub epoch: u32,
    /// Number of summary packets of each sender that count: a window of counters up to its latest. It bounds the memory
    /// of every vehicle. The sender sends the content of older packets again.
    pub packets_per_sender_max: u16,
    /// Number of reports of each sender that count: those with the latest first slots. It bounds the memory of every
    /// vehicle.
    pub reports_per_sender_max: u16,
    /// Maximum number of transmissions of an outcome in reports. A transmission in a slot that turned out to be unused
    /// does not count.
    pub transmissions_max: u8,
    /// Whether to send and accept piggybacked outcomes, which are not authenticated. `None` stands for true in a team
    /// without a key, and for false in a team with a key.
    pub piggyback: Option<bool>,
    /// Largest deviation of a reported track from the vehicle's own track, in metres.
    pub track_tolerance_m: f64,
    /// Maximum duration for which a reported track is extrapolated, in seconds. Gaps between reports are interpolated
    /// up to twice this duration.
    pub extrapolation_s_max: f64,
    /// Minimum gain of a summary packet, in nats per event. The gain is the decrease of the mean Kullback-Leibler
    /// divergence between the sender's posterior and the posterior that a listener can compute. The mean is over the
    /// sender's own events.
    pub min_gain_nats: f64,
    /// Threshold of exclusion, in standard deviations. A member with a larger [discrepancy](crate::Agent::discrepancy)
    /// is excluded.
    pub exclusion_threshold_sd: f64,
    /// Limits on the computing time and memory of each vehicle.
    pub limits: Limits,
}

/// Error in a team configuration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TeamError {
    /// The text is not TOML, or a key is unknown, missing or of the wrong type.
    #[error("{0}")]
    Syntax(String),
    /// The text was written by a newer version of this software.
    #[error("schema {0}, but this version reads schema {TEAM_SCHEMA}; it was written by a newer version")]
    Newer(u32),
    /// The text was written by an older version of this software.
    #[error("schema {0}, but this version reads schema {TEAM_SCHEMA}; write the file again with `pingmap team`")]
    Older(u32),
    /// A number is out of range.
    #[error("{key} must be {expected}, found {value}")]
    OutOfRange {
        /// Key of the number in the text.
        key: String,
        /// Range of valid numbers.
        expected: Bounds,
        /// The number that was found.
        value: f64,
    },
    /// The team has no members, or more than a member number of 8 bits can distinguish.
    #[error("a team has 1 to 256 members, found {0}")]
    Members(usize),
    /// Two members have one number.
    #[error("members {first} and {second} both have number {number}")]
    SameNumber {
        /// The number.
        number: u8,
        /// First of the two members.
        first: VehicleId,
        /// Second of the two members.
        second: VehicleId,
    },
    /// Two members have one name.
    #[error("two members have the name {0}")]
    SameName(VehicleId),
    /// A slot belongs to a vehicle that is not a member.
    #[error("slots: {0} is not a member")]
    UnknownMember(VehicleId),
    /// A team file cannot represent the team. Causes are invalid members or slots, numbers out of range, a key without
    /// a file name, and a file name without a key.
    #[error("the team cannot be written to a file without loss: {0}")]
    Unwritable(String),
    /// No packet fits into the frame.
    #[error("frame_bytes must be at least 32, found {0}")]
    FrameTooSmall(usize),
}

impl Team {
    /// Creates a team with default settings. Members are numbered in the order given. Frames have 32 bytes, there is no
    /// key, and the grid covers all these positions.
    ///
    /// # Errors
    /// [`TeamError::Members`] for no member or more than 256. [`TeamError::SameName`] for two members with one name.
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
            return Err(TeamError::Members(found));
        }
        if let Some(name) = names.iter().enumerate().find_map(|(n, name)| names[..n].contains(name).then_some(name)) {
            return Err(TeamError::SameName(name.clone()));
        }
        let grid = Grid::covering(&model.chart, positions);
        Ok(Self {
            track_tolerance_m: DEFAULT_TRACK_TOLERANCE_CELLS * grid.cell_m,
            grid,
            packets_per_sender_max: default_packets_per_sender_max(members.len(), 32),
            members: Members::new(members),
            model,
            // Every acoustic modem carries frames of this size.
            frame_bytes: 32,
            slots: Slots { order: names, ..Slots::default() },
            reports_per_sender_max: 256,
            transmissions_max: 8,
            extrapolation_s_max: 120.0,
            piggyback: None,
            key: None,
            epoch: 0,
            min_gain_nats: 3e-5,
            // It lies between the discrepancies of correct members and those of members that report every outcome as a
            // miss.
            exclusion_threshold_sd: 4.5,
            limits: Limits::default(),
        })
    }

    /// Returns the team with frames of `frame_bytes` bytes and the default number of live packets for that size.
    #[must_use]
    pub fn with_frames(self, frame_bytes: usize) -> Self {
        let packets_per_sender_max = default_packets_per_sender_max(self.members.len(), frame_bytes);
        Self { frame_bytes, packets_per_sender_max, ..self }
    }

    /// Returns the number of a member. O(log members).
    pub fn number(&self, id: &VehicleId) -> Option<u8> {
        self.members.number(id)
    }

    /// Returns whether a vehicle is a member. O(log members).
    pub fn is_member(&self, id: &VehicleId) -> bool {
        self.number(id).is_some()
    }

    /// Returns whether the team sends and accepts piggybacked outcomes: see [`Team::piggyback`].
    pub fn has_piggyback(&self) -> bool {
        self.piggyback.unwrap_or(self.key.is_none())
    }

    /// Returns the form of the summary packets in a frame of `frame_bytes` bytes.
    ///
    /// # Errors
    /// [`TeamError::FrameTooSmall`] below 32.
    pub fn layout(&self, frame_bytes: usize) -> Result<&'static Layout, TeamError> {
        let has_depth = self.model.inputs.has_depths();
        let layout = Layout::for_frame(frame_bytes, has_depth, self.key.is_some());
        layout.ok_or(TeamError::FrameTooSmall(frame_bytes))
    }
}

/// Default of [`Team::track_tolerance_m`], in cells of the grid.
pub(crate) const DEFAULT_TRACK_TOLERANCE_CELLS: f64 = 0.5;

/// Returns the default of [`Team::packets_per_sender_max`]: the live packets of all other members have about
/// [`DEFAULT_LIVE_POINTS`] inducing points together. The result is from 2 to 64.
fn default_packets_per_sender_max(members: usize, frame_bytes: usize) -> u16 {
    let points = Layout::for_frame(frame_bytes, false, false).map_or(1, Layout::points_in_all);
    (DEFAULT_LIVE_POINTS / points / members.saturating_sub(1).max(1)).clamp(2, 64) as u16
}
