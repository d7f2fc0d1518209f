//! The benefit of the policy over radii and numbers of points.

use std::collections::BTreeMap;

use dgpc::{Candidates, Concatenation, Error, FitOptions, Summary};

use super::choice::{Choice, Policy, RADIUS_LENGTH_SCALES};
use super::permutation::{Permutation, score};
use crate::score::Estimate;

/// Radii of the sweep in length-scales; the fourth is the paper's ratio.
pub const SWEEP_LENGTH_SCALES: [f64; 6] = [0.5, 0.75, 1.0, RADIUS_LENGTH_SCALES, 2.0, 3.0];

/// Numbers of points of the sweep.
pub const SWEEP_POINTS: [usize; 6] = [1, 2, 3, 4, 6, 8];

/// One data set at one radius: local NLL with the mean field, averaged over agents, over permutations.
#[derive(Debug, Clone)]
pub struct SweepRow {
    /// The radius in length-scales.
    pub length_scales: f64,
    /// Training events of a region, the mean over agents and permutations.
    pub events: f64,
    /// NLL of all training events of the regions; `None` if every permutation leaves a region empty.
    pub all_events: Option<Estimate>,
    /// NLL of good points by their number. A region with fewer events uses all of them.
    pub good: BTreeMap<usize, Estimate>,
    /// NLL of random points minus that of good points, by their number.
    pub gain: BTreeMap<usize, Estimate>,
    /// Number of permutations that are not counted, because they leave a region empty.
    pub skipped: usize,
}

/// Results of one permutation.
pub(super) struct SweepStep {
    events: f64,
    all_events: f64,
    nll: BTreeMap<Choice, f64>,
}

impl SweepRow {
    pub(super) fn over(length_scales: f64, steps: Vec<Option<SweepStep>>) -> Self {
        let skipped = steps.iter().filter(|step| step.is_none()).count();
        let steps: Vec<SweepStep> = steps.into_iter().flatten().collect();
        let over = |of: &dyn Fn(&SweepStep) -> f64| Estimate::over(&steps.iter().map(of).collect::<Vec<_>>());
        let nll = |step: &SweepStep, policy, points| step.nll[&Choice { policy, points }];
        let by_points = |of: &dyn Fn(&SweepStep, usize) -> f64| {
            let estimates = SWEEP_POINTS.into_iter().map(|points| Some((points, over(&|step| of(step, points))?)));
            estimates.flatten().collect()
        };
        Self {
            length_scales,
            events: over(&|step| step.events).map_or(0.0, |events| events.mean),
            all_events: over(&|step| step.all_events),
            good: by_points(&|step, points| nll(step, Policy::Good, points)),
            gain: by_points(&|step, points| nll(step, Policy::Random, points) - nll(step, Policy::Good, points)),
            skipped,
        }
    }
}

/// Runs one permutation; returns `None` if a region has no training or held-out events.
pub(super) fn step(permutation: &Permutation<'_>) -> Result<Option<SweepStep>, Error> {
    if !permutation.is_complete() {
        return Ok(None);
    }
    let Permutation { set, prior, streams, ref parts } = *permutation;
    let share = 1.0 / parts.len() as f64;
    let mut mean = SweepStep { events: 0.0, all_events: 0.0, nll: BTreeMap::new() };
    for (agent, part) in parts.iter().enumerate() {
        let (training, test) = (set.observations(&part.training)?, set.observations(&part.held_out)?);
        let fit = dgpc::fit(prior, &training, &FitOptions::default())?;
        let candidates = Candidates::new(prior.kernel(), training.inputs())?;
        let mut rng = streams.agent(agent);
        let nll = |probability: Result<Vec<f64>, Error>| Ok(score(std::iter::once(probability), &test)?.nll);
        mean.events += share * training.len() as f64;
        mean.all_events += share * nll(fit.posterior()?.probability(test.inputs()))?;
        for policy in [Policy::Good, Policy::Random] {
            for points in SWEEP_POINTS {
                let choice = Choice { policy, points };
                let chosen = training.inputs().select(&policy.choose(&candidates, points, &mut rng).indices);
                let packet = Summary::variational(prior, fit.sites(), &chosen)?;
                let alone = Concatenation::new(prior, &[&packet])?;
                *mean.nll.entry(choice).or_default() += share * nll(alone.probability(test.inputs()))?;
            }
        }
    }
    Ok(Some(mean))
}
