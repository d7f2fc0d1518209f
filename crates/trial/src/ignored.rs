//! Members whose data a vehicle does not use after a replay, and why.

use pingmap_agent::{Agent, AgentError, IgnoreReason, VehicleId, Which};

/// A member whose data, or a part of them, a vehicle does not use.
#[derive(Debug, Clone, PartialEq)]
pub struct Ignored {
    /// The vehicle that decided.
    pub listener: VehicleId,
    /// The member.
    pub member: VehicleId,
    /// Reason of the decision.
    pub reason: IgnoreReason,
    /// Time of the vehicle's clock since when, in seconds.
    pub since_s: f64,
    /// Discrepancy of the member in standard deviations, if it sent data: see [`Agent::discrepancy`].
    pub discrepancy: Option<f64>,
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
            for (reason, since_s) in status.ignored {
                let (listener, discrepancy) = (agent.id().clone(), agent.discrepancy(&member)?);
                ignored.push(Ignored { listener, member: member.clone(), reason, since_s, discrepancy });
            }
        }
    }
    Ok(ignored)
}
