//! The sparse mean field: a coordinator moves the posterior on M inducing points, and shards sum up their events
//! ([`crate::method::inference`] and [`crate::method::summaries`]).
//!
//! A fit in one process has one shard. The messages of peers belong to the coordinator.

mod coordinator;
mod events;
mod gradient;
mod iteration;
mod messages;
mod numbers;
mod point_posterior;
mod shard;
mod sharded;

pub(super) use coordinator::Coordinator;
pub(super) use events::{EventCovariances, Site};
pub use shard::{Shard, ShardContribution, ShardRequest};
pub use sharded::ShardedFit;

use std::borrow::Cow;
use std::sync::Arc;

use super::mean_field::MeanField;
use super::options::FitOptions;
use crate::cross::kept_max;
use crate::error::{Result, same_size};
use crate::inputs::Inputs;
use crate::likelihood::Likelihood;
use crate::prior::Prior;
use iteration::Iteration;

/// Fits the events of a likelihood in this process.
pub(super) fn solve(
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: &Inputs,
    options: &FitOptions<'_>,
) -> Result<MeanField> {
    let (shard, iteration) = run(prior, likelihood, points, options)?;
    mean_field(shard, iteration)
}

/// Fits as [`solve`] does, and also returns the gradient of E by the prior's parameters.
pub(super) fn solve_with_gradient(
    prior: &Prior,
    likelihood: &Likelihood<'_>,
    points: &Inputs,
    options: &FitOptions<'_>,
) -> Result<(MeanField, Vec<f64>)> {
    let (mut shard, iteration) = run(prior, likelihood, points, options)?;
    let of_events = shard.contribute(&iteration.gradient_request())?;
    let gradient = iteration.gradient(of_events, prior, likelihood)?;
    Ok((mean_field(shard, iteration)?, gradient))
}

fn run<'a>(
    prior: &Prior,
    likelihood: &Likelihood<'a>,
    points: &Inputs,
    options: &FitOptions<'a>,
) -> Result<(Shard<'a>, Iteration<'a>)> {
    options.check(likelihood.events())?;
    same_size("input dimension", points.dimension(), likelihood.observations.inputs().dimension())?;
    let coordinator = Coordinator::new(prior, likelihood, points)?;
    let (inputs, cholesky) = (likelihood.observations.inputs(), Arc::clone(coordinator.cholesky()));
    let covariances = EventCovariances::new(prior, inputs, points, cholesky, kept_max(inputs.len()))?;
    let mut shard = Shard::of_covariances(Cow::Borrowed(likelihood.observations), covariances, options.start);
    let mut iteration = Iteration::new(coordinator, options);
    while let Some(request) = iteration.request() {
        iteration.absorb(shard.contribute(&request)?)?;
    }
    Ok((shard, iteration))
}

/// Collects the results of a shard and of its coordinator.
fn mean_field(shard: Shard<'_>, iteration: Iteration<'_>) -> Result<MeanField> {
    let (events, end) = (shard.into_events()?, iteration.into_end());
    Ok(MeanField {
        sites: events.sites,
        mean: events.mean,
        variance: events.variance,
        residual: events.residual,
        tilts: events.tilts,
        evidence: end.evidence,
        iterations: end.iterations,
        change: end.change,
        stop: end.stop,
        jitter: end.jitter,
        weights: events.weights,
        condensed: Some((end.sums.precision, end.sums.shift)),
    })
}
