//! Who sent when, as far as the host of a vehicle knows it, and what the vehicle missed for all it knows.

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
            let slot = self.team().number(member).and_then(|_| self.team().slots.sent_in(time_s, member));
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
        let Some(own) = self.memory.own else { return Vec::new() };
        let events = unheard(&self.memory.frames, own, &self.memory.events, self.memory.track(), &self.memory.reports);
        events.into_iter().filter(|event| event.time_s >= from_s).collect()
    }
}
