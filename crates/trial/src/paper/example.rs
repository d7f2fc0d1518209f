//! One permutation as an example for figures.

use std::collections::BTreeMap;

use dgpc::{Concatenation, Error};

use super::choice::{Choice, Omega, Policy};
use super::fit::{Chosen, RegionFit};
use super::permutation::{Part, Permutation};

/// Choices and predictions of one permutation. Events are indices of the log.
#[derive(Debug, Clone)]
pub struct Example {
    /// Number of the permutation, counted from 0.
    pub permutation: usize,
    /// Region and points of every agent.
    pub agents: Vec<AgentExample>,
    /// Held-out events of all regions, with the team's predictions from two points of every agent, concatenated, at the
    /// last draw of ω. One list per policy.
    pub predictions: BTreeMap<Policy, Vec<(usize, f64)>>,
}

/// One agent's region.
#[derive(Debug, Clone)]
pub struct AgentExample {
    /// Events of the region.
    pub part: Part,
    /// Chosen points among the training events.
    pub points: BTreeMap<Choice, Vec<usize>>,
}

/// Returns `None` if a region has no training or held-out events.
pub(super) fn example(permutation: &Permutation<'_>) -> Result<Option<Example>, Error> {
    if !permutation.is_complete() {
        return Ok(None);
    }
    let Some(fits) = permutation.fits()?.into_iter().collect::<Option<Vec<RegionFit>>>() else {
        return Ok(None);
    };
    let Permutation { set, prior, streams, .. } = *permutation;
    let agents = fits.iter().zip(&permutation.parts).map(|(fit, part)| {
        let events = |chosen: &Chosen| chosen.selection.indices.iter().map(|&n| part.training[n]).collect();
        let points = fit.choices.iter().map(|(&choice, chosen)| (choice, events(chosen))).collect();
        AgentExample { part: part.clone(), points }
    });
    let held_out = permutation.held_out();
    let test = set.observations(&held_out)?;
    let predicted = |policy| {
        let packets = fits.iter().flat_map(|fit| fit.packets(Choice { policy, points: 2 }, Omega::LastDraw));
        let team = Concatenation::new(prior, &packets.collect::<Vec<_>>())?;
        let probability = team.probability(test.inputs())?;
        Ok((policy, held_out.iter().copied().zip(probability).collect()))
    };
    let predictions = Policy::ALL.into_iter().map(predicted).collect::<Result<_, Error>>()?;
    Ok(Some(Example { permutation: streams.permutation, agents: agents.collect(), predictions }))
}
