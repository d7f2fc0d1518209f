//! Predicts links.

use dgpc::{Matrix, Posterior};

use crate::agent::state::{Agent, Which};
use crate::error::AgentError;
use crate::model::inputs::End;
use crate::model::link_model::Model;
use crate::types::event::{Link, Position};
use crate::types::query::{LinkQuery, UnknownHeading};

/// Number of headings over which a prediction is averaged.
const HEADINGS: usize = 8;

/// Steps of the headings of transmitter and receiver, in units of a turn divided by [`HEADINGS`]. The steps differ and
/// have no common factor with the number of headings. Every heading of either end therefore occurs once.
const STEPS: [usize; 2] = [1, 3];

/// Interval that contains nine in ten of the true probabilities, and the moments that it follows from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end; at most the predicted probability.
    pub low: f64,
    /// Upper end; at least the predicted probability.
    pub high: f64,
    /// Mean of the log-odds by expectation propagation.
    pub mean: f64,
    /// Variance of the log-odds by expectation propagation, widened by the square of
    /// [`INTERVAL_WIDENING`](crate::INTERVAL_WIDENING).
    pub variance: f64,
}

/// The prediction for a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Mean of the log-odds.
    pub mean: f64,
    /// Variance of the log-odds.
    pub variance: f64,
    /// Probability that the message is received.
    pub probability: f64,
    /// Share of the prior variance of the log-odds that the data explain: 0 far from all data, at most 1.
    pub explained: f64,
    /// Interval of the probability, from [`Agent::predict_intervals`].
    pub interval: Option<Interval>,
}

/// A prediction, and the query that it was computed for.
pub(crate) struct CappedPrediction {
    pub(crate) query: LinkQuery,
    /// The query itself, or a part of its link of the longest observed length.
    pub(crate) evaluated_at: LinkQuery,
    pub(crate) prediction: Prediction,
}

impl Agent {
    /// Returns the probability that a message is received.
    ///
    /// # Errors
    /// As [`Agent::predict`].
    pub fn probability(&mut self, query: impl Into<LinkQuery>) -> Result<f64, AgentError> {
        Ok(self.predict([query], Which::Fused)?[0].probability)
    }

    /// Predicts each query. Absorbs new data, up to a limit, and fits nothing: see [`Agent::refit_due`]. O(n²) a query.
    ///
    /// Far from all data the probability returns to even odds. If the model has aspect terms,
    /// [`LinkQuery::unknown_heading`] determines what an unknown heading means.
    ///
    /// A link longer than every observed link has two parts of the longest observed length, one at the transmitter and
    /// one at the receiver. The prediction for the link is therefore the smallest of three: its own, and those of these
    /// parts.
    /// [`AgentOptions::allow_extrapolated_increase`](crate::AgentOptions::allow_extrapolated_increase) turns that off.
    ///
    /// After [`Agent::average_with`] the result for [`Which::Fused`] is the average over two models.
    ///
    /// # Errors
    /// [`AgentError::Method`] if a position is not finite.
    pub fn predict(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
        which: Which<'_>,
    ) -> Result<Vec<Prediction>, AgentError> {
        let queries: Vec<LinkQuery> = queries.into_iter().map(Into::into).collect();
        match which {
            Which::Fused => Ok(self.by_model(queries)?.average(self.alternative_weight())),
            _ => Ok(self.capped(which, queries)?.into_iter().map(|capped| capped.prediction).collect()),
        }
    }

    /// Draws joint log-odds of these queries by expectation propagation: one column for each column of standard
    /// normals. Normals that are [`INTERVAL_WIDENING`](crate::INTERVAL_WIDENING) times as large give draws that spread
    /// as the intervals of [`Agent::predict_intervals`] do. Where a heading is unknown the aspect term of that end is
    /// left out, so that draws spread less than these intervals. O(Mn² + M²n + M³) for M queries.
    ///
    /// # Errors
    /// As [`Agent::predict`], and for normals with another number of rows than queries.
    pub fn draws(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
        normals: &Matrix,
    ) -> Result<Matrix, AgentError> {
        let capped = self.capped(Which::Fused, queries.into_iter().map(Into::into).collect())?;
        let inputs = self.team().model.inputs(capped.iter().map(|capped| capped.evaluated_at))?;
        Ok(self.interval_posteriors()?.fused.draws(&inputs, normals)?.0)
    }

    pub(crate) fn capped(
        &mut self,
        which: Which<'_>,
        queries: Vec<LinkQuery>,
    ) -> Result<Vec<CappedPrediction>, AgentError> {
        self.update()?;
        let longest_m = if let Which::Own = which { self.own_longest_m() } else { self.longest_m() };
        self.capped_under(self.current_posterior(which), longest_m, queries)
    }

    /// Predicts each query from a current posterior. `longest_m` is the length of the longest observed link.
    pub(crate) fn capped_under(
        &self,
        posterior: &Posterior,
        longest_m: Option<f64>,
        queries: Vec<LinkQuery>,
    ) -> Result<Vec<CappedPrediction>, AgentError> {
        let longest_m = longest_m.filter(|_| !self.options.allow_extrapolated_increase);
        Ok(capped(&self.team().model, posterior, longest_m, queries)?)
    }

    /// Returns the length of the longest link in own events, in data of trusted members, and in the site prior.
    pub(crate) fn longest_m(&self) -> Option<f64> {
        *self.longest_cache.get_or_init(|| self.longest_link_m())
    }

    fn longest_link_m(&self) -> Option<f64> {
        let trusted = self.trusted();
        let packets = trusted.packets.iter().filter_map(|&key| self.memory.packets.get(key));
        let remote_m = trusted.events.values().map(|event| event.link.range_m());
        packets.map(|packet| packet.longest_m).chain(remote_m).chain(self.own_longest_m()).reduce(f64::max)
    }

    fn own_longest_m(&self) -> Option<f64> {
        let site = self.team().model.site.iter();
        let before_m = site.flat_map(|site| site.links()).map(|link| link.range_m());
        let own_m = self.memory.counting_events().map(|recorded| recorded.event.link.range_m());
        before_m.chain(own_m).reduce(f64::max)
    }
}

/// Predicts each query, capped at the longest observed length.
fn capped(
    model: &Model,
    posterior: &Posterior,
    longest_m: Option<f64>,
    queries: Vec<LinkQuery>,
) -> dgpc::Result<Vec<CappedPrediction>> {
    let predicted = predict(model, posterior, &queries)?;
    let itself = |(query, prediction)| CappedPrediction { query, evaluated_at: query, prediction };
    let mut capped: Vec<CappedPrediction> = queries.into_iter().zip(predicted).map(itself).collect();
    let Some(longest_m) = longest_m else { return Ok(capped) };
    let is_longer = |capped: &&mut CappedPrediction| capped.query.link.range_m() > longest_m;
    let longer: Vec<&mut CappedPrediction> = capped.iter_mut().filter(is_longer).collect();
    let parts = |capped: &&mut CappedPrediction| {
        let link = capped.query.link;
        let parts = [link.shortened_to(longest_m), link.swapped().shortened_to(longest_m).swapped()];
        parts.map(|link| LinkQuery { link, ..capped.query })
    };
    let parts: Vec<LinkQuery> = longer.iter().flat_map(parts).collect();
    let predicted = predict(model, posterior, &parts)?;
    for (capped, (parts, predicted)) in longer.into_iter().zip(parts.chunks(2).zip(predicted.chunks(2))) {
        for (&evaluated_at, &prediction) in parts.iter().zip(predicted) {
            if prediction.probability < capped.prediction.probability {
                (capped.evaluated_at, capped.prediction) = (evaluated_at, prediction);
            }
        }
    }
    Ok(capped)
}

/// Predicts each query without a cap. O(n²) for a query and heading.
///
/// If the model has aspect terms, an unknown heading is replaced by eight headings, evenly distributed over the circle,
/// unless the query leaves it out. The prediction is then the mean over them. Its variance includes that of the mean.
pub(crate) fn predict(model: &Model, posterior: &Posterior, queries: &[LinkQuery]) -> dgpc::Result<Vec<Prediction>> {
    // The prior may be one that the vehicle learned itself.
    let kernel = posterior.prior().kernel();
    let has_aspect = [End::Transmitter, End::Receiver].map(|end| model.inputs.is_aspect_in(kernel, end));
    let is_open = |query: &LinkQuery| {
        let mut ends = query.link.ends().into_iter().zip(has_aspect);
        query.unknown_heading == UnknownHeading::Averaged
            && ends.any(|(end, has_aspect)| has_aspect && end.heading_deg.is_none())
    };
    let headings = if queries.iter().any(is_open) { HEADINGS } else { 1 };
    let inputs = match headings {
        1 => model.inputs(queries)?,
        _ => model.inputs(queries.iter().flat_map(|query| (0..headings).map(|n| with_heading(query, n))))?,
    };
    let (latent, prior) = (posterior.latent(&inputs)?, kernel.diagonal(&inputs)?);
    let probability = latent.probability();
    let prediction = |n: usize| {
        let group = headings * n..headings * (n + 1);
        let average = |values: &[f64]| values[group.clone()].iter().sum::<f64>() / headings as f64;
        let (mean, within) = (average(&latent.mean), average(&latent.variance));
        let squares = latent.mean[group.clone()].iter().map(|value| (value - mean) * (value - mean));
        Prediction {
            mean,
            variance: within + squares.sum::<f64>() / headings as f64,
            probability: average(&probability),
            explained: (1.0 - within / average(&prior)).clamp(0.0, 1.0),
            interval: None,
        }
    };
    Ok((0..queries.len()).map(prediction).collect())
}

/// Returns the query with heading `n` of [`HEADINGS`] at each end of unknown heading, unless it leaves them out.
fn with_heading(query: &LinkQuery, n: usize) -> LinkQuery {
    if query.unknown_heading == UnknownHeading::LeftOut {
        return *query;
    }
    let end = |end: Position, step: usize| {
        let heading_deg = (n * step % HEADINGS) as f64 * 360.0 / HEADINGS as f64;
        Position { heading_deg: end.heading_deg.or(Some(heading_deg)), ..end }
    };
    let Link { transmitter, receiver } = query.link;
    LinkQuery { link: Link { transmitter: end(transmitter, STEPS[0]), receiver: end(receiver, STEPS[1]) }, ..*query }
}
