//! Chooses the next summary packet: inducing points, and the summary at these points ([`dgpc::method::increments`]).

use dgpc::{Candidates, Inputs, Latent, Posterior, PosteriorAtPoints, Summary};
use pingmap_packet::{Block, Layout};

use crate::codec::quantizer::SummaryQuantizer;
use crate::inference::posteriors::Posteriors;
use crate::types::event::Link;
use crate::types::query::LinkQuery;
use crate::types::sharing::Sharing;

/// The rule by which points are chosen from a pool of candidates.
#[derive(Debug, Clone, Copy)]
enum PointSelection {
    /// Points that reduce the variance of the shared posterior most, given the variance of the own posterior.
    VarianceReduction,
    /// Points that represent the pool, whatever was sent about it before. Earlier packets may have been wrong there.
    Coverage,
}

/// Divisors of the candidates that give the pools: all candidates, and the third and the eighth with the largest
/// divergence.
const POOL_DIVISORS: [usize; 3] = [1, 3, 8];

/// Rules with the divisors of their pools. The second rule is tried if no packet of the first one reaches the minimum
/// gain.
const SELECTIONS: [(PointSelection, &[usize]); 2] =
    [(PointSelection::VarianceReduction, &POOL_DIVISORS), (PointSelection::Coverage, &[8])];

#[derive(Debug)]
pub(crate) struct PlannedSummary {
    pub(crate) blocks: Vec<Block>,
    /// Summaries that the blocks decode to.
    pub(crate) summaries: Vec<Summary>,
    /// Mean divergence that remains after the packet, in nats: see [`SummaryPlanner::mean_divergence`].
    pub(crate) divergence_nats: f64,
}

#[derive(Debug)]
pub(crate) struct SummaryPlanner<'a> {
    pub(crate) quantizer: SummaryQuantizer<'a>,
    pub(crate) layout: &'a Layout,
    pub(crate) own: &'a Posterior,
    /// Candidates for inducing points: queries of own events within the grid.
    pub(crate) queries: Vec<LinkQuery>,
    pub(crate) inputs: Inputs,
    /// Success probability at each candidate, from the own posterior.
    own_probability: Vec<f64>,
    /// Variance of the log-odds at each candidate, from the own posterior.
    own_variance: Vec<f64>,
    /// See [`crate::Team::min_gain_nats`].
    pub(crate) min_gain_nats: f64,
}

impl<'a> SummaryPlanner<'a> {
    /// Creates a planner with these candidates. `posteriors` must be up to date with the memory: see
    /// [`Posteriors::update`].
    pub(crate) fn new(
        quantizer: SummaryQuantizer<'a>,
        layout: &'a Layout,
        posteriors: &'a Posteriors,
        queries: Vec<LinkQuery>,
        min_gain_nats: f64,
    ) -> dgpc::Result<Self> {
        let inputs = quantizer.model.inputs(&queries)?;
        // Without events since the fit, the fit already has the latent function at its events. Predictions of the
        // posterior would take as long as the rest of planning.
        let own_fit = posteriors.own_fit.as_ref().filter(|_| posteriors.absorbed_own().is_empty());
        let of_fit = own_fit.and_then(|own_fit| own_fit.fit.latent_at_events(&inputs));
        let latent = of_fit.map_or_else(|| posteriors.pair.own.latent(&inputs), Ok)?;
        let own_probability = latent.probability();
        let (own, own_variance) = (&posteriors.pair.own, latent.variance);
        Ok(Self { quantizer, layout, own, queries, inputs, own_probability, own_variance, min_gain_nats })
    }

    /// Returns the best packet for a listener with the posterior `shared`; `None` if no packet reaches the minimum
    /// gain.
    ///
    /// For each rule, one packet is formed from each pool. The result is the packet after which the mean divergence is
    /// smallest. `sharing` can restrict the search to the first pool.
    pub(crate) fn plan(&self, shared: &Posterior, sharing: Sharing) -> dgpc::Result<Option<PlannedSummary>> {
        if self.queries.is_empty() {
            return Ok(None);
        }
        let mut at_candidates = self.at_candidates(shared)?;
        let divergences = self.divergences(&at_candidates.latent(shared)?);
        let mut order: Vec<usize> = (0..self.queries.len()).collect();
        order.sort_by(|&a, &b| divergences[b].total_cmp(&divergences[a]).then(a.cmp(&b)));
        let divergence_nats = mean(&divergences);
        let selections = match sharing.summary_candidates {
            true => &SELECTIONS[..],
            false => &[(PointSelection::VarianceReduction, &POOL_DIVISORS[..1])],
        };
        for &(selection, divisors) in selections {
            let mut best: Option<PlannedSummary> = None;
            for pool in divisors.iter().map(|divisor| self.most_divergent(&order, *divisor)) {
                let (planned, shared) = self.form_blocks(shared, &pool, selection)?;
                let divergence_nats = self.mean_divergence(&at_candidates.latent(&shared)?);
                let planned = PlannedSummary { divergence_nats, ..planned };
                let is_better = |best: &PlannedSummary| planned.divergence_nats < best.divergence_nats;
                if !planned.summaries.is_empty() && best.as_ref().is_none_or(is_better) {
                    best = Some(planned);
                }
            }
            let has_gain = |planned: &PlannedSummary| divergence_nats - planned.divergence_nats >= self.min_gain_nats;
            if let Some(planned) = best.filter(has_gain) {
                return Ok(Some(planned));
            }
        }
        Ok(None)
    }

    /// Prepares predictions at the candidates under `shared` and under extensions of it.
    pub(crate) fn at_candidates<'p>(&self, shared: &'p Posterior) -> dgpc::Result<PosteriorAtPoints<'p>> {
        PosteriorAtPoints::new(shared, &self.inputs)
    }

    /// Returns the mean Kullback-Leibler divergence of the predictions of a listener from those of the own posterior,
    /// in nats. `shared` is the listener's latent function at the candidates. The mean is over the candidates; 0
    /// without any.
    pub(crate) fn mean_divergence(&self, shared: &Latent) -> f64 {
        mean(&self.divergences(shared))
    }

    /// Returns the candidates that come first in `order`: one in `divisor` of all, and as many more as a block has
    /// points. The result is in ascending order.
    fn most_divergent(&self, order: &[usize], divisor: usize) -> Vec<usize> {
        let mut pool = order[..order.len().min(order.len() / divisor + self.layout.points)].to_vec();
        pool.sort_unstable();
        pool
    }

    /// Forms the blocks of a packet with points from `pool`, in the time cell of the pool. Each block is the residual
    /// of the own posterior, given `shared` and the blocks before it. Returns also `shared` with all blocks.
    fn form_blocks(
        &self,
        shared: &Posterior,
        pool: &[usize],
        selection: PointSelection,
    ) -> dgpc::Result<(PlannedSummary, Posterior)> {
        let mut shared = shared.clone();
        let (mut blocks, mut summaries) = (Vec::new(), Vec::new());
        let time = self.quantizer.time_of(pool.iter().map(|&index| &self.queries[index]));
        let links: Vec<Link> = pool.iter().map(|&index| self.queries[index].link).collect();
        let inputs = self.quantizer.model.inputs(links.iter().map(|&link| self.quantizer.query(time, link)))?;
        let mut candidates = match selection {
            PointSelection::VarianceReduction => {
                Some(Candidates::towards(&shared, &self.variance_of_pool(pool, &inputs)?, &inputs)?)
            }
            PointSelection::Coverage => None,
        };
        while blocks.len() < self.layout.blocks {
            let chosen = match &mut candidates {
                Some(candidates) => {
                    candidates.follow(&shared, &inputs)?;
                    candidates.greedy(self.layout.points)
                }
                None => {
                    let earlier = inducing_points_of(&summaries)?;
                    Candidates::given(self.own.prior().kernel(), &inputs, &earlier)?.greedy(self.layout.points)
                }
            };
            let links: Vec<Link> = chosen.indices.iter().map(|&index| links[index]).collect();
            let residual = |points: &Inputs| self.own.residual(&shared, points);
            let Some((block, summary)) = self.quantizer.encode(self.layout, time, &links, &residual)? else { break };
            shared.absorb_summaries(&[&summary])?;
            blocks.push(block);
            summaries.push(summary);
        }
        blocks.resize_with(self.layout.blocks, || Block::empty(self.layout));
        Ok((PlannedSummary { blocks, summaries, divergence_nats: f64::NAN }, shared))
    }

    /// Returns the variances of the own posterior at the inputs of a pool. The predictions at the candidates are used
    /// if the model does not depend on time.
    fn variance_of_pool(&self, pool: &[usize], inputs: &Inputs) -> dgpc::Result<Vec<f64>> {
        if self.own.prior().sees_alike(inputs, &self.inputs.select(pool)) {
            return Ok(pool.iter().map(|&index| self.own_variance[index]).collect());
        }
        Ok(self.own.latent(inputs)?.variance)
    }

    /// Returns the Kullback-Leibler divergence of the predictions of a listener from those of the own posterior, at
    /// every candidate.
    fn divergences(&self, shared: &Latent) -> Vec<f64> {
        let divergence = |(&p, q): (&f64, f64)| divergence_term(p, q) + divergence_term(1.0 - p, 1.0 - q);
        self.own_probability.iter().zip(shared.probability()).map(divergence).collect()
    }
}

fn inducing_points_of(summaries: &[Summary]) -> dgpc::Result<Inputs> {
    let dimension = summaries.first().map_or(1, |first| first.inducing_points().dimension());
    let mut points = Inputs::empty(dimension);
    summaries.iter().try_for_each(|summary| points.append(summary.inducing_points()))?;
    Ok(points)
}

/// Returns p ln(p/q).
fn divergence_term(p: f64, q: f64) -> f64 {
    if p > 0.0 { p * (p / q.max(f64::MIN_POSITIVE)).ln() } else { 0.0 }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
