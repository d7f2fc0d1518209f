//! Members whose data a vehicle does not use after a replay, and why.

use pingmap_agent::{Agent, AgentError, MemberStatus, VehicleId, Which};

/// A member whose data, or a part of them, a vehicle does not use.
#[derive(Debug, Clone, PartialEq)]
pub struct Ignored {
    /// The vehicle that decided.
    pub listener: VehicleId,
    /// The member.
    pub member: VehicleId,
    /// Reason of the decision.
    pub reason: IgnoreReason,
    /// Discrepancy of the member in standard deviations, if it sent data: see [`Agent::discrepancy`].
    pub discrepancy: Option<f64>,
}

/// Reason why a vehicle does not use data of a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IgnoreReason {
    /// Its outcomes or summaries contradict those of all others.
    Contradicts,
    /// Its messages arrive outside its slots.
    OutOfSlot,
    /// The member was received in slots that it reported as unused. Its other data count.
    FalseClaims,
    /// Its reported track contradicts receptions. Its outcomes count.
    WrongTrack,
    /// Some of its frames are ahead of the vehicle's clock. Its other frames count.
    Ahead,
}

impl IgnoreReason {
    /// Returns the reason as a key of files.
    pub fn name(self) -> &'static str {
        match self {
            IgnoreReason::Contradicts => "contradicts",
            IgnoreReason::OutOfSlot => "out-of-slot",
            IgnoreReason::FalseClaims => "false-claims",
            IgnoreReason::WrongTrack => "wrong-track",
            IgnoreReason::Ahead => "ahead",
        }
    }

    fn all_of(status: &MemberStatus) -> impl Iterator<Item = Self> {
        let reasons = [
            (status.is_excluded, IgnoreReason::Contradicts),
            (status.out_of_slot.is_some(), IgnoreReason::OutOfSlot),
            (status.has_false_claims, IgnoreReason::FalseClaims),
            (status.has_wrong_track, IgnoreReason::WrongTrack),
            (status.waiting_frames > 0, IgnoreReason::Ahead),
        ];
        reasons.into_iter().filter(|(applies, _)| *applies).map(|(_, reason)| reason)
    }
}

/// Returns the members whose data these vehicles do not use, in the order of the vehicles.
///
/// # Errors
/// [`AgentError`] for a numerical failure.
pub fn ignored_members(team: &mut [Agent]) -> Result<Vec<Ignored>, AgentError> {
    let mut ignored = Vec::new();
    for agent in team {
        agent.posterior(Which::Fused)?;
        for (member, status) in agent.status().members {
            for reason in IgnoreReason::all_of(&status) {
                let (listener, discrepancy) = (agent.id().clone(), agent.discrepancy(&member)?);
                ignored.push(Ignored { listener, member: member.clone(), reason, discrepancy });
            }
        }
    }
    Ok(ignored)
}
