//! The state of the vehicle, for its host.

use crate::protocol::output::{MemberReport, Message, StatusReport, StoreState};
use crate::vehicle::state::Vehicle;

impl Vehicle {
    /// Returns the state. `input` is the number of the request.
    pub(crate) fn status_report(&self, input: u64) -> Message {
        let status = self.agent.status();
        let member = |member: &pingmap_agent::MemberStatus| MemberReport {
            last_heard: member.last_heard_s,
            ignored: member.ignored.iter().map(|(reason, &since_s)| (reason.name().to_owned(), since_s)).collect(),
            waiting_frames: member.waiting_frames,
            clock_offset_slots: member.clock_offset_slots,
        };
        let problem = self.store_problem.as_ref().or(self.silence.as_ref());
        let store = problem.map_or(StoreState::Stored, |problem| StoreState::Failed { problem: problem.clone() });
        Message::Status(Box::new(StatusReport {
            input,
            time: self.ledger.clock_s().unwrap_or_default(),
            store,
            warnings: self.warnings.clone(),
            trust: self.scores.trust(),
            own_events: status.own_events,
            located_events: status.located_events,
            unlocated_events: status.unlocated_events,
            excluded_slots: self.ledger.excluded.clone(),
            late_receptions: self.late_receptions,
            late_reports: self.late_reports,
            open_frames: self.open_frames.len(),
            frames: status.counts.into_iter().map(|(class, count)| (class.to_owned(), count)).collect(),
            clock_offset_slots: status.own_clock_offset_slots,
            members: status.members.iter().map(|(id, status)| (id.clone(), member(status))).collect(),
        }))
    }
}
