//! The own and the fused posterior of a vehicle.

use dgpc::{Observations, Posterior, Summary};

/// The posterior of the vehicle's own events, and the fused posterior.
///
/// Both are stored once until data of other members count, or a model of the vehicle's own.
#[derive(Debug, Clone)]
pub(crate) struct PosteriorPair {
    /// Posterior of the vehicle's own events, under the team's model.
    pub(crate) own: Posterior,
    /// Posterior of own events and of accepted data of other members, under the vehicle's own model if it learned one.
    /// `None` if it equals `own`.
    fused: Option<Posterior>,
}

impl PosteriorPair {
    /// Creates a pair. Without a fused posterior, both are equal.
    pub(crate) fn new(own: Posterior, fused: Option<Posterior>) -> Self {
        Self { own, fused }
    }

    /// Returns the fused posterior.
    pub(crate) fn fused(&self) -> &Posterior {
        self.fused.as_ref().unwrap_or(&self.own)
    }

    /// Absorbs an own event into both posteriors. Under the vehicle's own model the event has a different site. O(n²).
    pub(crate) fn absorb_own(&mut self, observation: &Observations) -> dgpc::Result<()> {
        let site = dgpc::absorb_observations(&mut self.own, observation)?;
        match &mut self.fused {
            None => Ok(()),
            Some(fused) if fused.prior() == self.own.prior() => fused.absorb_events(&site),
            Some(fused) => dgpc::absorb_observations(fused, observation).map(drop),
        }
    }

    /// Absorbs events of other members into the fused posterior. O(n²) an event.
    pub(crate) fn absorb_remote(&mut self, observations: &Observations) -> dgpc::Result<()> {
        if !observations.is_empty() {
            dgpc::absorb_observations(self.distinct_fused(), observations)?;
        }
        Ok(())
    }

    /// Absorbs summaries of other members into the fused posterior. O(n²) an inducing point.
    pub(crate) fn absorb_summaries(&mut self, summaries: &[&Summary]) -> dgpc::Result<()> {
        match summaries {
            [] => Ok(()),
            _ => self.distinct_fused().absorb_summaries(summaries),
        }
    }

    fn distinct_fused(&mut self) -> &mut Posterior {
        self.fused.get_or_insert_with(|| self.own.clone())
    }
}

#[cfg(test)]
#[path = "../../tests/unit/posterior_pair.rs"]
mod tests;
