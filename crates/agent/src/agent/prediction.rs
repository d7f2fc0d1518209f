//! Predicts links.

use dgpc::{Matrix, Posterior};

use crate::agent::state::{Agent, Which};
use crate::error::AgentError;
use crate::model::link_model::Model;
use crate::types::query::LinkQuery;

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
    /// Interval that contains nine in ten of the true probabilities, if requested.
    pub interval: Option<(f64, f64)>,
}

/// Options of [`Agent::predict`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PredictOptions {
    /// The posterior that predictions follow from.
    pub posterior: Which,
    /// Whether to compute intervals; always from the fused posterior. The first call after a change costs ten to thirty
    /// iterations of [`Agent::refit`].
    pub intervals: bool,
}

impl PredictOptions {
    /// Predictions from the vehicle's own events alone.
    pub fn own() -> Self {
        Self { posterior: Which::Own, intervals: false }
    }

    /// Predictions with intervals.
    pub fn with_intervals() -> Self {
        Self { posterior: Which::Fused, intervals: true }
    }
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
        Ok(self.predict([query], PredictOptions::default())?[0].probability)
    }

    /// Predicts each query. Absorbs new data, up to a limit, and fits nothing: see [`Agent::refit_due`]. O(n²) a query.
    ///
    /// Far from all data the probability returns to even odds. A link longer than every observed link has two parts of
    /// the longest observed length, one at the transmitter and one at the receiver. The prediction for the link is
    /// therefore the smallest of three: its own, and those of these parts.
    /// [`AgentOptions::allow_extrapolated_increase`](crate::AgentOptions::allow_extrapolated_increase) turns that off.
    ///
    /// # Errors
    /// [`AgentError::Method`] if a position is not finite.
    pub fn predict(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
        options: PredictOptions,
    ) -> Result<Vec<Prediction>, AgentError> {
        self.update()?;
        let capped = match options.posterior {
            Which::Own => self.capped(&self.posteriors.own, self.own_longest_m(), queries)?,
            Which::Fused => self.capped(&self.posteriors.fused, self.longest_m(), queries)?,
        };
        let intervals = if options.intervals { Some(self.intervals(&capped)?) } else { None };
        let mut predictions: Vec<Prediction> = capped.into_iter().map(|capped| capped.prediction).collect();
        for (prediction, interval) in predictions.iter_mut().zip(intervals.into_iter().flatten()) {
            prediction.interval = Some(interval);
        }
        Ok(predictions)
    }

    /// Predicts each query from another posterior under the vehicle's prediction model.
    ///
    /// # Errors
    /// As [`Agent::predict`].
    pub fn predict_from(
        &self,
        posterior: &Posterior,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
    ) -> Result<Vec<Prediction>, AgentError> {
        let capped = self.capped(posterior, self.longest_m(), queries)?;
        Ok(capped.into_iter().map(|capped| capped.prediction).collect())
    }

    /// Draws joint log-odds of these queries by expectation propagation: one column for each column of standard
    /// normals. Normals that are [`INTERVAL_WIDENING`](crate::INTERVAL_WIDENING) times as large give draws that spread
    /// as the intervals of [`Agent::predict`] do. O(Mn² + M²n + M³) for M queries.
    ///
    /// # Errors
    /// As [`Agent::predict`], and for normals with another number of rows than queries.
    pub fn draws(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
        normals: &Matrix,
    ) -> Result<Matrix, AgentError> {
        let evaluated_at = self.evaluated_at(queries)?;
        let inputs = self.team().model.inputs(&evaluated_at)?;
        Ok(self.interval_posterior()?.draws(&inputs, normals)?.0)
    }

    /// Returns the query or the shorter part of it at which each prediction is evaluated.
    pub(crate) fn evaluated_at(
        &mut self,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
    ) -> Result<Vec<LinkQuery>, AgentError> {
        self.update()?;
        let capped = self.capped(&self.posteriors.fused, self.longest_m(), queries)?;
        Ok(capped.into_iter().map(|capped| capped.evaluated_at).collect())
    }

    fn capped(
        &self,
        posterior: &Posterior,
        longest_m: Option<f64>,
        queries: impl IntoIterator<Item = impl Into<LinkQuery>>,
    ) -> Result<Vec<CappedPrediction>, AgentError> {
        let queries = queries.into_iter().map(Into::into).collect();
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
        let ignored = self.ignored_members();
        let is_used = |member: &u8| !ignored.contains(member);
        let remote_m = self.memory.located().longest_m.iter().filter(|(member, _)| is_used(member)).map(|(_, &m)| m);
        packets.map(|packet| packet.longest_m).chain(remote_m).chain(self.own_longest_m()).reduce(f64::max)
    }

    fn own_longest_m(&self) -> Option<f64> {
        let site = self.team().model.site.iter();
        let before_m = site.flat_map(|site| site.links()).map(|link| link.range_m());
        before_m.chain(self.memory.longest_m()).reduce(f64::max)
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

/// Predicts each query without a cap.
fn predict(model: &Model, posterior: &Posterior, queries: &[LinkQuery]) -> dgpc::Result<Vec<Prediction>> {
    let inputs = model.inputs(queries)?;
    let latent = posterior.latent(&inputs)?;
    let prior = posterior.prior().kernel().diagonal(&inputs)?;
    let moments = latent.mean.iter().zip(&latent.variance).zip(latent.probability()).zip(&prior);
    let prediction = |(((&mean, &variance), probability), prior): (((&f64, &f64), f64), &f64)| Prediction {
        mean,
        variance,
        probability,
        explained: (1.0 - variance / prior).clamp(0.0, 1.0),
        interval: None,
    };
    Ok(moments.map(prediction).collect())
}
