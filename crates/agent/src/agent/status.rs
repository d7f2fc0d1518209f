//! The state of a vehicle, for its operator.

use std::collections::BTreeMap;

use crate::agent::state::Agent;
use crate::codec::receipt::Counts;
use crate::inference::fitting::FitQuality;
use crate::types::event::VehicleId;

/// State of a vehicle: see [`Agent::status`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Status {
    /// Every other member.
    pub members: BTreeMap<VehicleId, MemberStatus>,
    /// Offset of the vehicle's own clock in slots, positive where it is ahead: all members that it receives lie outside their slots by
    /// this offset. `None` where nothing shows an offset.
    pub own_clock_offset_slots: Option<i32>,
    /// Number of events that the vehicle recorded.
    pub own_events: usize,
    /// Number of events of other members whose positions are known.
    pub located_events: usize,
    /// Number of events of other members that wait for a position of either end.
    pub unlocated_events: usize,
    /// Length of the longest link in own events, in data of trusted members, and in the site prior; `None` before any.
    pub longest_link_m: Option<f64>,
    /// Number of summary packets that count, own ones among them.
    pub live_packets: usize,
    /// Received packets by result.
    pub counts: Counts,
    /// Quality of the last fit of own events; `None` before the first.
    pub fit: Option<FitQuality>,
    /// Whether the last fit was dense, or will be.
    pub is_dense: bool,
}

/// State of one member as the vehicle sees it.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct MemberStatus {
    /// Time of the last packet of the member that counted, in seconds.
    pub last_heard_s: Option<f64>,
    /// Whether the vehicle ignores the member at the request of its host.
    pub is_muted: bool,
    /// Whether the member is excluded because its data contradict those of all others.
    pub is_excluded: bool,
    /// Whether its reports of unused slots are ignored because the vehicle received it in at least three of them.
    pub has_false_claims: bool,
    /// Whether its reported track is ignored because most receptions of the member contradict it.
    pub has_wrong_track: bool,
    /// Number of counters of the member that stand on different packets: two vehicles use its number, or it lost its memory.
    pub conflicts: usize,
    /// Number of its frames that are ahead of the vehicle's clock and wait for it: the clock of the member or of the vehicle is wrong.
    pub waiting_frames: usize,
    /// Set if the member's messages arrive outside its slots.
    pub out_of_slot: Option<OutOfSlot>,
}

/// A member whose last four messages arrived outside its slots: its clock or its schedule is wrong. Its outcomes are ignored meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OutOfSlot {
    /// The clock offset in slots that fits, if only one does; positive where messages arrive late.
    pub offset_slots: Option<i32>,
}

impl Agent {
    /// Returns the state of the vehicle and of every other member, as of the last update. O(members · remote events) at most.
    pub fn status(&self) -> Status {
        let memory = &self.memory;
        let slots = &self.team().slots;
        let out_of_slot = memory.conformance.out_of_slot(slots);
        let member = |number: u8, id: &VehicleId| MemberStatus {
            last_heard_s: self.last_heard_s.get(&number).copied(),
            is_muted: memory.muted.contains(&number),
            is_excluded: self.posteriors.excluded.contains(&number),
            has_false_claims: !memory.claims.is_reliable(number),
            has_wrong_track: memory.located().wrong_tracks.contains(&number),
            conflicts: memory.packets.conflicts(number),
            waiting_frames: memory.clock.waiting_of(number),
            out_of_slot: out_of_slot.get(id).map(|&offset_slots| OutOfSlot { offset_slots }),
        };
        let others = self.team().members.iter().filter(|(number, _)| Some(**number) != memory.own);
        Status {
            members: others.map(|(&number, id)| (id.clone(), member(number, id))).collect(),
            own_clock_offset_slots: memory.conformance.own_offset(slots),
            own_events: memory.events.len(),
            located_events: memory.located().events.len(),
            unlocated_events: memory.located().unlocated.len(),
            longest_link_m: self.longest_m(),
            live_packets: memory.own_packets().count() + self.accepted().packets.len(),
            counts: self.counts,
            fit: self.posteriors.own_fit.as_ref().map(|own| FitQuality::of(&own.fit)),
            is_dense: memory.events.len() <= self.team().limits.dense_events_max,
        }
    }
}
