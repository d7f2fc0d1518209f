//! Whom a vehicle believes.

use std::collections::BTreeSet;

use dgpc::{Posterior, Shift, Summary, spread_out};

use crate::agent_error::AgentError;
use crate::beliefs::Beliefs;
use crate::event::Event;
use crate::heard::{Heard, said, summaries};
use crate::memory::Memory;
use crate::reports::Worth;

/// Share of the threshold of surprise from which on a member is suspect when another one is above.
const NEAR: f64 = 0.6;

/// Ears differ: an offset of a member, common to all that it says, surprises only where it is beyond this many logits.
const OFFSET_SD: f64 = 0.5;

/// So many of the events that a member told are looked at.
const LOOKED_AT_MAX: usize = 200;

/// Who is left out, and the own and the fused posterior without them.
type Verdict = (BTreeSet<u8>, [Posterior; 2]);

impl Beliefs {
    /// Who is to be left out, given what was heard, and the fused posterior without them; none where it is as it was.
    /// Between fits only members that sent packets since the last time are looked at, and everybody as soon as one of
    /// them is surprising, or was: O(M n²) for each of their M points, and O(n³) where somebody goes or comes back. At a fit,
    /// O(n³) for everybody who told events.
    pub(crate) fn judge(&self, memory: &Memory, heard: &Heard) -> Result<Option<Verdict>, AgentError> {
        let Some(judged) = &self.judged else { return self.surprising(memory, heard) };
        let changed = judged.iter().filter(|(key, worth)| heard.packets.get(key) != Some(worth));
        let came = heard.packets.keys().filter(|key| !judged.contains_key(key));
        let speakers: BTreeSet<u8> = changed.map(|(key, _)| key.0).chain(came.map(|key| key.0)).collect();
        let threshold = memory.frames.team.surprise_max;
        for &speaker in &speakers {
            if self.left_out.contains(&speaker)
                || surprise_of_packets(&self.fused, memory, &heard.of_member(speaker), Posterior::shift_of)? > threshold
            {
                return self.surprising(memory, heard);
            }
        }
        Ok(None)
    }

    /// Who surprises is left out, one after the other, until nobody who is left is too surprising. Somebody who claims to
    /// be very sure makes all honest members look surprising, and may look less so himself: of those that come near the
    /// threshold when one is above, the one goes first whom the vehicle's own events contradict most. Depends on what was
    /// heard and the last fit alone.
    fn surprising(&self, memory: &Memory, heard: &Heard) -> Result<Option<Verdict>, AgentError> {
        let threshold = memory.frames.team.surprise_max;
        let mut left_out = BTreeSet::new();
        loop {
            let believed = heard.without(&left_out);
            let is_as_it_was = left_out == self.left_out;
            let [own, posterior] = match is_as_it_was {
                true => [self.own.clone(), self.fused.clone()],
                false => self.own_and_fused(memory, &believed)?,
            };
            let moved = |&member: &u8| {
                let others = believed.without(&BTreeSet::from([member]));
                Ok((self.surprise_in(memory, &posterior, &believed, &others, member)?, member))
            };
            let others = believed.others(memory.own);
            let surprises = others.iter().map(moved).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
            if surprises.iter().all(|&(surprise, _)| surprise <= threshold) {
                return Ok((!is_as_it_was).then_some((left_out, [own, posterior])));
            }
            let suspects = surprises.iter().filter(|&&(surprise, _)| surprise > NEAR * threshold);
            left_out.extend(self.most_contradicted(memory, heard, suspects.map(|&(_, member)| member))?);
        }
    }

    /// Of these members the one whom the vehicle's own events contradict most.
    fn most_contradicted(
        &self,
        memory: &Memory,
        heard: &Heard,
        suspects: impl Iterator<Item = u8>,
    ) -> Result<Option<u8>, AgentError> {
        let [_, alone] = self.own_and_fused(memory, &Heard::default())?;
        let contradicted = |member| Ok((surprise_beside(memory, &alone, &heard.of_member(member))?, member));
        let contradicted = suspects.map(contradicted).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
        Ok(contradicted.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, member)| member))
    }

    /// See [`crate::Agent::surprise`].
    pub(crate) fn surprise_of(&self, memory: &Memory, heard: &Heard, member: u8) -> Result<f64, AgentError> {
        let believed = heard.without(&self.left_out);
        match self.left_out.contains(&member) {
            true => surprise_beside(memory, &self.fused, &heard.of_member(member)),
            false => {
                let others = believed.without(&BTreeSet::from([member]));
                self.surprise_in(memory, &self.fused, &believed, &others, member)
            }
        }
    }

    /// How far a member is from what others say, given a posterior that holds all of them.
    fn surprise_in(
        &self,
        memory: &Memory,
        posterior: &Posterior,
        believed: &Heard,
        others: &Heard,
        member: u8,
    ) -> Result<f64, AgentError> {
        let its = believed.of_member(member);
        if its.told.is_empty() {
            return surprise_of_packets(posterior, memory, &its, Posterior::shift_of);
        }
        let [_, without] = self.own_and_fused(memory, others)?;
        surprise_beside(memory, &without, &its)
    }
}

/// How far what a member says is from a posterior that does not hold it: how far its packets would move that, and how far the
/// outcomes that it told contradict it.
fn surprise_beside(memory: &Memory, posterior: &Posterior, its: &Heard) -> Result<f64, AgentError> {
    let of_packets = surprise_of_packets(posterior, memory, its, Posterior::shift_by)?;
    let told: Vec<&Event> = its.told.values().map(|event| &**event).collect();
    let looked_at = spread_out(told.len(), LOOKED_AT_MAX);
    let told = memory.frames.team.model.observations_among(&told, &looked_at)?;
    Ok(of_packets.max(posterior.contradiction(&told, OFFSET_SD)?))
}

/// How far the packets of a member move a posterior, in standard deviations of what is known without them.
fn surprise_of_packets(
    posterior: &Posterior,
    memory: &Memory,
    its: &Heard,
    shift: impl Fn(&Posterior, &[&Summary]) -> dgpc::Result<Shift>,
) -> Result<f64, AgentError> {
    // Without told events what counts beyond them counts in full.
    let packets = [Worth::All, Worth::Beyond].map(|worth| said(memory, &its.packets, worth)).concat();
    let prior = posterior.prior();
    let read = summaries(&packets).into_iter().map(|summary| summary.read_under(prior));
    let read: Vec<_> = read.collect::<Result<_, dgpc::Error>>()?;
    match shift(posterior, &read.iter().map(AsRef::as_ref).collect::<Vec<_>>()) {
        Ok(shift) => Ok(shift.largest(OFFSET_SD)),
        // So much certainty that nothing can be told of what would be known without it.
        Err(dgpc::Error::NotPositiveDefinite { .. }) => Ok(f64::INFINITY),
        Err(error) => Err(error.into()),
    }
}
