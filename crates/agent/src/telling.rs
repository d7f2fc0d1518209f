//! What is worth the next frame (docs/method.md, sections 5 and 6).

use dgpc::{Candidates, Inputs, Posterior, Sites, Summary};
use pingmap_packet::{Block, Layout};

use crate::event::Link;
use crate::wire::Wire;

/// How points are chosen from a pool of candidates.
#[derive(Debug, Clone, Copy)]
enum Choice {
    /// Those that lower the variance of `public` most: what is known and has not been told.
    Untold,
    /// Those that stand for the pool, whatever has been told there: it may have been wrong.
    Spread,
}

/// Pools are all candidates, and the third and the eighth of which `public` says the most wrong.
const POOLS: [usize; 3] = [1, 3, 8];

/// What is tried, and what is tried if none of that is worth a frame.
const WAYS: [(Choice, &[usize]); 2] = [(Choice::Untold, &POOLS), (Choice::Spread, &[8])];

/// A packet that is worth sending, and what it says.
#[derive(Debug)]
pub(crate) struct Told {
    pub(crate) blocks: Vec<Block>,
    pub(crate) summaries: Vec<Summary>,
}

/// What a vehicle knows, at the places where it could tell of it.
#[derive(Debug)]
pub(crate) struct Telling<'a> {
    pub(crate) wire: Wire<'a>,
    pub(crate) layout: &'a Layout,
    /// What it knows from its own events.
    pub(crate) own: &'a Posterior,
    /// Links of its own events within the grid.
    pub(crate) links: Vec<Link>,
    /// Their inputs.
    pub(crate) inputs: Inputs,
    /// See [`crate::Team::worth_nats`].
    pub(crate) worth_nats: f64,
}

impl Telling<'_> {
    /// The packet that tells most to somebody who knows `public`, if it is worth a frame. Its points are those that lower the
    /// variance of `public` at the sender's events most, or that stand for where it is most wrong; of several such packets the one is
    /// taken that brings what `public` predicts closest to what the sender knows.
    pub(crate) fn packet(&self, public: &Posterior) -> dgpc::Result<Option<Told>> {
        if self.links.is_empty() {
            return Ok(None);
        }
        let known = self.own.probability(&self.inputs)?;
        let divergences = self.divergences(&known, public)?;
        let mut order: Vec<usize> = (0..self.links.len()).collect();
        order.sort_by(|&a, &b| divergences[b].total_cmp(&divergences[a]).then(a.cmp(&b)));
        for (choice, pools) in WAYS {
            let mut best: Option<(f64, Told)> = None;
            for part in pools {
                let mut pool = order[..order.len().min(order.len() / part + self.layout.points)].to_vec();
                pool.sort_unstable();
                let (told, public) = self.form(public, &pool, choice)?;
                let left = mean(&self.divergences(&known, &public)?);
                if !told.summaries.is_empty() && best.as_ref().is_none_or(|(least, _)| left < *least) {
                    best = Some((left, told));
                }
            }
            let worth = |(left, _): &(f64, Told)| mean(&divergences) - left >= self.worth_nats;
            if let Some((_, told)) = best.filter(worth) {
                return Ok(Some(told));
            }
        }
        Ok(None)
    }

    /// Blocks about the candidates in `pool`, each given those before, and `public` with them.
    fn form(&self, public: &Posterior, pool: &[usize], choice: Choice) -> dgpc::Result<(Told, Posterior)> {
        let mut public = public.clone();
        let (mut blocks, mut summaries) = (Vec::new(), Vec::new());
        let inputs = self.inputs.select(pool);
        while blocks.len() < self.layout.blocks {
            let candidates = match choice {
                Choice::Untold => Candidates::to_tell(&public, self.own, &inputs)?,
                Choice::Spread => Candidates::given(self.own.prior().kernel(), &inputs, &told_points(&summaries)?)?,
            };
            let chosen = candidates.greedy(self.layout.points);
            let links: Vec<Link> = chosen.indices.iter().map(|&place| self.links[pool[place]]).collect();
            let residual = |points: &Inputs| self.own.beyond(&public, points);
            let Some((block, summary)) = self.wire.encode(self.layout, &links, &residual)? else { break };
            public.absorb(&Sites::empty(inputs.dimension()), &[&summary])?;
            blocks.push(block);
            summaries.push(summary);
        }
        blocks.resize_with(self.layout.blocks, || Block::silent(self.layout));
        Ok((Told { blocks, summaries }, public))
    }

    /// Kullback-Leibler divergence of what `public` predicts from what the vehicle knows, at every candidate.
    fn divergences(&self, known: &[f64], public: &Posterior) -> dgpc::Result<Vec<f64>> {
        let public = public.probability(&self.inputs)?;
        Ok(known.iter().zip(&public).map(|(&p, &q)| part(p, q) + part(1.0 - p, 1.0 - q)).collect())
    }
}

/// The inducing points of the blocks so far.
fn told_points(summaries: &[Summary]) -> dgpc::Result<Inputs> {
    let dimension = summaries.first().map_or(1, |first| first.inducing_points().dimension());
    let mut points = Inputs::empty(dimension);
    summaries.iter().try_for_each(|summary| points.append(summary.inducing_points()))?;
    Ok(points)
}

/// p ln(p/q).
fn part(p: f64, q: f64) -> f64 {
    if p > 0.0 { p * (p / q.max(f64::MIN_POSITIVE)).ln() } else { 0.0 }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
