//! Which packet is worth the next frame (section 6 of [`dgpc::method`]).

use dgpc::{Candidates, Inputs, Posterior, Summary};
use pingmap_packet::{Block, Layout};

use crate::attempt::Attempt;
use crate::beliefs::Beliefs;
use crate::event::Link;
use crate::wire::Wire;

/// How points are chosen from a pool of candidates.
#[derive(Debug, Clone, Copy)]
enum Choice {
    /// Those that lower the variance of `public` most: what is known and has not been sent.
    Unplanned,
    /// Those that stand for the pool, whatever has been sent there: it may have been wrong.
    Spread,
}

/// Pools are all candidates, and the third and the eighth of which `public` says the most wrong.
const POOLS: [usize; 3] = [1, 3, 8];

/// What is tried, and what is tried if none of that is worth a frame.
const CHOICES: [(Choice, &[usize]); 2] = [(Choice::Unplanned, &POOLS), (Choice::Spread, &[8])];

/// To what powers it is said. Below 1 it is said less surely than it is known, which is tried where nothing else is worth a
/// frame: a few points known far from even odds speak for all places around them, and where the function is steeper than the
/// length-scales say they would be wrong there.
const TEMPERS: [f64; 4] = [1.0, 0.25, 0.0625, 0.015_625];

/// What a packet below 1 must tell, as a share of what others do not know: it is sent so that others can follow, not for itself.
const TEMPERED_SHARE: f64 = 0.01;

/// A packet that is worth sending, and what it says.
#[derive(Debug)]
pub(crate) struct Planned {
    pub(crate) blocks: Vec<Block>,
    pub(crate) summaries: Vec<Summary>,
    /// What others do not know with it: see [`Planner::left`].
    pub(crate) left: f64,
}

/// What a vehicle knows, at the places where it could send something of it.
#[derive(Debug)]
pub(crate) struct Planner<'a> {
    pub(crate) wire: Wire<'a>,
    pub(crate) layout: &'a Layout,
    /// What it knows from its own events.
    pub(crate) own: &'a Posterior,
    /// What its own events tried within the grid.
    pub(crate) attempts: Vec<Attempt>,
    /// Their inputs.
    pub(crate) inputs: Inputs,
    /// What it knows there from its own events.
    known: Known,
    /// See [`crate::Team::worth_nats`].
    pub(crate) worth_nats: f64,
}

#[derive(Debug)]
struct Known {
    probability: Vec<f64>,
    variance: Vec<f64>,
}

impl<'a> Planner<'a> {
    /// `beliefs` hold all that the memory does ([`Beliefs::update`]): their last fit and what they know of their own events agree.
    pub(crate) fn new(
        wire: Wire<'a>,
        layout: &'a Layout,
        beliefs: &'a Beliefs,
        attempts: Vec<Attempt>,
        worth_nats: f64,
    ) -> dgpc::Result<Self> {
        let inputs = wire.model.inputs(&attempts)?;
        // Of its events a fit knows it, if nothing stands beside the fit; to ask the posterior is as dear as all the rest of planning.
        let fitted = beliefs.alone.as_ref().filter(|_| beliefs.beside().is_empty());
        let known = fitted.and_then(|alone| alone.fit.latent_at_events(&inputs));
        let latent = known.map_or_else(|| beliefs.own.latent(&inputs), Ok)?;
        let known = Known { probability: latent.probability(), variance: latent.variance };
        Ok(Self { wire, layout, own: &beliefs.own, attempts, inputs, known, worth_nats })
    }

    /// The packet that tells most to somebody who knows `public`, if it is worth a frame. Its points are those that
    /// lower the variance of `public` at the sender's events most, or that stand for where it is most wrong; of several
    /// such packets the one is taken that brings what `public` predicts closest to what the sender knows.
    pub(crate) fn packet(&self, public: &Posterior) -> dgpc::Result<Option<Planned>> {
        if self.attempts.is_empty() {
            return Ok(None);
        }
        let divergences = self.divergences(public)?;
        let mut order: Vec<usize> = (0..self.attempts.len()).collect();
        order.sort_by(|&a, &b| divergences[b].total_cmp(&divergences[a]).then(a.cmp(&b)));
        let untold = mean(&divergences);
        for temper in TEMPERS {
            let worth = if temper < 1.0 { self.worth_nats.max(TEMPERED_SHARE * untold) } else { self.worth_nats };
            for (choice, parts) in CHOICES {
                let mut best: Option<Planned> = None;
                for pool in parts.iter().map(|part| self.worst(&order, *part)) {
                    let (planned, public) = self.form(public, &pool, choice, temper)?;
                    let planned = Planned { left: mean(&self.divergences(&public)?), ..planned };
                    if !planned.summaries.is_empty() && best.as_ref().is_none_or(|best| planned.left < best.left) {
                        best = Some(planned);
                    }
                }
                if let Some(planned) = best.filter(|planned| untold - planned.left >= worth) {
                    return Ok(Some(planned));
                }
            }
        }
        Ok(None)
    }

    /// What somebody who knows `public` does not know: mean Kullback-Leibler divergence of what that predicts from what the
    /// vehicle knows, over its own events, in nats. 0 without any.
    pub(crate) fn left(&self, public: &Posterior) -> dgpc::Result<f64> {
        Ok(mean(&self.divergences(public)?))
    }

    /// One in `part` of the candidates, the first in `order`, and as many as a block has points.
    fn worst(&self, order: &[usize], part: usize) -> Vec<usize> {
        let mut pool = order[..order.len().min(order.len() / part + self.layout.points)].to_vec();
        pool.sort_unstable();
        pool
    }

    /// Blocks about the candidates in `pool`, said of the middle of their times, each given those before and to the power of
    /// `temper`, and `public` with them.
    fn form(
        &self,
        public: &Posterior,
        pool: &[usize],
        choice: Choice,
        temper: f64,
    ) -> dgpc::Result<(Planned, Posterior)> {
        let mut public = public.clone();
        let (mut blocks, mut summaries) = (Vec::new(), Vec::new());
        let time = self.wire.time_of(pool.iter().map(|&place| &self.attempts[place]));
        let links: Vec<Link> = pool.iter().map(|&place| self.attempts[place].link).collect();
        let inputs = self.wire.model.inputs(links.iter().map(|&link| self.wire.attempt(time, link)))?;
        let mut unplanned = match choice {
            Choice::Unplanned => Some(Candidates::towards(&public, &self.variance(pool, &inputs)?, &inputs)?),
            Choice::Spread => None,
        };
        while blocks.len() < self.layout.blocks {
            let chosen = match &mut unplanned {
                Some(candidates) => {
                    candidates.follow(&public, &inputs)?;
                    candidates.greedy(self.layout.points)
                }
                None => Candidates::given(self.own.prior().kernel(), &inputs, &points_of(&summaries)?)?
                    .greedy(self.layout.points),
            };
            let links: Vec<Link> = chosen.indices.iter().map(|&place| links[place]).collect();
            let residual = |points: &Inputs| Ok(self.own.residual(&public, points)?.tempered(temper));
            let Some((block, summary)) = self.wire.encode(self.layout, time, &links, &residual)? else { break };
            public.absorb_summaries(&[&summary])?;
            blocks.push(block);
            summaries.push(summary);
        }
        blocks.resize_with(self.layout.blocks, || Block::silent(self.layout));
        Ok((Planned { blocks, summaries, left: f64::NAN }, public))
    }

    /// Variances of what it knows at the inputs of a pool: known already, where the model does not look at the time.
    fn variance(&self, pool: &[usize], inputs: &Inputs) -> dgpc::Result<Vec<f64>> {
        if self.own.prior().sees_alike(inputs, &self.inputs.select(pool)) {
            return Ok(pool.iter().map(|&place| self.known.variance[place]).collect());
        }
        Ok(self.own.latent(inputs)?.variance)
    }

    /// Kullback-Leibler divergence of what `public` predicts from what the vehicle knows, at every candidate.
    fn divergences(&self, public: &Posterior) -> dgpc::Result<Vec<f64>> {
        let public = public.probability(&self.inputs)?;
        Ok(self.known.probability.iter().zip(&public).map(|(&p, &q)| part(p, q) + part(1.0 - p, 1.0 - q)).collect())
    }
}

/// The inducing points of the blocks so far.
fn points_of(summaries: &[Summary]) -> dgpc::Result<Inputs> {
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
