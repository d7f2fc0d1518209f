//! The state of a vehicle, for its operator.

use std::collections::BTreeMap;

use crate::agent::ignore_reason::IgnoreReason;
use crate::agent::state::Agent;
use crate::inference::fitting::FitQuality;
use crate::types::event::VehicleId;

/// State of a vehicle: see [`Agent::status`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Status {
    /// Every other member.
    pub members: BTreeMap<VehicleId, MemberStatus>,
    /// Offset of the vehicle's own clock in slots, positive where it is ahead: all members that it receives lie outside
    /// their slots by this offset. `None` where nothing shows an offset.
    pub own_clock_offset_slots: Option<i32>,
    /// Number of events that the vehicle stores.
    pub own_events: usize,
    /// Number of the next event in a journal: see [`Entry::Observed`](crate::Entry::Observed).
    pub next_event: u64,
    /// Number of the next transmitted frame in a journal: see [`Entry::Sent`](crate::Entry::Sent).
    pub next_frame: u64,
    /// Number of events of other members whose positions are known.
    pub located_events: usize,
    /// Number of events of other members that wait for a position of either end.
    pub unlocated_events: usize,
    /// Length of the longest link in own events, in data of trusted members, and in the site prior; `None` before any.
    pub longest_link_m: Option<f64>,
    /// Number of summary packets that count, own ones among them.
    pub live_packets: usize,
    /// Number of received packets by [`Receipt::class`](crate::Receipt::class). Classes without packets are missing.
    pub counts: BTreeMap<&'static str, u64>,
    /// Weight of the alternative model in predictions: see [`Agent::average_with`]; 0 without one.
    pub alternative_weight: f64,
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
    /// Reasons why the vehicle does not use data of the member, or a part of them. Each has the time of the vehicle's
    /// clock since when, in seconds. Empty if all data count.
    pub ignored: BTreeMap<IgnoreReason, f64>,
    /// Number of counters of the member that stand on different packets: two vehicles use its number, or it lost its
    /// memory.
    pub conflicts: usize,
    /// Number of its frames that are ahead of the vehicle's clock and wait for it: the clock of the member or of the
    /// vehicle is wrong.
    pub waiting_frames: usize,
    /// The clock offset in slots that fits receptions of the member outside its slots, if only one does; positive where
    /// messages arrive late.
    pub clock_offset_slots: Option<i32>,
}

impl MemberStatus {
    /// Returns whether the vehicle does not use data of the member for this reason.
    pub fn is_ignored(&self, reason: IgnoreReason) -> bool {
        self.ignored.contains_key(&reason)
    }
}

impl Agent {
    /// Returns the state of the vehicle and of every other member, as of the last update. O(members · remote events) at
    /// most.
    pub fn status(&self) -> Status {
        let memory = &self.memory;
        let slots = &self.team().slots;
        let now_s = memory.clock.latest_s();
        let since_s = |key: (u8, IgnoreReason)| self.ignored_since_s.get(&key).copied().unwrap_or(now_s);
        let offsets = memory.conformance.out_of_slot(slots);
        let member = |number: u8, id: &VehicleId| MemberStatus {
            last_heard_s: self.last_heard_s.get(&number).copied(),
            ignored: self.ignore_reasons(number, id).map(|reason| (reason, since_s((number, reason)))).collect(),
            conflicts: memory.packets.conflicts(number),
            waiting_frames: memory.clock.waiting_of(number),
            clock_offset_slots: offsets.get(id).copied().flatten(),
        };
        Status {
            members: self.other_members().map(|(&number, id)| (id.clone(), member(number, id))).collect(),
            own_clock_offset_slots: memory.conformance.own_offset(slots),
            own_events: memory.events.len(),
            next_event: memory.events.next_number(),
            next_frame: memory.next_transmission_number(),
            located_events: memory.located().events.len(),
            unlocated_events: memory.located().unlocated.len(),
            longest_link_m: self.longest_m(),
            live_packets: memory.own_packets().count() + self.accepted().packets.len(),
            counts: self.counts.clone(),
            alternative_weight: self.alternative_weight(),
            fit: self.posteriors.own_fit.as_ref().map(|own| FitQuality::of(&own.fit)),
            is_dense: memory.events.len() <= self.team().limits.dense_events_max,
        }
    }

    fn other_members(&self) -> impl Iterator<Item = (&u8, &VehicleId)> {
        self.team().members.iter().filter(|(number, _)| Some(**number) != self.memory.own)
    }

    /// Returns the reasons why the vehicle does not use data of a member.
    fn ignore_reasons(&self, number: u8, id: &VehicleId) -> impl Iterator<Item = IgnoreReason> {
        let memory = &self.memory;
        let all = [
            (IgnoreReason::Muted, memory.muted.contains(&number)),
            (IgnoreReason::Contradicts, self.posteriors.excluded.contains(&number)),
            (IgnoreReason::OutOfSlot, memory.conformance.is_out_of_slot(id, f64::INFINITY)),
            (IgnoreReason::FalseClaims, !memory.claims.is_reliable(number)),
            (IgnoreReason::WrongTrack, memory.located().wrong_tracks.contains(&number)),
            (IgnoreReason::Ahead, memory.clock.waiting_of(number) > 0),
        ];
        all.into_iter().filter(|(_, applies)| *applies).map(|(reason, _)| reason)
    }

    /// Notes since when data of members are not used.
    pub(crate) fn note_ignored(&mut self) {
        let now_s = self.memory.clock.latest_s();
        let keys = |(&number, id)| self.ignore_reasons(number, id).map(move |reason| (number, reason));
        let since_s = |key| (key, self.ignored_since_s.get(&key).copied().unwrap_or(now_s));
        self.ignored_since_s = self.other_members().flat_map(keys).map(since_s).collect();
    }
}
