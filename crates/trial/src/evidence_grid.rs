//! Length-scale and variance by a coarse grid search on the evidence bound E (docs/method.md, section 7).

use dgpc::{Observations, Shape, mean_field};
use pingmap_agent::{Chart, Event, InputSpec, Model};
use rand::seq::SliceRandom;

use crate::split::stream;

/// Kernel variances that are tried.
const VARIANCES: [f64; 5] = [1.0, 4.0, 16.0, 64.0, 256.0];

/// Length-scales that are tried, as shares of the median distance between inputs.
const LENGTH_SCALE_SHARES: [f64; 9] = [2.0, 1.4, 1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.125];

/// Length-scale where all events happened at one place, so that nothing can be said about it.
const LENGTH_SCALE_FALLBACK_M: f64 = 500.0;

/// What is given, what is searched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KernelChoice {
    /// How covariance falls with distance.
    pub shape: Shape,
    /// Whether both directions of a link behave alike.
    pub reciprocal: bool,
    /// Length-scale in metres; searched if not given.
    pub length_scale_m: Option<f64>,
    /// Kernel variance; searched if not given.
    pub variance: Option<f64>,
}

/// The model found.
#[derive(Debug, Clone, PartialEq)]
pub struct GridFit {
    /// The model.
    pub model: Model,
    /// Its length-scale, in metres.
    pub length_scale_m: f64,
    /// Its kernel variance.
    pub variance: f64,
    /// E of the events used, in nats; `None` where both numbers were given and nothing was searched.
    pub evidence: Option<f64>,
    /// How many events the search looked at.
    pub events_used: usize,
    /// Whether a number that was searched took the largest or smallest value tried.
    pub at_grid_edge: bool,
}

/// The most events that the search looks at; of more, so many are drawn.
pub const GRID_EVENTS_MAX: usize = 600;

/// Finds the model of largest evidence among 9 length-scales × 5 variances, on at most [`GRID_EVENTS_MAX`] of `events`, drawn
/// with `seed`. Numbers that are given are kept. O(45 · iterations · N³).
///
/// # Errors
/// [`dgpc::Error`] for a length-scale or variance that is not finite and positive, or a position that is not finite.
pub fn search(
    choice: &KernelChoice,
    chart: Chart,
    inputs: InputSpec,
    events: &[&Event],
    seed: u64,
) -> dgpc::Result<GridFit> {
    let model = |length_scale_m, variance| {
        Model::isotropic(chart, inputs, choice.shape, choice.reciprocal, length_scale_m, variance)
    };
    if let (Some(length_scale_m), Some(variance)) = (choice.length_scale_m, choice.variance) {
        let model = model(length_scale_m, variance)?;
        return Ok(GridFit { model, length_scale_m, variance, evidence: None, events_used: 0, at_grid_edge: false });
    }
    let mut drawn: Vec<&Event> = events.to_vec();
    if drawn.len() > GRID_EVENTS_MAX {
        drawn.shuffle(&mut stream(seed, u64::MAX - 1));
        drawn.truncate(GRID_EVENTS_MAX);
    }
    let rows = model(1.0, 1.0)?.inputs(drawn.iter().map(|event| &event.link))?;
    let length_scales_m = match (choice.length_scale_m, median_distance(&rows)) {
        (Some(length_scale_m), _) => vec![length_scale_m],
        (None, 0.0) => vec![LENGTH_SCALE_FALLBACK_M],
        (None, distance) => LENGTH_SCALE_SHARES.iter().map(|share| share * distance).collect(),
    };
    let variances = choice.variance.map_or(VARIANCES.to_vec(), |variance| vec![variance]);
    let observations = Observations::new(rows, drawn.iter().map(|event| event.success).collect())?;

    // E is stationary in the tilts, so that a tolerance of 1e-3 costs it about 1e-6 an event; each fit starts from its neighbour.
    let mut options = mean_field::Options { tolerance: 1e-3, iterations_max: 100, start: None };
    let mut best: Option<GridFit> = None;
    for (row, &length_scale_m) in length_scales_m.iter().enumerate() {
        // To and fro through the variances, so that neighbours follow each other.
        for column in 0..variances.len() {
            let column = if row % 2 == 0 { column } else { variances.len() - 1 - column };
            let variance = variances[column];
            let model = model(length_scale_m, variance)?;
            let fit = mean_field::dense(&model.prior, &observations, &options)?;
            if best.as_ref().is_none_or(|best| Some(fit.evidence) > best.evidence) {
                let edge = |place: usize, tried: usize| tried > 1 && (place == 0 || place + 1 == tried);
                best = Some(GridFit {
                    model,
                    length_scale_m,
                    variance,
                    evidence: Some(fit.evidence),
                    events_used: observations.len(),
                    at_grid_edge: edge(row, length_scales_m.len()) || edge(column, variances.len()),
                });
            }
            options.start = Some(fit.tilts);
        }
    }
    best.ok_or(dgpc::Error::OutOfRange { what: "number of grid points", expected: "at least 1", value: 0.0 })
}

/// Median distance between distinct inputs, over at most 200 of them spread over the log; 0 with fewer than two.
fn median_distance(inputs: &dgpc::Inputs) -> f64 {
    let rows: Vec<&[f64]> = inputs.rows().step_by(inputs.len().div_ceil(200).max(1)).collect();
    let distance = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt();
    let pairs = (0..rows.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
    let mut distances: Vec<f64> = pairs.map(|(a, b)| distance(rows[a], rows[b])).filter(|&d| d > 0.0).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pingmap_agent::{Link, Position, VehicleId};

    const CHOICE: KernelChoice =
        KernelChoice { shape: Shape::Matern52, reciprocal: true, length_scale_m: None, variance: None };

    fn events(link: impl Fn(usize) -> (f64, f64), success: impl Fn(f64) -> bool) -> Vec<Event> {
        let event = |n: usize| {
            let (east_m, north_m) = link(n);
            let link = Link { transmitter: Position::new(0.0, 0.0), receiver: Position::new(east_m, north_m) };
            let (transmitter_id, receiver_id) = (VehicleId::new("t"), VehicleId::new("r"));
            Event { time_s: n as f64, transmitter_id, receiver_id, success: success(link.range_m()), link }
        };
        (0..150).map(event).collect()
    }

    fn search_in(choice: &KernelChoice, events: &[Event]) -> GridFit {
        let chart = Chart { origin: Position::new(0.0, 0.0), geographic: None };
        search(choice, chart, InputSpec::Positions, &events.iter().collect::<Vec<_>>(), 1).expect("a fit")
    }

    #[test]
    fn rings_of_success_want_a_shorter_length_scale_than_a_disc() {
        let spread = |n: usize| ((n * 37 % 101) as f64 * 20.0, (n * 53 % 97) as f64 * 20.0);
        let disc = search_in(&CHOICE, &events(spread, |range_m| range_m < 1000.0));
        let rings = search_in(&CHOICE, &events(spread, |range_m| (range_m / 300.0).sin() > 0.0));
        assert!(rings.length_scale_m < disc.length_scale_m, "{} {}", rings.length_scale_m, disc.length_scale_m);
        // The best of the grid: at the other's length-scale the disc does no better.
        let given = KernelChoice { length_scale_m: Some(rings.length_scale_m), ..CHOICE };
        let other = search_in(&given, &events(spread, |range_m| range_m < 1000.0));
        assert!(other.evidence <= disc.evidence.map(|evidence| evidence + 0.01));
    }

    #[test]
    fn what_is_given_is_kept() {
        let events = events(|n| (n as f64, 0.0), |range_m| range_m < 70.0);
        let both = search_in(&KernelChoice { length_scale_m: Some(123.0), variance: Some(7.0), ..CHOICE }, &events);
        assert_eq!((both.length_scale_m, both.variance, both.evidence), (123.0, 7.0, None));
        let one = search_in(&KernelChoice { variance: Some(7.0), ..CHOICE }, &events);
        assert_eq!(one.variance, 7.0);
        assert!(one.evidence.is_some() && one.events_used == 150);
    }

    #[test]
    fn one_place_says_nothing_about_length() {
        let fit = search_in(&CHOICE, &events(|_| (300.0, 400.0), |_| true));
        assert_eq!(fit.length_scale_m, LENGTH_SCALE_FALLBACK_M);
        let none = search_in(&CHOICE, &[]);
        assert_eq!((none.length_scale_m, none.events_used), (LENGTH_SCALE_FALLBACK_M, 0));
    }
}
