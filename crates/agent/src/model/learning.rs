//! Learning of a model from events: the parameters of one structure, and the choice among several
//! ([`dgpc::method::learning`]).

use dgpc::{HyperPrior, LearnOptions, Learned, Prior, PriorMean, Summary, spread_out};

use crate::model::fading::Fading;
use crate::model::inputs::InputSpec;
use crate::model::link_model::Model;
use crate::model::optional_terms::OptionalTerm;
use crate::model::structure::{MeanStructure, Structure};
use crate::types::chart::Chart;
use crate::types::event::Event;
use crate::types::interrupt::Interrupt;
use crate::types::limits::Limits;

/// Smallest share of the total weight that fading must remove, or change, before the model is learned again.
const WEIGHT_CHANGE_MIN: f64 = 0.02;

/// Tolerance of a search with an added term, in nats per event. It is far below the smallest gain for which the term is
/// added.
const ADDITION_TOLERANCE: f64 = 1e-6;

/// The settings of learning: structure, fixed parameters, and limits on the work.
#[derive(Debug, Clone, PartialEq)]
pub struct Learning {
    /// Structure with which learning starts.
    pub structure: Structure,
    /// Optional terms to add to the structure, in order of trial. [`Learning::try_term`] decides about each.
    pub additions: Vec<OptionalTerm>,
    /// Fixed value of all horizontal length-scales, in metres. `None` if length-scales are learned. With a fixed value,
    /// those of depths, aspects and times keep the values of the template.
    pub length_scale_m: Option<f64>,
    /// Fixed variance of every term. `None` if variances are learned.
    pub variance: Option<f64>,
    /// Fixed fading. `None` if fading is learned.
    pub fading: Option<Fading>,
    /// Maximum number of events to learn from. They are spread evenly over the log.
    pub events_max: usize,
    /// Limits of fits, such as the largest number of events of a dense fit.
    pub limits: Limits,
}

impl Default for Learning {
    /// Returns settings with the default structure and all optional terms.
    fn default() -> Self {
        Self {
            structure: Structure::default(),
            additions: OptionalTerm::ALL.to_vec(),
            length_scale_m: None,
            variance: None,
            fading: None,
            events_max: 2000,
            limits: Limits::default(),
        }
    }
}

/// A model learned from events.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct LearnedModel {
    /// Structure of the kernel and the prior mean.
    pub structure: Structure,
    /// Result of the search.
    pub learned: Learned,
    /// Number of events that were used.
    pub events_used: usize,
    /// Number of events in the log.
    pub events: usize,
    /// Resulting model.
    pub model: Model,
}

impl LearnedModel {
    /// Returns E at the optimum over the events used, in nats.
    pub fn evidence(&self) -> f64 {
        self.learned.optimum_evidence
    }

    /// Returns E at the optimum per event used, in nats.
    pub fn evidence_per_event(&self) -> f64 {
        self.evidence() / self.events_used.max(1) as f64
    }

    /// Returns the weighted mean leave-one-out log predictive probability of the events used, in nats. Returns 0
    /// without events.
    pub fn leave_one_out(&self) -> f64 {
        let (fit, weights) = (&self.learned.fit, self.learned.fit.weights());
        let sum: f64 = fit.leave_one_out().iter().zip(weights).map(|(log, weight)| weight * log).sum();
        if weights.is_empty() { 0.0 } else { sum / weights.iter().sum::<f64>() }
    }
}

impl Learning {
    /// Returns the prior of a structure before learning, with the fixed parameters. `scale_m` is the scale of the
    /// chart, in metres.
    ///
    /// # Errors
    /// As [`Structure::template`]. [`dgpc::Error::OutOfRange`] for a fixed parameter that is not finite and positive.
    pub fn template(&self, structure: &Structure, inputs: InputSpec, scale_m: f64) -> dgpc::Result<Prior> {
        let template = structure.template(inputs, self.length_scale_m.unwrap_or(scale_m))?;
        let mean = structure.template(inputs, scale_m)?.mean().clone();
        match self.variance {
            Some(variance) => with_variance(&template, variance, mean),
            None => Prior::new(template.kernel().clone(), mean),
        }
    }

    /// Learns the parameters of one structure from `events` and from the summaries of others in `messages`.
    ///
    /// An earlier fit of the same structure is a warm start. It reduces the work to one search, whose result is never
    /// worse in E.
    ///
    /// # Errors
    /// [`dgpc::Error`] for a position that is not finite, or for a scale or fixed parameter that is not finite and
    /// positive. [`dgpc::Error::Stopped`] after a request of the [`Interrupt`].
    pub fn fit<'a>(
        &self,
        structure: &Structure,
        chart: Chart,
        inputs: InputSpec,
        events: impl IntoIterator<Item = &'a Event>,
        messages: &[&Summary],
        earlier: Option<&LearnedModel>,
    ) -> dgpc::Result<LearnedModel> {
        let prior = self.template(structure, inputs, chart.scale_m)?;
        let fading = self.fading.or_else(|| earlier.map(|earlier| earlier.model.fading)).unwrap_or_default();
        let template = Model { fading, ..Model::new(chart, inputs, prior) };
        let events: Vec<&Event> = events.into_iter().collect();
        let used = self.select_events(&events);
        let observations = template.observations(used.iter().copied())?;
        let warm_start = earlier.map(|earlier| {
            structure.transfer_parameters(&template.prior, (&earlier.structure, &earlier.learned.optimum))
        });
        let warm_start = warm_start.transpose()?;
        let transferred = warm_start.as_ref().zip(earlier.map(|earlier| &earlier.structure));
        let further = structure.further_starts(&template.prior, transferred)?;
        let mut options = self.search_options(structure).messages(messages).further_starts(&further);
        options.warm_start = warm_start.as_ref();
        let tilts = earlier.map(|earlier| earlier.learned.fit.tilts());
        options.tilts = tilts.filter(|tilts| tilts.len() == observations.len());
        if transferred.is_some_and(|(_, earlier)| earlier != structure) {
            options.tolerance = ADDITION_TOLERANCE;
        }
        let interrupt = Interrupt::attached();
        let monitor = |progress| interrupt.monitor(progress);
        let learned = dgpc::learn(&template.prior, &observations, &options.monitor(&monitor))?;
        let model = Model { prior: learned.prior.clone(), ..template };
        Ok(LearnedModel {
            structure: *structure,
            learned,
            events_used: observations.len(),
            events: events.len(),
            model,
        })
    }

    /// Learns [`Learning::structure`], and adds the [`Learning::additions`] that improve it.
    ///
    /// # Errors
    /// As [`Learning::fit`].
    pub fn best<'a>(
        &self,
        chart: Chart,
        inputs: InputSpec,
        events: impl IntoIterator<Item = &'a Event>,
        messages: &[&Summary],
    ) -> dgpc::Result<LearnedModel> {
        let events: Vec<&Event> = events.into_iter().collect();
        let mut best = self.first_attempt(chart, inputs, &events, messages)?;
        for addition in self.additions_to(&events, inputs) {
            if best.model.structure.can_have(addition) {
                let after = self.try_term(addition, &best, &events, messages)?;
                best = if after.is_accepted { after } else { best };
            }
        }
        self.with_fading(best.model, events, messages)
    }

    /// Returns the additions to try on these events. Offsets of message kinds need several kinds, and layers need
    /// depths. Aspects need headings.
    pub fn additions_to(&self, events: &[&Event], inputs: InputSpec) -> Vec<OptionalTerm> {
        let can_have = |addition: &OptionalTerm| match addition {
            OptionalTerm::Kinds => events.iter().any(|event| event.kind != events[0].kind),
            OptionalTerm::TransmitterAspect => events.iter().any(|event| event.link.transmitter.heading_deg.is_some()),
            OptionalTerm::ReceiverAspect => events.iter().any(|event| event.link.receiver.heading_deg.is_some()),
            OptionalTerm::Vertical => inputs.has_depths(),
            _ => true,
        };
        self.additions.iter().copied().filter(can_have).collect()
    }

    /// Estimates fading from the residuals of a learned model, and learns the model again if the weights of events
    /// change.
    ///
    /// The model stays as it is if fading is fixed, or if the present fading reduces the total weight by less than 2 %.
    /// Its parameters stay if the new fading changes the weights by less than 2 % in total.
    ///
    /// # Errors
    /// As [`Learning::fit`].
    pub fn with_fading<'a>(
        &self,
        mut learned: LearnedModel,
        events: impl IntoIterator<Item = &'a Event>,
        messages: &[&Summary],
    ) -> dgpc::Result<LearnedModel> {
        let events: Vec<&Event> = events.into_iter().collect();
        let used = self.select_events(&events);
        let fit = &learned.learned.fit;
        let (before, count) = (fit.weights(), used.len() as f64);
        if self.fading.is_some() || before.iter().sum::<f64>() >= (1.0 - WEIGHT_CHANGE_MIN) * count {
            return Ok(learned);
        }
        let fading = learned.model.fading.reestimate(&used, &fit.probabilities());
        let after = fading.weights(&used);
        let changed: f64 = before.iter().zip(&after).map(|(before, after)| (after - before).abs()).sum();
        learned.model.fading = fading;
        if changed < WEIGHT_CHANGE_MIN * count {
            return Ok(learned);
        }
        let &LearnedModel { structure, model: Model { chart, inputs, .. }, .. } = &learned;
        self.fit(&structure, chart, inputs, events, messages, Some(&learned))
    }

    /// Returns at most [`Learning::events_max`] of the events, spread evenly.
    fn select_events<'a>(&self, events: &[&'a Event]) -> Vec<&'a Event> {
        spread_out(events.len(), self.events_max).into_iter().map(|n| events[n]).collect()
    }

    fn search_options(&self, structure: &Structure) -> LearnOptions<'static> {
        let mut hyper_prior = HyperPrior::default();
        if let MeanStructure::Conservative { .. } = structure.mean {
            // With a standard deviation of 1, more than a few events are needed to move the intercept that the user
            // fixed.
            hyper_prior = hyper_prior.intercept(1.0);
        }
        if self.length_scale_m.is_some() {
            hyper_prior = hyper_prior.length_scale(0.0);
        }
        if self.variance.is_some() {
            hyper_prior = hyper_prior.variance(0.0);
        }
        let Limits { dense_events_max, inducing_points_max, .. } = self.limits;
        let options = LearnOptions::default().hyper_prior(hyper_prior);
        options.sparse_beyond(dense_events_max, inducing_points_max)
    }
}

/// Returns the prior with the given mean and with one variance for all terms.
fn with_variance(prior: &Prior, variance: f64, mean: PriorMean) -> dgpc::Result<Prior> {
    let terms = prior.kernel().terms().iter().map(|term| term.with_variance(variance)).collect::<dgpc::Result<_>>()?;
    Prior::new(dgpc::Kernel::new(terms)?, mean)
}
