//! Whom a vehicle believes.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::{Posterior, Shift, Summary, spread_out};

use crate::agent_error::AgentError;
use crate::beliefs::Beliefs;
use crate::heard::{Heard, said, summaries};
use crate::memory::Memory;
use crate::reports::Worth;

/// Share of the threshold of surprise from which on a member is suspect when another one is above.
const NEAR: f64 = 0.6;

/// Ears differ: an offset of a member, common to all that it says, surprises only where it is beyond this many logits.
const OFFSET_SD: f64 = 0.5;

/// So many of the events that a member told are looked at.
const LOOKED_AT_MAX: usize = 48;

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
                || surprise_of_packets(&self.fused, memory, heard, speaker, Posterior::shift_of)? > threshold
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
            let surprises = believed.members().iter().map(moved).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
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
        let contradicted =
            |member| Ok((self.surprise_beside(memory, &alone, &Heard::default(), heard, member)?, member));
        let contradicted = suspects.map(contradicted).collect::<Result<Vec<(f64, u8)>, AgentError>>()?;
        Ok(contradicted.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, member)| member))
    }

    /// See [`crate::Agent::surprise`].
    pub(crate) fn surprise_of(&self, memory: &Memory, heard: &Heard, member: u8) -> Result<f64, AgentError> {
        let believed = heard.without(&self.left_out);
        match self.left_out.contains(&member) {
            true => self.surprise_beside(memory, &self.fused, &believed, heard, member),
            false => {
                let others = believed.without(&BTreeSet::from([member]));
                self.surprise_in(memory, &self.fused, &believed, &others, member)
            }
        }
    }

    /// How far a member moved a posterior that holds what it says.
    fn surprise_in(
        &self,
        memory: &Memory,
        posterior: &Posterior,
        believed: &Heard,
        others: &Heard,
        member: u8,
    ) -> Result<f64, AgentError> {
        if believed.of_member(member).told.is_empty() {
            return surprise_of_packets(posterior, memory, believed, member, Posterior::shift_of);
        }
        // Told events beside the last fit are in neither.
        let [_, with] = match self.taken.told_beside[0] > 0 {
            true => self.own_and_fused(memory, believed)?,
            false => [self.own.clone(), posterior.clone()],
        };
        let [_, without] = self.own_and_fused(memory, others)?;
        moved(memory, &without, &with, &believed.of_member(member))
    }

    /// How far a member would move a posterior that holds what some others say.
    fn surprise_beside(
        &self,
        memory: &Memory,
        posterior: &Posterior,
        others: &Heard,
        heard: &Heard,
        member: u8,
    ) -> Result<f64, AgentError> {
        let its = heard.of_member(member);
        if its.told.is_empty() {
            return surprise_of_packets(posterior, memory, heard, member, Posterior::shift_by);
        }
        let mut with = others.clone();
        with.packets.extend(&its.packets);
        Arc::make_mut(&mut with.told).extend(its.told.iter().map(|(&key, event)| (key, event.clone())));
        let [_, with] = self.own_and_fused(memory, &with)?;
        moved(memory, posterior, &with, &its)
    }
}

/// By how much what a member says moved a posterior, where its events took place and its packets speak of.
fn moved(memory: &Memory, without: &Posterior, with: &Posterior, its: &Heard) -> Result<f64, AgentError> {
    let told: Vec<_> = its.told.values().collect();
    let looked_at = spread_out(told.len(), LOOKED_AT_MAX).into_iter().map(|place| told[place].attempt());
    let mut points = memory.frames.team.model.inputs(looked_at)?;
    let packets = [Worth::All, Worth::Beyond].map(|worth| said(memory, &its.packets, worth)).concat();
    summaries(&packets).into_iter().try_for_each(|summary: &Summary| points.append(summary.inducing_points()))?;
    let (before, after) = (without.latent(&points)?, with.latent(&points)?);
    let mean = after.mean.iter().zip(&before.mean).map(|(after, before)| after - before).collect();
    let prior_variance = without.prior().kernel().diagonal(&points)?;
    Ok(Shift { mean, variance: before.variance, prior_variance }.largest(OFFSET_SD))
}

/// How far the packets of a member move a posterior, in standard deviations of what is known without them.
fn surprise_of_packets(
    posterior: &Posterior,
    memory: &Memory,
    heard: &Heard,
    member: u8,
    shift: impl Fn(&Posterior, &[&Summary]) -> dgpc::Result<Shift>,
) -> Result<f64, AgentError> {
    // Without told events what counts beyond them counts in full.
    let its = heard.of_member(member).packets;
    let packets = [Worth::All, Worth::Beyond].map(|worth| said(memory, &its, worth)).concat();
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
