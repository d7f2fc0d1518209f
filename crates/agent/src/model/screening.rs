//! Attempts to add optional terms. A search on some of the events rejects most terms before a search on all events.

use dgpc::Summary;

use crate::model::inputs::InputSpec;
use crate::model::learning::{LearnedModel, Learning};
use crate::model::link_model::Model;
use crate::model::optional_terms::OptionalTerm;
use crate::types::chart::Chart;
use crate::types::event::Event;

/// Maximum number of events in a screening.
const EVENTS_MAX: usize = 500;

/// Minimum number of events in a screening. Logs with fewer than twice as many are not screened, because a search on
/// all of their events takes about a second.
const EVENTS_MIN: usize = 150;

/// Smallest gain for which a term is added, in nats per event.
const GAIN_MIN_NATS: f64 = 0.001;

/// Factor of the gain in corrected evidence that an uncommon term must exceed, relative to the leave-one-out threshold.
const EVIDENCE_FACTOR: f64 = 2.0;

/// Gain in corrected evidence that the time term must exceed, in nats.
const TIME_EVIDENCE_MIN_NATS: f64 = 1.0;

/// Gain in corrected evidence that the time term must exceed in a screening, in nats. Fewer events show less of a
/// change with time.
const SCREENING_TIME_EVIDENCE_MIN_NATS: f64 = 0.0;

/// Number of standard errors by which the gains of a screening are raised before they are compared with the thresholds.
const SCREENING_ERRORS: f64 = 1.0;

/// The change by one more term, over the same events.
struct Comparison {
    /// Sum of the weights of the events. Weights below 1 of repeated events reduce it.
    count: f64,
    /// Mean gain of leave-one-out predictions, in nats per event.
    gain: f64,
    /// Standard error of that mean, from the paired gains.
    error: f64,
    /// Gain in corrected evidence, in nats.
    evidence: f64,
}

impl Comparison {
    fn of(after: &LearnedModel, before: &LearnedModel) -> Self {
        let [after, before] = [after, before].map(|model| &model.learned.fit);
        let pairs = after.leave_one_out().into_iter().zip(before.leave_one_out());
        let gains: Vec<f64> = pairs.map(|(after, before)| after - before).collect();
        let weighted = |value: &dyn Fn(f64) -> f64| {
            gains.iter().zip(before.weights()).map(|(&gain, weight)| weight * value(gain)).sum::<f64>()
        };
        let count = weighted(&|_| 1.0);
        let gain = weighted(&|gain| gain) / count;
        let error = (weighted(&|each| (each - gain).powi(2)) / (count - 1.0) / count).sqrt();
        Self { count, gain, error, evidence: after.corrected_evidence() - before.corrected_evidence() }
    }

    /// Returns whether a term is accepted after a search on all events: see [`Learning::try_term`].
    fn accepts(&self, term: OptionalTerm) -> bool {
        self.passes(term, GAIN_MIN_NATS.max(self.error), 0.0, TIME_EVIDENCE_MIN_NATS)
    }

    /// Returns whether a term could be accepted after a search on events of this total weight: whether gains that are
    /// one standard error higher would suffice.
    fn promises(&self, term: OptionalTerm, weight: f64) -> bool {
        let error_on_all = self.error * (self.count / weight).sqrt();
        self.passes(
            term,
            GAIN_MIN_NATS.max(error_on_all),
            SCREENING_ERRORS * self.error,
            SCREENING_TIME_EVIDENCE_MIN_NATS,
        )
    }

    /// Returns whether the gains in nats per event, raised by `margin`, exceed their thresholds. `threshold` is that of
    /// the leave-one-out gain, and `time_threshold` that of the evidence for a time term.
    fn passes(&self, term: OptionalTerm, threshold: f64, margin: f64, time_threshold: f64) -> bool {
        if self.count < 2.0 {
            return false;
        }
        if term == OptionalTerm::Time {
            return self.evidence > time_threshold;
        }
        let is_supported = self.evidence / self.count + margin > EVIDENCE_FACTOR * threshold;
        self.gain + margin > threshold && (term.is_common() || is_supported)
    }
}

/// A learned structure, and whether learning accepts it.
#[derive(Debug, Clone)]
pub struct Attempt {
    /// The model, learned from all events. If the screening rejected a term, it is learned from the events of the
    /// screening.
    pub model: LearnedModel,
    /// Whether the structure is accepted.
    pub is_accepted: bool,
    /// E at the optimum in nats per event. After a rejection by screening it is the value before the attempt plus the
    /// change on the events of the screening. All values for a log are therefore comparable.
    pub evidence_per_event: f64,
    /// Mean leave-one-out log predictive probability in nats. After a rejection by screening it is computed as
    /// [`Attempt::evidence_per_event`].
    pub leave_one_out: f64,
    /// Whether the screening rejected the term.
    pub is_screened_out: bool,
    /// The structure learned from the events of the screening. `None` if there are too few events.
    screened: Option<LearnedModel>,
}

impl Attempt {
    fn on_all(model: LearnedModel, is_accepted: bool, screened: Option<LearnedModel>) -> Self {
        let (evidence_per_event, leave_one_out) = (model.evidence_per_event(), model.leave_one_out());
        Self { model, is_accepted, evidence_per_event, leave_one_out, is_screened_out: false, screened }
    }

    fn on_some(model: LearnedModel, before: &Self, screened_before: &LearnedModel) -> Self {
        let change = |value: fn(&LearnedModel) -> f64| value(&model) - value(screened_before);
        let evidence_per_event = before.evidence_per_event + change(LearnedModel::evidence_per_event);
        let leave_one_out = before.leave_one_out + change(LearnedModel::leave_one_out);
        let (is_accepted, is_screened_out) = (false, true);
        Self { model, is_accepted, evidence_per_event, leave_one_out, is_screened_out, screened: None }
    }
}

impl Learning {
    /// Learns [`Learning::structure`]. [`Learning::try_term`] then tries terms in addition.
    ///
    /// # Errors
    /// As [`Learning::fit`].
    pub fn first_attempt(
        &self,
        chart: Chart,
        inputs: InputSpec,
        events: &[&Event],
        messages: &[&Summary],
    ) -> dgpc::Result<Attempt> {
        let model = self.fit(&self.structure, chart, inputs, events.iter().copied(), messages, None)?;
        let screened = self.screened(&model, events, messages)?;
        Ok(Attempt::on_all(model, true, screened))
    }

    /// Learns the structure of an accepted attempt with one more term, and decides about the term.
    ///
    /// The mean gain of leave-one-out predictions must exceed a threshold: 0.001 nats per event, or one standard error
    /// of the paired gains if that is larger. For an uncommon term the gain in corrected evidence per event must also
    /// exceed twice the threshold.
    ///
    /// The time term has another rule: the corrected evidence must rise by more than 1 nat in total, which is positive
    /// evidence on the scale of Kass and Raftery (1995). Leave-one-out predictions rarely show a change with time,
    /// because events at nearly the same time and place remain.
    ///
    /// An uncommon term is learned from half of the events first, and from at most 500. If the gains would not suffice
    /// there even if they were one standard error higher, the term is rejected at the cost of this short search.
    /// Otherwise it is learned from all events. Common terms ([`OptionalTerm::is_common`]) are not screened: they have
    /// small gains in many logs, which half of the events often do not show.
    ///
    /// # Errors
    /// As [`Learning::fit`].
    pub fn try_term(
        &self,
        term: OptionalTerm,
        before: &Attempt,
        events: &[&Event],
        messages: &[&Summary],
    ) -> dgpc::Result<Attempt> {
        let &LearnedModel { structure, events_used, model: Model { chart, inputs, .. }, .. } = &before.model;
        let structure = structure.with(term);
        let fit = |learning: &Self, earlier: &LearnedModel| {
            learning.fit(&structure, chart, inputs, events.iter().copied(), messages, Some(earlier))
        };
        let mut screened = None;
        if let Some(screened_before) = before.screened.as_ref().filter(|_| !term.is_common()) {
            let after = fit(&self.of_screening(events_used), screened_before)?;
            let weight = before.model.learned.fit.weights().iter().sum();
            if !Comparison::of(&after, screened_before).promises(term, weight) {
                return Ok(Attempt::on_some(after, before, screened_before));
            }
            screened = Some(after);
        }
        let model = fit(self, &before.model)?;
        let is_accepted = Comparison::of(&model, &before.model).accepts(term);
        if is_accepted && screened.is_none() {
            screened = self.screened(&model, events, messages)?;
        }
        Ok(Attempt::on_all(model, is_accepted, screened))
    }

    /// Returns the structure of a model, learned from the events of a screening. `None` if there is nothing to screen.
    fn screened(
        &self,
        model: &LearnedModel,
        events: &[&Event],
        messages: &[&Summary],
    ) -> dgpc::Result<Option<LearnedModel>> {
        let screening = self.of_screening(model.events_used);
        if self.additions.is_empty() || screening.events_max < EVENTS_MIN {
            return Ok(None);
        }
        let &Model { chart, inputs, .. } = &model.model;
        screening.fit(&model.structure, chart, inputs, events.iter().copied(), messages, Some(model)).map(Some)
    }

    /// Returns the settings of a screening for a search that uses this number of events.
    fn of_screening(&self, events_used: usize) -> Self {
        Self { events_max: (events_used / 2).min(EVENTS_MAX), ..self.clone() }
    }
}
