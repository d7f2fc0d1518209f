//! Learning a prior: the evidence bound against the marginal likelihood, the ends of searches, and invalid arguments.

mod bound;
mod bounds;
mod little_information;
mod recovery;
mod refusals;
mod search;

use crate::common::{Dense, assert_near, cholesky, dot, logistic, rows, seeded, solve, transposed};
use dgpc::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::{ChiSquared, StandardNormal};

fn prior(terms: Vec<Term>, mean: PriorMean) -> Prior {
    Prior::new(Kernel::new(terms).unwrap(), mean).unwrap()
}

/// Returns a term over the first columns, with one length-scale for each.
fn term(shape: Shape, variance: f64, length_scales: &[f64]) -> Term {
    let columns: Vec<usize> = (0..length_scales.len()).collect();
    Term::new(shape, variance, &columns, length_scales).unwrap()
}

fn range_mean(intercept: f64, slope: f64) -> PriorMean {
    PriorMean::range(intercept, slope, &[0], &[1]).unwrap()
}

fn inputs(rng: &mut ChaCha8Rng, count: usize, dimension: usize, reach: f64) -> Inputs {
    let values = (0..count * dimension).map(|_| rng.random_range(-reach..reach)).collect();
    Inputs::new(values, dimension).unwrap()
}

fn normals(rng: &mut ChaCha8Rng, count: usize) -> Vec<f64> {
    (0..count).map(|_| rng.sample(StandardNormal)).collect()
}

/// Returns two-dimensional events whose odds vary along the first column only.
fn waves(seed: u64, count: usize) -> Observations {
    let mut rng = seeded(seed);
    let inputs = inputs(&mut rng, count, 2, 2.0);
    let outcomes = inputs.rows().map(|x| rng.random::<f64>() < logistic(3.0 * (2.0 * x[0]).sin())).collect();
    Observations::new(inputs, outcomes).unwrap()
}

/// Returns priors over two columns that cover every kind of parameter: separate length-scales, sums of terms, tied and
/// reciprocal columns, and each prior mean.
fn templates() -> [Prior; 3] {
    let matern = Term::isotropic(Shape::Matern52, 3.0, 1.0, 2).unwrap();
    let column = Term::new(Shape::Matern32, 1.0, &[1], &[0.8]).unwrap();
    let reciprocal = Term::isotropic(Shape::SquaredExponential, 4.0, 0.9, 2).unwrap();
    let reciprocal = reciprocal.reciprocal(Reflection::swap(&[(0, 1)]).unwrap()).unwrap();
    [
        prior(vec![term(Shape::SquaredExponential, 4.0, &[1.0, 1.0])], PriorMean::Zero),
        prior(vec![matern, column], PriorMean::Constant(0.2)),
        prior(vec![reciprocal], range_mean(0.5, 0.3)),
    ]
}

/// Returns a summary at three points by another agent with another prior.
fn message(seed: u64) -> Summary {
    let other = prior(vec![term(Shape::Matern32, 1.5, &[1.2, 0.7])], PriorMean::Constant(0.3));
    let events = waves(seed, 12);
    let sites = Sites::new(&events, vec![0.2; 12]).unwrap();
    Summary::marginal(&other, &sites, &events.inputs().select(&[0, 4, 8])).unwrap()
}

/// Returns E by a separate fit.
fn evidence_of(prior: &Prior, events: &Observations, messages: &[&Summary]) -> f64 {
    dgpc::fit(prior, events, &FitOptions::default().messages(messages)).unwrap().evidence()
}

/// Returns the standard deviation of every parameter, in the documented order of [`Prior::parameter_values`] and with
/// the documented values of [`HyperPrior`].
fn spread_of(prior: &Prior, spread: &HyperPrior) -> Vec<f64> {
    let of_term = |term: &Term| {
        let of_correlation = |correlation: &Correlation| {
            let mut own = vec![spread.length_scale; correlation.ties().iter().max().unwrap() + 1];
            own.extend(correlation.shape().parameters().iter().map(|_| spread.shape));
            own
        };
        let correlations = term.correlations().iter().flat_map(of_correlation);
        std::iter::once(spread.variance).chain(correlations).collect::<Vec<_>>()
    };
    let mut all: Vec<f64> = prior.kernel().terms().iter().flat_map(of_term).collect();
    all.extend([spread.intercept, spread.slope].iter().take(prior.mean().parameters().len()));
    all
}

/// Returns E plus the log density of the hyperprior, up to a constant.
fn objective(template: &Prior, at: &[f64], spread: &HyperPrior, events: &Observations, messages: &[&Summary]) -> f64 {
    let distance = at.iter().zip(template.parameter_values()).zip(spread_of(template, spread));
    let density: f64 = distance.map(|((at, centre), sd)| -0.5 * ((at - centre) / sd).powi(2)).sum();
    evidence_of(&template.with_parameters(at).unwrap(), events, messages) + density
}

fn variance(prior: &Prior) -> f64 {
    prior.kernel().terms()[0].variance()
}

fn length_scales(prior: &Prior) -> &[f64] {
    prior.kernel().terms()[0].correlations()[0].length_scales()
}

/// Asserts that every entry is its expected value times a factor between 1/(1 + share) and 1 + share.
#[track_caller]
fn assert_ratios(what: &str, found: &[f64], expected: &[f64], share: f64) {
    for (found, expected) in found.iter().zip(expected) {
        let factor = (found / expected).ln().abs().exp();
        assert!(factor < 1.0 + share, "{what}: {found}, expected {expected} times or over {}", 1.0 + share);
    }
}
