//! The average of the predictions under two models, weighted by how well each has predicted own events.

use dgpc::Latent;

use crate::agent::prediction::{CappedPrediction, Prediction};
use crate::agent::state::{Agent, Which};
use crate::error::AgentError;
use crate::inference::alternative::AlternativeModel;
use crate::model::link_model::Model;
use crate::store::entry::check_event;
use crate::types::event::Event;
use crate::types::query::LinkQuery;

/// Smallest probability of a scored outcome. It bounds the effect of one event on the weights.
const PROBABILITY_MIN: f64 = 1e-9;

/// Fused predictions under the team's model, and under the alternative model if there is one.
pub(crate) struct ModelPredictions {
    pub(crate) first: Vec<CappedPrediction>,
    pub(crate) second: Option<Vec<CappedPrediction>>,
}

impl ModelPredictions {
    /// Returns the average for each query; `weight` is that of the alternative.
    pub(crate) fn average(&self, weight: f64) -> Vec<Prediction> {
        let first = self.first.iter().map(|capped| capped.prediction);
        match &self.second {
            None => first.collect(),
            Some(second) => first.zip(second).map(|(one, other)| average(one, other.prediction, weight)).collect(),
        }
    }

    /// Returns the sum over events of the log score of the team's model minus that of the alternative, in nats.
    fn score_difference<'a>(&self, events: impl Iterator<Item = &'a Event>) -> f64 {
        let Some(second) = &self.second else { return 0.0 };
        let log_score = |capped: &CappedPrediction, event: &Event| {
            let success = capped.prediction.probability;
            (if event.success { success } else { 1.0 - success }).max(PROBABILITY_MIN).ln()
        };
        let pairs = self.first.iter().zip(second).zip(events);
        pairs.map(|((first, second), event)| log_score(first, event) - log_score(second, event)).sum()
    }
}

impl Agent {
    /// Averages predictions under the team's model and under `alternative` from now on. This is for a team model that
    /// was learned in other water: in this water the prior of a team without data may be better.
    ///
    /// The weights are the posterior probabilities of both models. Before any event they are equal. They follow from
    /// the probabilities that each model gave to own events before [`Agent::record`] recorded them; the events of one
    /// call are predicted together. If every event is predicted and recorded by itself, the average is at most ln 2
    /// nats behind the better model in total. The alternative is not part of a snapshot, and [`Agent::apply`] scores
    /// nothing: after [`Agent::restore`], call this function again. See docs/method/averaging.md.
    ///
    /// Both models use the same events, with the weights of repeated outcomes of the team's model. The alternative uses
    /// no summary packets, because these are under the team's model. Frames and [`Agent::draws`] stay under the team's
    /// model. After [`Agent::adapt`] the own model replaces the team's model in the average. Refits and queries cost
    /// about twice as much.
    ///
    /// # Errors
    /// [`AgentError::DifferentInputs`] if the models differ in the chart's origin, or if only one of them has depths.
    /// [`AgentError::Method`] for a numerical failure.
    pub fn average_with(&mut self, alternative: Model) -> Result<(), AgentError> {
        let own = &self.team().model;
        if (own.chart.origin, own.inputs) != (alternative.chart.origin, alternative.inputs) {
            return Err(AgentError::DifferentInputs);
        }
        let before = self.posteriors.alternative.replace(AlternativeModel::new(alternative));
        self.posteriors.invalidate();
        self.data_changed();
        let refitted = if self.posteriors.own_fit.is_some() { self.refit() } else { Ok(()) };
        if refitted.is_err() {
            self.posteriors.alternative = before;
            self.posteriors.invalidate();
            self.data_changed();
        }
        refitted
    }

    /// Returns the weight of the alternative model; 0 without one.
    pub(crate) fn alternative_weight(&self) -> f64 {
        self.posteriors.alternative.as_ref().map_or(0.0, AlternativeModel::weight)
    }

    /// Returns the log score by which the team's model predicts these events better than the alternative, in nats.
    pub(crate) fn score_difference<'a>(
        &mut self,
        events: impl Iterator<Item = &'a Event> + Clone,
    ) -> Result<f64, AgentError> {
        if self.posteriors.alternative.is_none() {
            return Ok(0.0);
        }
        events.clone().try_for_each(check_event)?;
        Ok(self.by_model(events.clone().map(Event::query).collect())?.score_difference(events))
    }

    /// Predicts each query from the fused posterior, and from that under the alternative model if there is one.
    pub(crate) fn by_model(&mut self, queries: Vec<LinkQuery>) -> Result<ModelPredictions, AgentError> {
        self.update()?;
        let under_alternative = |alternative: &AlternativeModel| {
            self.capped_under(&alternative.posterior, self.longest_m(), queries.clone())
        };
        let second = self.posteriors.alternative.as_ref().map(under_alternative).transpose()?;
        Ok(ModelPredictions { first: self.capped(Which::Fused, queries)?, second })
    }
}

/// Returns the average of two predictions; `weight` is that of the second. The moments are those of the mixture.
fn average(first: Prediction, second: Prediction, weight: f64) -> Prediction {
    let [mean, variance] = moments([first.mean, first.variance], [second.mean, second.variance], weight);
    let average = |first: f64, second: f64| first + weight * (second - first);
    let probability = average(first.probability, second.probability);
    Prediction { mean, variance, probability, explained: average(first.explained, second.explained), interval: None }
}

/// Returns mean and variance of the mixture of two distributions; `weight` is that of the second.
fn moments(first: [f64; 2], second: [f64; 2], weight: f64) -> [f64; 2] {
    let between = second[0] - first[0];
    let within = first[1] + weight * (second[1] - first[1]);
    [first[0] + weight * between, within + weight * (1.0 - weight) * between * between]
}

/// Returns the moments of the mixture of two latent functions at equal queries; `weight` is that of the second.
pub(crate) fn mixture(first: &Latent, second: &Latent, weight: f64) -> Latent {
    let of = |latent: &Latent, n: usize| [latent.mean[n], latent.variance[n]];
    let mixed = |n: usize| <(f64, f64)>::from(moments(of(first, n), of(second, n), weight));
    let (mean, variance) = (0..first.mean.len()).map(mixed).unzip();
    Latent { mean, variance }
}
