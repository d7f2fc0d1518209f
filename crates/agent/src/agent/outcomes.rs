//! Records outcomes without positions, and positions of other members.

use crate::agent::state::Agent;
use crate::codec::receipt::{Receipt, Refusal};
use crate::error::AgentError;
use crate::store::entry::Entry;
use crate::types::event::{Position, VehicleId};

impl Agent {
    /// Records whether the vehicle heard a message of another member, without the positions of the ends. The vehicle
    /// must have listened, and the member must have transmitted. The outcome counts as an event of its slot as soon as
    /// the positions of both ends are known.
    ///
    /// The position of the vehicle comes from its own track. That of the transmitter comes from
    /// [`Agent::record_peer_position`], or else from the reports of the transmitter. Outcomes outside the slots of
    /// their transmitters never count, because misses outside of slots are not observed. They show a wrong clock. If an
    /// event of the slot is recorded too, the event counts alone. Returns the entry for the journal of the host, or
    /// `None` if the outcome is stored already. O(log N), and O(outcomes) at the next query.
    ///
    /// # Errors
    /// [`AgentError::NotAPeer`] if the transmitter is not another member of the team. [`AgentError::NoTime`] for a time
    /// that is not finite, and [`AgentError::NoSlot`] for one without a numbered slot.
    pub fn record_outcome(
        &mut self,
        transmitter_id: &VehicleId,
        time_s: f64,
        success: bool,
    ) -> Result<Option<Entry>, AgentError> {
        self.record_about_peer(
            transmitter_id,
            Entry::Outcome { time_s, transmitter_id: transmitter_id.clone(), success },
        )
    }

    /// Records a position of another member that the host knows. It locates outcomes without positions, and outcomes
    /// that members piggyback. A position that depends on a reception (`is_independent` is false) locates no outcome of
    /// its own slot, because a missed message would have given no position. Returns the entry for the journal of the
    /// host, or `None` if the position is stored already.
    ///
    /// # Errors
    /// [`AgentError::NotAPeer`] if it is not another member of the team. [`AgentError::NoTime`],
    /// [`AgentError::Nowhere`] and [`AgentError::NoHeading`] for numbers out of bounds.
    pub fn record_peer_position(
        &mut self,
        member: &VehicleId,
        time_s: f64,
        position: Position,
        is_independent: bool,
    ) -> Result<Option<Entry>, AgentError> {
        let entry = Entry::PeerPosition { member: member.clone(), time_s, position, is_independent };
        self.record_about_peer(member, entry)
    }

    /// Returns whether a member transmitted in its slot at a time, as far as the vehicle knows. A member did not if it
    /// reported the slot as unused, its reports of unused slots are reliable, and no member heard it. True for times
    /// outside its slots. O(members log N).
    pub fn has_transmitted(&self, member: &VehicleId, time_s: f64) -> bool {
        let slot = self.team().slots.sent_in(time_s, member);
        let number = self.team().number(member);
        number.zip(slot).is_none_or(|(number, slot)| self.memory.is_transmission(number, slot))
    }

    fn record_about_peer(&mut self, member: &VehicleId, entry: Entry) -> Result<Option<Entry>, AgentError> {
        match self.apply(entry.clone())? {
            Receipt::Accepted => Ok(Some(entry)),
            Receipt::Refused(Refusal::NoSlot { time_s }) => Err(AgentError::NoSlot { time_s }),
            Receipt::Refused(Refusal::Duplicate) => Ok(None),
            Receipt::Refused(_) => Err(AgentError::NotAPeer(member.clone())),
        }
    }
}
