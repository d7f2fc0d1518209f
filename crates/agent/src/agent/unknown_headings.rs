//! Predictions for links of which a heading is unknown: means over headings.

use dgpc::{Inputs, Latent, Posterior};

use crate::model::inputs::End;
use crate::model::link_model::Model;
use crate::types::event::{Link, Position};
use crate::types::query::{LinkQuery, UnknownHeading};

/// Number of headings over which a prediction is averaged.
const HEADINGS: usize = 8;

/// Steps of the headings of transmitter and receiver, in units of a turn divided by [`HEADINGS`]. The steps differ and
/// have no common factor with the number of headings. Every heading of either end therefore occurs once.
const STEPS: [usize; 2] = [1, 3];

/// Moments of predictions, means over the headings of every query.
pub(crate) struct HeadingAverage {
    /// Moments of the log-odds. The variance includes that of the mean over headings.
    pub(crate) latent: Latent,
    /// Probabilities of success.
    pub(crate) probability: Vec<f64>,
    /// Share of the prior variance that the data explain.
    pub(crate) explained: Vec<f64>,
}

impl HeadingAverage {
    /// Predicts every query. If the model has aspect terms, an unknown heading is replaced by eight headings, evenly
    /// distributed over the circle, unless the query leaves it out. O(n²) for a query and heading.
    pub(crate) fn new(model: &Model, posterior: &Posterior, queries: &[LinkQuery]) -> dgpc::Result<Self> {
        // The prior may be one that the vehicle learned itself.
        let kernel = posterior.prior().kernel();
        let has_aspect = [End::Transmitter, End::Receiver].map(|end| model.inputs.is_aspect_in(kernel, end));
        let is_open = |query: &LinkQuery| {
            let mut ends = query.link.ends().into_iter().zip(has_aspect);
            query.unknown_heading == UnknownHeading::Averaged
                && ends.any(|(end, has_aspect)| has_aspect && end.heading_deg.is_none())
        };
        let inputs = match queries.iter().any(is_open) {
            false => model.inputs(queries)?,
            true => model.inputs(queries.iter().flat_map(|query| (0..HEADINGS).map(|n| with_heading(query, n))))?,
        };
        Self::of_groups(posterior, &inputs, inputs.len().checked_div(queries.len()).unwrap_or(1))
    }

    /// Predicts `inputs`, and averages over groups of `each`.
    fn of_groups(posterior: &Posterior, inputs: &Inputs, each: usize) -> dgpc::Result<Self> {
        let latent = posterior.latent(inputs)?;
        let prior = posterior.prior().kernel().diagonal(inputs)?;
        let probability = latent.probability();
        let average = |values: &[f64]| values.iter().sum::<f64>() / each as f64;
        let averages = |values: &[f64]| values.chunks(each).map(average).collect::<Vec<f64>>();
        let mean = averages(&latent.mean);
        let within = averages(&latent.variance);
        let between =
            latent.mean.chunks(each).zip(&mean).map(|(group, mean)| {
                group.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / each as f64
            });
        let variance = within.iter().zip(between).map(|(within, between)| within + between).collect();
        let shares = within.iter().zip(averages(&prior)).map(|(within, prior)| (1.0 - within / prior).clamp(0.0, 1.0));
        Ok(Self { explained: shares.collect(), latent: Latent { mean, variance }, probability: averages(&probability) })
    }
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
