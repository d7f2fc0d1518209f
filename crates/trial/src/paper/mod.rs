//! The paper's experiment (docs/paper-experiment.md): how well one or two inducing points represent a locality
//! region, for the agent itself and for its team.

mod choice;
mod shape;
mod streams;
mod data_set;
mod fit;
mod permutation;
mod example;
mod sweep;
pub mod statistics;

use dgpc::{Error, Kernel, LocalityRegion, Prior, PriorMean, Shape, Term, common_length_scales, spread_out};
use pingmap_agent::Interrupt;
use rayon::prelude::*;

pub use choice::{Choice, Fusion, Omega, Policy, RADIUS, RADIUS_LENGTH_SCALES};
pub use data_set::{AgentEvents, DataSet, REGION_EVENTS_MAX};
pub use example::{AgentExample, Example};
pub use fit::{BURN_IN, DRAWS, EffectiveDraws};
pub use permutation::{Bounds, LocalOutcome, Outcome, Part, TeamOutcome};
pub use shape::{Claim, rank_correlation};
pub use sweep::{SWEEP_LENGTH_SCALES, SWEEP_POINTS, SweepRow};

use crate::division::draw_split;
use permutation::Permutation;
use streams::{Streams, Use};

/// Share of every agent's events that a permutation holds out.
const TEST_SHARE: f64 = 0.35;

/// Largest number of events of a data set from which a length-scale is learned. Larger sets are thinned evenly.
const LEARN_EVENTS_MAX: usize = 2000;

/// The data sets, the kernel learned from all of them, and the number of their permutations.
pub struct Experiment {
    sets: Vec<DataSet>,
    prior: Prior,
    permutations: usize,
    seed: u64,
}

/// The experiment at one radius of the locality regions.
#[derive(Debug, Clone)]
pub struct AtRadius {
    /// The radius, in standardised units.
    pub radius: f64,
    /// Results of every data set.
    pub sets: Vec<SetOutcome>,
}

/// Results of one data set.
#[derive(Debug, Clone)]
pub struct SetOutcome {
    /// The region of every agent; members are indices of the log.
    pub regions: Vec<LocalityRegion>,
    /// Results of every permutation.
    pub permutations: Vec<Outcome>,
}

impl Experiment {
    /// Learns one length-scale from all data sets together, for a squared-exponential kernel of unit variance with zero
    /// mean, and draws the permutations.
    ///
    /// # Errors
    /// As [`common_length_scales`].
    pub fn new(sets: Vec<DataSet>, permutations: usize, seed: u64) -> Result<Self, Error> {
        let kernel = Kernel::new(vec![Term::isotropic(Shape::SquaredExponential, 1.0, 1.0, 4)?])?;
        let template = Prior::new(kernel, PriorMean::Zero)?;
        let everything = sets.iter().map(|set| {
            let events: Vec<usize> = spread_out(set.log().events.len(), LEARN_EVENTS_MAX);
            set.observations(&events)
        });
        let everything = everything.collect::<Result<Vec<_>, Error>>()?;
        let prior = common_length_scales(&template, &everything)?;
        Ok(Self { sets, prior, permutations, seed })
    }

    /// Returns the data sets.
    pub fn sets(&self) -> &[DataSet] {
        &self.sets
    }

    /// Returns the learned length-scale, in standardised units.
    pub fn length_scale(&self) -> f64 {
        self.prior.kernel().terms()[0].correlations()[0].length_scales()[0]
    }

    /// Returns the number of permutations of every data set.
    pub fn permutations(&self) -> usize {
        self.permutations
    }

    /// Runs all permutations of all data sets in parallel, and calls `done` after each. For n training events in a
    /// region, a permutation costs 200 sweeps of O(n³) for every agent, and as many for the events of all agents.
    ///
    /// # Errors
    /// As the samplers and fits of `dgpc`, for numbers near the limits of floating point.
    pub fn at_radius(&self, radius: f64, done: &(dyn Fn() + Sync)) -> Result<AtRadius, Error> {
        let sets = (0..self.sets.len()).into_par_iter().map(|set| {
            let regions = self.regions(set, radius)?;
            let permutations =
                self.every_permutation(set, &regions, Use::Tables, |permutation| permutation.run(), done)?;
            Ok(SetOutcome { regions, permutations })
        });
        Ok(AtRadius { radius, sets: sets.collect::<Result<_, Error>>()? })
    }

    /// Returns the local NLL over [`SWEEP_LENGTH_SCALES`] and [`SWEEP_POINTS`], one list per data set. Calls `done`
    /// after each permutation of each radius. A permutation costs a mean field, O(n³) per iteration, and the choice of
    /// points for every agent.
    ///
    /// # Errors
    /// As [`Experiment::at_radius`].
    pub fn sweep(&self, done: &(dyn Fn() + Sync)) -> Result<Vec<Vec<SweepRow>>, Error> {
        let row = |set: usize, length_scales: f64| {
            let regions = self.regions(set, length_scales * self.length_scale())?;
            let steps = self.every_permutation(set, &regions, Use::Sweep, sweep::step, done)?;
            Ok(SweepRow::over(length_scales, steps))
        };
        let rows = |set| SWEEP_LENGTH_SCALES.into_par_iter().map(|radius| row(set, radius)).collect();
        (0..self.sets.len()).into_par_iter().map(rows).collect()
    }

    /// Returns the first permutation of a data set in which every region has training and held-out events; `None` if
    /// there is none.
    ///
    /// # Errors
    /// As [`Experiment::at_radius`].
    pub fn example(&self, set: usize, radius: f64) -> Result<Option<Example>, Error> {
        let regions = self.regions(set, radius)?;
        for number in 0..self.permutations {
            let permutation = self.permutation(set, &regions, Use::Tables, number);
            if let Some(example) = example::example(&permutation)? {
                return Ok(Some(example));
            }
        }
        Ok(None)
    }

    fn regions(&self, set: usize, radius: f64) -> Result<Vec<LocalityRegion>, Error> {
        let set = &self.sets[set];
        set.agents().iter().map(|agent| set.region(agent, radius)).collect()
    }

    fn permutation(&self, set: usize, regions: &[LocalityRegion], for_use: Use, number: usize) -> Permutation<'_> {
        let split = draw_split(self.sets[set].log(), number, TEST_SHARE, self.seed);
        let streams = Streams { seed: self.seed, for_use, set, permutation: number };
        Permutation::new(&self.sets[set], &self.prior, regions, &split, streams)
    }

    fn every_permutation<T: Send>(
        &self,
        set: usize,
        regions: &[LocalityRegion],
        for_use: Use,
        run: impl Fn(&Permutation<'_>) -> Result<T, Error> + Sync,
        done: &(dyn Fn() + Sync),
    ) -> Result<Vec<T>, Error> {
        let outcomes = (0..self.permutations).into_par_iter().map(|number| {
            Interrupt::check()?;
            let outcome = run(&self.permutation(set, regions, for_use, number));
            done();
            outcome
        });
        outcomes.collect()
    }
}

impl SetOutcome {
    /// Returns the permutations in which an agent could be scored alone. `agent` is its place in [`DataSet::agents`].
    pub fn local(&self, agent: usize) -> Vec<&LocalOutcome> {
        self.permutations.iter().filter_map(|outcome| outcome.local[agent].as_ref()).collect()
    }

    /// Returns the permutations in which the team could be scored.
    pub fn team(&self) -> Vec<&TeamOutcome> {
        self.permutations.iter().filter_map(|outcome| outcome.team.as_ref()).collect()
    }
}
