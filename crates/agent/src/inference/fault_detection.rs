//! Detects faulty members: members whose data contradict the data of all others (docs/method/faulty-members.md).

use std::collections::BTreeSet;

use dgpc::{Observations, Posterior, Shift, Summary, spread_out};

use crate::error::AgentError;
use crate::inference::accepted::{AcceptedData, packets_with, summaries_under};
use crate::inference::posterior_pair::PosteriorPair;
use crate::inference::posteriors::Posteriors;
use crate::store::events::RecordedEvent;
use crate::store::memory::Memory;
use crate::types::event::Event;
use crate::types::query::LinkQuery;

/// Share of the exclusion threshold above which a member is a suspect as soon as any member exceeds the threshold.
const SUSPECT_SHARE: f64 = 0.6;

/// Standard deviation of the offset between receivers, in logits. A common offset of all data of one member is no
/// discrepancy up to this size, because hydrophones differ.
const RECEIVER_OFFSET_SD: f64 = 0.5;

/// Maximum number of remote events of a member that are compared with a posterior.
const EXAMINED_EVENTS_MAX: usize = 200;

/// Factor on the exclusion threshold above which a member is faulty whatever its effect on predictions.
const CERTAIN_FACTOR: f64 = 2.0;

/// Number of standard errors by which a member's data must worsen predictions of the vehicle's own events.
const HARM_SE: f64 = 3.0;

/// Number of parts in which the vehicle's own events are held out.
const FOLDS: usize = 4;

/// Excluded members, and the own and the fused posterior without their data.
type Exclusion = (BTreeSet<u8>, PosteriorPair);

impl Posteriors {
    /// Detects faulty members. Returns the excluded members with the posteriors without them, or `None` if they are
    /// unchanged.
    ///
    /// Between fits, only members with new packets are examined: O(M n²) for M inducing points of their packets. If one
    /// of them exceeds the threshold or was excluded, all members are examined. After a fit, all members are examined
    /// at O(n³) for each member with remote events. Every new exclusion, and every readmission, takes O(n³).
    pub(crate) fn detect_faulty_members(
        &self,
        memory: &Memory,
        data: &AcceptedData,
    ) -> Result<Option<Exclusion>, AgentError> {
        let Some(examined) = &self.examined else { return self.examine_all(memory, data) };
        let changed: BTreeSet<u8> = examined.symmetric_difference(&data.packets).map(|key| key.0).collect();
        let threshold = memory.codec.team.exclusion_threshold_sd;
        for &member in &changed {
            if self.excluded.contains(&member)
                || packet_discrepancy(self.pair.fused(), memory, &data.of_member(member), Posterior::shift_of)?
                    > threshold
            {
                return self.examine_all(memory, data);
            }
        }
        Ok(None)
    }

    /// Examines all members and excludes faulty ones, one at a time, until no remaining member exceeds the threshold.
    ///
    /// A faulty member that claims high certainty increases the discrepancies of correct members, and its own may be
    /// smaller. If one member exceeds the threshold, all members near it are therefore suspects. The suspect that
    /// contradicts the vehicle's own events most is excluded. The result depends only on the accepted data and the last
    /// fit.
    fn examine_all(&self, memory: &Memory, data: &AcceptedData) -> Result<Option<Exclusion>, AgentError> {
        let threshold = memory.codec.team.exclusion_threshold_sd;
        let mut excluded = BTreeSet::new();
        loop {
            let trusted = data.without(&excluded);
            let is_unchanged = excluded == self.excluded;
            let pair = match is_unchanged {
                true => self.pair.clone(),
                false => self.pair_of(memory, &trusted)?,
            };
            let discrepancy =
                |&member: &u8| Ok((self.discrepancy_of_trusted(memory, pair.fused(), &trusted, member)?, member));
            let members = trusted.members(memory.own);
            let discrepancies = members.iter().map(discrepancy).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
            if !self.is_any_faulty(memory, &trusted, &discrepancies)? {
                return Ok((!is_unchanged).then_some((excluded, pair)));
            }
            let suspects = discrepancies.iter().filter(|&&(discrepancy, _)| discrepancy > SUSPECT_SHARE * threshold);
            excluded.extend(self.most_contradicted(memory, data, suspects.map(|&(_, member)| member))?);
        }
    }

    /// Returns whether any of these members is faulty: its discrepancy exceeds the threshold twice, or once and its
    /// data harm.
    fn is_any_faulty(
        &self,
        memory: &Memory,
        trusted: &AcceptedData,
        discrepancies: &[(f64, u8)],
    ) -> Result<bool, AgentError> {
        let threshold = memory.codec.team.exclusion_threshold_sd;
        for &(discrepancy, member) in discrepancies.iter().filter(|&&(discrepancy, _)| discrepancy > threshold) {
            if discrepancy > CERTAIN_FACTOR * threshold || self.is_harmful(memory, trusted, member)? {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Returns whether the data of a member worsen predictions of the vehicle's own events by more than three standard
    /// errors.
    ///
    /// A kernel that does not represent the water makes correct members look discrepant, but their data do little harm
    /// to predictions. Each quarter of the own events, in the order of time, is predicted from the others with and
    /// without the member's data. Without own events the answer is true. O(n³).
    fn is_harmful(&self, memory: &Memory, trusted: &AcceptedData, member: u8) -> Result<bool, AgentError> {
        let others = trusted.without(&BTreeSet::from([member]));
        let events: Vec<&RecordedEvent> = memory.counting_events().collect();
        if events.is_empty() {
            return Ok(true);
        }
        let mut losses = Vec::new();
        for fold in 0..FOLDS {
            let held_out = &events[fold * events.len() / FOLDS..(fold + 1) * events.len() / FOLDS];
            let omitted = held_out.iter().map(|recorded| recorded.number).collect();
            let without = self.fused_at_fit(memory, &others, &omitted)?;
            let with = absorbed(without.clone(), memory, &trusted.of_member(member))?;
            let queries: Vec<LinkQuery> = held_out.iter().map(|recorded| recorded.event.query()).collect();
            let inputs = memory.codec.team.model.inputs(&queries)?;
            let [with, without] = [with.latent(&inputs)?.probability(), without.latent(&inputs)?.probability()];
            let loss = |(recorded, (with, without)): (&&RecordedEvent, (f64, f64))| {
                let log_likelihood = |p: f64| {
                    let likelihood = if recorded.event.success { p } else { 1.0 - p };
                    // A probability rounded to 0 or 1 has a finite loss.
                    likelihood.max(f64::MIN_POSITIVE).ln()
                };
                log_likelihood(without) - log_likelihood(with)
            };
            losses.extend(held_out.iter().zip(with.into_iter().zip(without)).map(loss));
        }
        let count = losses.len() as f64;
        let mean = losses.iter().sum::<f64>() / count;
        let variance = losses.iter().map(|loss| (loss - mean).powi(2)).sum::<f64>() / count;
        Ok(mean > HARM_SE * (variance / count).sqrt())
    }

    /// Returns the suspect that contradicts the vehicle's own events most.
    fn most_contradicted(
        &self,
        memory: &Memory,
        data: &AcceptedData,
        suspects: impl Iterator<Item = u8>,
    ) -> Result<Option<u8>, AgentError> {
        let alone = self.pair_of(memory, &AcceptedData::default())?;
        let discrepancy = |member| Ok((discrepancy_from(memory, alone.fused(), &data.of_member(member))?, member));
        let discrepancies = suspects.map(discrepancy).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
        Ok(discrepancies.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, member)| member))
    }

    /// Returns the discrepancy of a member, trusted or excluded: see [`crate::Agent::discrepancy`].
    pub(crate) fn discrepancy_of(&self, memory: &Memory, data: &AcceptedData, member: u8) -> Result<f64, AgentError> {
        let trusted = data.without(&self.excluded);
        match self.excluded.contains(&member) {
            true => discrepancy_from(memory, self.pair.fused(), &data.of_member(member)),
            false => self.discrepancy_of_trusted(memory, self.pair.fused(), &trusted, member),
        }
    }

    /// Returns the discrepancy of a trusted member. `posterior` includes the data of all trusted members. Packets are
    /// subtracted from it. With remote events, the posterior of the others is computed: O(n³).
    fn discrepancy_of_trusted(
        &self,
        memory: &Memory,
        posterior: &Posterior,
        trusted: &AcceptedData,
        member: u8,
    ) -> Result<f64, AgentError> {
        let member_data = trusted.of_member(member);
        if member_data.events.is_empty() {
            return packet_discrepancy(posterior, memory, &member_data, Posterior::shift_of);
        }
        let without = self.pair_of(memory, &trusted.without(&BTreeSet::from([member])))?;
        discrepancy_from(memory, without.fused(), &member_data)
    }
}

fn absorbed(mut posterior: Posterior, memory: &Memory, member_data: &AcceptedData) -> Result<Posterior, AgentError> {
    let packets = packets_with(memory, &*member_data.packets);
    let read = summaries_under(&packets, posterior.prior())?;
    posterior.absorb_summaries(&read.iter().map(AsRef::as_ref).collect::<Vec<_>>())?;
    dgpc::absorb_observations(&mut posterior, &observations(memory, member_data)?)?;
    Ok(posterior)
}

/// Returns the outcomes of a member as observations: up to 200, spread over time.
fn observations(memory: &Memory, member_data: &AcceptedData) -> dgpc::Result<Observations> {
    let events: Vec<&Event> = member_data.events.values().map(|event| &**event).collect();
    memory.codec.team.model.observations_among(&events, &spread_out(events.len(), EXAMINED_EVENTS_MAX))
}

/// Returns the discrepancy of a member's data from a posterior without them, in standard deviations. It is the larger
/// one of two: the shift by its packets, and the contradiction of its outcomes.
fn discrepancy_from(memory: &Memory, posterior: &Posterior, member_data: &AcceptedData) -> Result<f64, AgentError> {
    let of_packets = packet_discrepancy(posterior, memory, member_data, Posterior::shift_by)?;
    let observations = observations(memory, member_data)?;
    Ok(of_packets.max(posterior.contradiction(&observations, RECEIVER_OFFSET_SD)?))
}

/// Returns the largest shift of a posterior by the packets of a member, in standard deviations of the posterior without
/// them. `shift` is [`Posterior::shift_of`] for a posterior that includes the packets, and [`Posterior::shift_by`] for
/// one that does not.
fn packet_discrepancy(
    posterior: &Posterior,
    memory: &Memory,
    member_data: &AcceptedData,
    shift: impl Fn(&Posterior, &[&Summary]) -> dgpc::Result<Shift>,
) -> Result<f64, AgentError> {
    let packets = packets_with(memory, &*member_data.packets);
    let read = summaries_under(&packets, posterior.prior())?;
    match shift(posterior, &read.iter().map(AsRef::as_ref).collect::<Vec<_>>()) {
        Ok(shift) => Ok(shift.largest(RECEIVER_OFFSET_SD)),
        // The packets claim so high a certainty that they cannot be subtracted numerically.
        Err(dgpc::Error::NotPositiveDefinite { .. }) => Ok(f64::INFINITY),
        Err(error) => Err(error.into()),
    }
}
