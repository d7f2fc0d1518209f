//! Learning a model from events: the numbers of one structure, and the choice among several (docs/method.md, section
//! 7).

use dgpc::{HyperPrior, LearnOptions, Learned, Prior, PriorMean, Summary, spread_out};

use crate::chart::Chart;
use crate::event::Event;
use crate::fading::Fading;
use crate::limits::Limits;
use crate::model::{InputSpec, Model};
use crate::structure::{Addition, Given, MeanStructure, Structure};

/// What an addition must be worth, in nats an event.
const WORTH_NATS: f64 = 0.001;

/// By how much more the corrected evidence must speak for what is not ordinary. Offsets and noise that were there gained 2.4 standard
/// errors and more on ten splits of quay4, what was not there 1.1 at most on fjord4.
const EVIDENCE_WORTH: f64 = 2.0;

/// Share of the events that repeats must cost before anything is learned of them.
const REPEATED: f64 = 0.02;

/// Where the search with an addition ends: far below what it must be worth.
const ADDITION_TOLERANCE: f64 = 1e-6;

/// What decides among structures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Criterion {
    /// The mean leave-one-out log predictive probability.
    LeaveOneOut,
    /// The evidence bound E.
    Evidence,
}

/// What is tried, what is given, and how much work it may take.
#[derive(Debug, Clone, PartialEq)]
pub struct Learning {
    /// The structures to choose from.
    pub structures: Vec<Structure>,
    /// What is tried beside the chosen one, in this order: [`LearnedModel::is_worth_it`] decides.
    pub additions: Vec<Addition>,
    /// What decides among them.
    pub criterion: Criterion,
    /// All length-scales, in metres, where they are given and not learned.
    pub length_scale_m: Option<f64>,
    /// The variance of every term, where it is given and not learned.
    pub variance: Option<f64>,
    /// How outcomes at one place fade, where it is given and not learned.
    pub fading: Option<Fading>,
    /// Learn from at most so many events, spread evenly over the log.
    pub events_max: usize,
    /// When to go from dense to sparse fits.
    pub limits: Limits,
}

impl Default for Learning {
    /// One structure ([`Given::few`]) and all additions.
    fn default() -> Self {
        Self {
            structures: Given::default().few(),
            additions: Addition::ALL.to_vec(),
            criterion: Criterion::LeaveOneOut,
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
    /// Its kernel and prior mean without their numbers.
    pub structure: Structure,
    /// Everything about the search.
    pub learned: Learned,
    /// How many events it looked at.
    pub events_used: usize,
    /// How many there were.
    pub events: usize,
    /// The model.
    pub model: Model,
}

impl LearnedModel {
    /// E at the optimum over the events used, in nats.
    pub fn evidence(&self) -> f64 {
        self.learned.optimum_evidence
    }

    /// Mean leave-one-out log predictive probability of the events used, each as much as it counts, in nats; 0 without any.
    pub fn leave_one_out(&self) -> f64 {
        let (fit, weights) = (&self.learned.fit, self.learned.fit.weights());
        let sum: f64 = fit.leave_one_out().iter().zip(weights).map(|(log, weight)| weight * log).sum();
        if weights.is_empty() { 0.0 } else { sum / weights.iter().sum::<f64>() }
    }

    /// Whether this model, which has `addition` beyond `before`, explains the same events so much better that the addition
    /// is taken: leave-one-out predictions must gain more than .001 nats an event, and more than one standard error of
    /// their paired differences, and the corrected evidence twice as much where the addition is not an ordinary one.
    pub fn is_worth_it(&self, addition: Addition, before: &LearnedModel) -> bool {
        let [after, before] = [self, before].map(|model| &model.learned.fit);
        let pairs = after.leave_one_out().into_iter().zip(before.leave_one_out());
        let gains: Vec<f64> = pairs.map(|(after, before)| after - before).collect();
        // As many events as there are count, or fewer where they repeat one another.
        let weighted = |of: &dyn Fn(f64) -> f64| {
            gains.iter().zip(before.weights()).map(|(&gain, weight)| weight * of(gain)).sum::<f64>()
        };
        let count = weighted(&|_| 1.0);
        if count < 2.0 {
            return false;
        }
        let mean = weighted(&|gain| gain) / count;
        let variance = weighted(&|gain| (gain - mean).powi(2)) / (count - 1.0);
        let least = WORTH_NATS.max((variance / count).sqrt());
        let evidence = (after.corrected_evidence() - before.corrected_evidence()) / count;
        mean > least && (addition.is_ordinary() || evidence > EVIDENCE_WORTH * least)
    }

    /// What `criterion` says of it; more is better.
    pub fn merit(&self, criterion: Criterion) -> f64 {
        match criterion {
            Criterion::LeaveOneOut => self.leave_one_out(),
            Criterion::Evidence => self.evidence(),
        }
    }
}

impl Learning {
    /// The prior of a structure before anything is learned, with the numbers that are given.
    ///
    /// # Errors
    /// As [`Structure::template`]; [`dgpc::Error::OutOfRange`] for a given number that is not finite and positive.
    pub fn template(&self, structure: &Structure, inputs: InputSpec, scale_m: f64) -> dgpc::Result<Prior> {
        let template = structure.template(inputs, self.length_scale_m.unwrap_or(scale_m))?;
        let mean = structure.template(inputs, scale_m)?.mean().clone();
        match self.variance {
            Some(variance) => with_variance(&template, variance, mean),
            None => Prior::new(template.kernel().clone(), mean),
        }
    }

    /// Learns the numbers of one structure from `events` and from what others said. An earlier fit of the same
    /// structure is where it starts, and makes it cheap: one search, whose result is never worse in E.
    ///
    /// # Errors
    /// [`dgpc::Error`] for a position that is not finite, or a scale or given number that is not finite and positive.
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
        let used = self.used(&events);
        let observations = template.observations(used.iter().copied())?;
        let start =
            earlier.map(|earlier| structure.begin_at(&template.prior, (&earlier.structure, &earlier.learned.optimum)));
        let start = start.transpose()?;
        let begun = start.as_ref().zip(earlier.map(|earlier| &earlier.structure));
        let further = structure.further_starts(&template.prior, begun)?;
        let mut options = self.options(structure).messages(messages).further_starts(&further);
        options.warm_start = start.as_ref();
        let tilts = earlier.map(|earlier| earlier.learned.fit.tilts());
        options.tilts = tilts.filter(|tilts| tilts.len() == observations.len());
        if begun.is_some_and(|(_, earlier)| earlier != structure) {
            options.tolerance = ADDITION_TOLERANCE;
        }
        let learned = dgpc::learn(&template.prior, &observations, &options)?;
        let model = Model { prior: learned.prior.clone(), ..template };
        Ok(LearnedModel {
            structure: *structure,
            learned,
            events_used: observations.len(),
            events: events.len(),
            model,
        })
    }

    /// Learns every structure, takes the best fit by [`Learning::criterion`], and tries [`Learning::additions`] beside it.
    ///
    /// # Errors
    /// As [`Learning::fit`]; [`dgpc::Error::OutOfRange`] without structures.
    pub fn best<'a>(
        &self,
        chart: Chart,
        inputs: InputSpec,
        events: impl IntoIterator<Item = &'a Event> + Clone,
        messages: &[&Summary],
    ) -> dgpc::Result<LearnedModel> {
        let fits =
            self.structures.iter().map(|structure| self.fit(structure, chart, inputs, events.clone(), messages, None));
        let mut best = self.choose(fits.collect::<dgpc::Result<_>>()?)?;
        for addition in self.additions_to(&events.clone().into_iter().collect::<Vec<_>>()) {
            if best.structure.can_have(addition) {
                let structure = best.structure.with(addition);
                let after = self.fit(&structure, chart, inputs, events.clone(), messages, Some(&best))?;
                best = if after.is_worth_it(addition, &best) { after } else { best };
            }
        }
        self.with_fading(best, events, messages)
    }

    /// The additions that may be worth trying on these events: kinds of messages only where there are several.
    pub fn additions_to(&self, events: &[&Event]) -> Vec<Addition> {
        let has_kinds = events.iter().any(|event| event.kind != events[0].kind);
        self.additions.iter().copied().filter(|&addition| has_kinds || addition != Addition::Kinds).collect()
    }

    /// The same model with the fading of its events, learned from what it leaves unexplained of them, and its numbers learned
    /// again where events count otherwise for it. Where it is given, or hardly any event repeats another one, that is the
    /// model as it is.
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
        let used = self.used(&events);
        let fit = &learned.learned.fit;
        let (before, count) = (fit.weights(), used.len() as f64);
        if self.fading.is_some() || before.iter().sum::<f64>() >= (1.0 - REPEATED) * count {
            return Ok(learned);
        }
        let fading = learned.model.fading.learned(&used, &fit.probabilities());
        let after = fading.weights(&used);
        let changed: f64 = before.iter().zip(&after).map(|(before, after)| (after - before).abs()).sum();
        learned.model.fading = fading;
        if changed < REPEATED * count {
            return Ok(learned);
        }
        let &LearnedModel { structure, model: Model { chart, inputs, .. }, .. } = &learned;
        self.fit(&structure, chart, inputs, events, messages, Some(&learned))
    }

    fn used<'a>(&self, events: &[&'a Event]) -> Vec<&'a Event> {
        spread_out(events.len(), self.events_max).into_iter().map(|n| events[n]).collect()
    }

    /// The best of several fits; the first of equals.
    ///
    /// # Errors
    /// [`dgpc::Error::OutOfRange`] without any.
    pub fn choose(&self, fits: Vec<LearnedModel>) -> dgpc::Result<LearnedModel> {
        let merit = |fit: &LearnedModel| fit.merit(self.criterion);
        let best = fits.into_iter().reduce(|best, next| if merit(&next) > merit(&best) { next } else { best });
        best.ok_or(dgpc::Error::OutOfRange { what: "number of structures", expected: "at least 1", value: 0.0 })
    }

    fn options(&self, structure: &Structure) -> LearnOptions<'static> {
        let mut hyper_prior = HyperPrior::default();
        if let MeanStructure::Conservative { .. } = structure.mean {
            // What people state before the first event takes more than a few events to change.
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

/// The prior with the given mean and the same variance for every term.
fn with_variance(prior: &Prior, variance: f64, mean: PriorMean) -> dgpc::Result<Prior> {
    let terms = prior.kernel().terms().iter().map(|term| term.with_variance(variance)).collect::<dgpc::Result<_>>()?;
    Prior::new(dgpc::Kernel::new(terms)?, mean)
}
