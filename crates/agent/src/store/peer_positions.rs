//! Positions of other members that the host knows.

use std::collections::BTreeMap;

use crate::store::own_outcomes::Seconds;
use crate::track::position_track::{Track, coordinate_bits};
use crate::types::event::Position;

/// One position by time, and whether it is known independently of receptions.
type Fix = (Position, bool);

/// Positions of other members by time. Of each member the latest ones are stored.
#[derive(Debug, Clone)]
pub(crate) struct PeerPositions {
    max: usize,
    members: BTreeMap<u8, BTreeMap<Seconds, Fix>>,
}

/// The positions of one member as tracks.
#[derive(Debug, Default)]
pub(crate) struct PeerTracks {
    /// Positions that are known whether or not the vehicle receives the member.
    pub(crate) independent: Track,
    /// All positions.
    pub(crate) all: Track,
}

impl PeerPositions {
    pub(crate) fn new(max: usize) -> Self {
        Self { max: max.max(1), members: BTreeMap::new() }
    }

    /// Inserts a position. At one time, a position that is known independently of receptions replaces another one.
    /// Among positions of one kind, the first one in the bitwise order of the coordinates counts. Returns whether
    /// anything changed.
    pub(crate) fn insert(&mut self, member: u8, time_s: f64, position: Position, is_independent: bool) -> bool {
        let fixes = self.members.entry(member).or_default();
        let new = (position, is_independent);
        if fixes.get(&Seconds(time_s)).is_some_and(|stored| order(stored) <= order(&new)) {
            return false;
        }
        fixes.insert(Seconds(time_s), new);
        let removed = if fixes.len() > self.max { fixes.pop_first() } else { None };
        removed.is_none_or(|(removed_s, _)| removed_s != Seconds(time_s))
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = (u8, f64, Position, bool)> {
        self.members.iter().flat_map(|(&member, fixes)| {
            fixes.iter().map(move |(time_s, &(position, is_independent))| (member, time_s.0, position, is_independent))
        })
    }

    /// Returns the tracks of all members. O(N) for N positions.
    pub(crate) fn tracks(&self) -> BTreeMap<u8, PeerTracks> {
        let tracks = |fixes: &BTreeMap<Seconds, Fix>| {
            let with = |is_wanted: fn(&Fix) -> bool| {
                let wanted = fixes.iter().filter(|(_, fix)| is_wanted(fix));
                Track::new(wanted.map(|(time_s, fix)| (time_s.0, fix.0)).collect())
            };
            PeerTracks { independent: with(|fix| fix.1), all: with(|_| true) }
        };
        self.members.iter().map(|(&member, fixes)| (member, tracks(fixes))).collect()
    }
}

impl PeerTracks {
    /// Returns the position at the beginning of a slot that ends at `end_s`. Positions that depend on receptions count
    /// only outside the slot: a position in the message of the slot is known only if the vehicle heard it. `None` where
    /// the positions next to that time are more than `gap_s_max` seconds apart.
    pub(crate) fn at(&self, time_s: f64, end_s: f64, gap_s_max: f64) -> Option<Position> {
        let independent = self.independent.at_within(time_s, gap_s_max);
        independent.or_else(|| self.all.across(time_s, end_s, gap_s_max))
    }
}

/// The order in which positions at one time count.
fn order((position, is_independent): &Fix) -> (bool, [u64; 4]) {
    (!is_independent, coordinate_bits(position))
}
