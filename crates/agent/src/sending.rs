//! Who sent when, as far as the host of a vehicle knows it, what the vehicle missed for all it knows, and who keeps to the schedule.

use std::collections::BTreeSet;

use crate::agent::Agent;
use crate::agent_error::AgentError;
use crate::event::{Event, VehicleId};
use crate::placing::unheard;

impl Agent {
    /// Records that a member sent something at these times. Of itself the vehicle says so in its next reports: where members send at
    /// will ([`Slots::at_will`](crate::Slots::at_will)) that is how others come to know what they could have heard. Of others it is
    /// for hosts who know without these: a gap in the numbers of somebody's messages shows what was sent in between. A host that
    /// guesses such times must know the stretch, or ask [`Agent::unheard`] instead: its guess and the sender's word would be two.
    ///
    /// # Errors
    /// [`AgentError::NotMyTurn`] for a time in no slot of this member, and then nothing is recorded.
    pub fn sent(&mut self, member: &VehicleId, times_s: impl IntoIterator<Item = f64>) -> Result<(), AgentError> {
        self.record_turns(member, times_s, true)
    }

    /// Records that it sent nothing in its own slots of these times: its next reports say so, and what others missed of it then
    /// is no event. Members that often do not send stand in [`Slots::may_be_silent`](crate::Slots::may_be_silent).
    ///
    /// # Errors
    /// [`AgentError::NotMyTurn`] for a time in no slot of its own, and then nothing is recorded.
    pub fn stay_silent(&mut self, times_s: impl IntoIterator<Item = f64>) -> Result<(), AgentError> {
        self.record_turns(&self.id.clone(), times_s, false)
    }

    fn record_turns(
        &mut self,
        member: &VehicleId,
        times_s: impl IntoIterator<Item = f64>,
        sent: bool,
    ) -> Result<(), AgentError> {
        let mut slots = Vec::new();
        for time_s in times_s {
            // Whether it sends by the clock that is wrong its host knows.
            let mut by_either = [self.memory.reckoning.team_s(time_s), time_s].into_iter();
            let slot = self.team().number(member);
            let slot = slot.and_then(|_| by_either.find_map(|at_s| self.team().slots.sent_in(at_s, member)));
            slots.push(slot.ok_or_else(|| AgentError::NotMyTurn { id: member.clone(), time_s })?);
        }
        let arrived = self.memory.put_in_turns(member, &slots, sent);
        self.beliefs.note(arrived.change);
        self.beliefs.nothing_new_in = None;
        Ok(())
    }

    /// What members say that they sent from this time on and the vehicle did not hear, as far as it is known where both were: it
    /// missed these if it listened, which its host knows. Whoever [`Agent::observe`]s those, whenever reports came, has recorded what
    /// it missed of members that send at will. Empty for who is no member. O(events + told), each with a logarithm.
    pub fn unheard(&self, from_s: f64) -> Vec<Event> {
        let memory = &self.memory;
        let Some(own) = memory.own else { return Vec::new() };
        let events = unheard(memory.known(), own, memory.track()).into_iter();
        let by_its_clock = events.map(|event| Event { time_s: memory.reckoning.local_s(event.time_s), ..event });
        by_its_clock.filter(|event| event.time_s >= from_s).collect()
    }

    /// Members whom it hears out of their turn, though it misses in turn: their clock or their schedule differs from its own. As soon as
    /// four messages of theirs came so, all in a row, what it heard and missed of them counts as no event and is not told, until they
    /// are in turn again; unless it is its own clock that is wrong, and shows by how much ([`Agent::clock_ahead_slots`]).
    /// None where the team's slots are listed one by one, or members send at will, and for who is no member.
    pub fn out_of_turn(&self) -> BTreeSet<VehicleId> {
        self.memory.reckoning.strange_now().cloned().collect()
    }

    /// By how many slots its clock is ahead of everybody else's; negative where it is behind, 0 where nothing shows that it is either.
    /// Four messages in a row, of two members at least, show it, if all came so many slots after their senders' turns. It allows for it:
    /// who was heard and who was missed follows from the slots that it really was, and where they were from what they told.
    /// Its host should set its clock, but need not mend what it recorded by the wrong one. A clock may be off by less than half a turn of
    /// the order and by 31 slots, so never with fewer than three members; more would not show, nor where members send at will.
    pub fn clock_ahead_slots(&self) -> i32 {
        self.memory.reckoning.ahead_now()
    }
}
