//! Random small problems, and comparisons.

use std::ops::RangeInclusive;

use crate::common::*;
use dgpc::*;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

pub(crate) fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: RngSeed::Fixed(20_240_229),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

/// A problem, and some points that are not its events.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    pub(crate) prior: Prior,
    pub(crate) observations: Observations,
    pub(crate) sites: Sites,
    pub(crate) elsewhere: Inputs,
}

impl Problem {
    pub(crate) fn inputs(&self) -> &Inputs {
        self.observations.inputs()
    }

    pub(crate) fn full(&self) -> Posterior {
        Posterior::fuse(&self.prior, &self.sites, &[]).unwrap()
    }

    pub(crate) fn gram(&self) -> Dense {
        rows(&self.prior.kernel().gram(self.inputs()).unwrap())
    }

    /// Returns up to `count` events that are far enough apart for a well-conditioned Gram matrix.
    pub(crate) fn spread(&self, count: usize) -> Vec<usize> {
        let mut left = Candidates::new(self.prior.kernel(), self.inputs()).unwrap();
        let mut chosen = Vec::new();
        for n in 0..self.inputs().len() {
            let before = left.trace();
            let mut with = left.clone();
            with.condition_on(&[n]);
            if chosen.len() < count && with.trace() < before - 0.05 * self.gram()[n][n] {
                chosen.push(n);
                left = with;
            }
        }
        chosen
    }
}

pub(crate) fn shapes() -> impl Strategy<Value = Shape> {
    let alphas = (0.3..5.0).prop_map(|alpha| Shape::RationalQuadratic { alpha });
    prop_oneof![
        Just(Shape::SquaredExponential),
        Just(Shape::Matern12),
        Just(Shape::Matern32),
        Just(Shape::Matern52),
        alphas
    ]
}

/// Returns the reflection that swaps the ends of a link of this dimension.
pub(crate) fn swap(dimension: usize) -> Reflection {
    match dimension {
        1 => Reflection::negate(&[0]),
        2 => Reflection::swap(&[(0, 1)]),
        3 => Reflection::negate(&[2]),
        _ => Reflection::swap(&[(0, 2), (1, 3)]),
    }
    .unwrap()
}

/// Returns the column that [`swap`] exchanges with `column`, if it is a different one.
fn partner(dimension: usize, column: usize) -> Option<usize> {
    match dimension {
        2 => Some(1 - column),
        4 => Some((column + 2) % 4),
        _ => None,
    }
}

pub(crate) fn swapped(inputs: &Inputs) -> Inputs {
    let images = inputs.rows().flat_map(|row| match *row {
        [a] => vec![-a],
        [a, b] => vec![b, a],
        [a, b, c] => vec![a, b, -c],
        [a, b, c, d] => vec![c, d, a, b],
        _ => unreachable!("problems have one to four columns"),
    });
    Inputs::new(images.collect(), inputs.dimension()).unwrap()
}

/// Generates kernels of one or two terms. The first term covers all columns, sometimes times a correlation over one of
/// them. The second term covers one column. The first term may be reciprocal.
pub(crate) fn kernels(dimension: usize) -> impl Strategy<Value = Kernel> {
    let whole = (shapes(), 0.5..4.0, 0.4..2.5, 0.4..2.5, any::<bool>());
    let part = || (shapes(), 0.5..2.0, 0.4..2.5, 0..dimension);
    let parts = (proptest::option::of(part()), proptest::option::of(part()));
    (whole, parts).prop_map(move |((shape, variance, first, second, reciprocal), (part, factor))| {
        // Columns that the reflection exchanges must share a length-scale.
        let tied = match dimension {
            1 => vec![first],
            2 if reciprocal => vec![first; 2],
            2 => vec![first, second],
            3 => vec![first, second, second],
            _ => vec![first, second, first, second],
        };
        let columns: Vec<usize> = (0..dimension).collect();
        let mut correlation = Correlation::new(shape, &columns, &tied).unwrap();
        // Equal length-scales may be one parameter or several.
        if dimension == 3 && shape == Shape::Matern32 {
            correlation = correlation.tied(&[7, 2, 2]).unwrap();
        }
        let mut term = Term::of(variance, correlation).unwrap();
        if let Some((shape, _, scale, column)) = factor {
            // The correlation includes a column and its partner, so that it can be reflected.
            let mut columns = vec![column];
            columns.extend(partner(dimension, column));
            term = term.times(Correlation::new(shape, &columns, &vec![scale; columns.len()]).unwrap()).unwrap();
        }
        // A term is reciprocal in whole or in part.
        let reciprocity = if variance > 1.0 { 1.0 } else { 0.6 };
        let mut terms =
            vec![if reciprocal { term.partly_reciprocal(swap(dimension), reciprocity).unwrap() } else { term }];
        terms.extend(
            part.map(|(shape, variance, scale, column)| Term::new(shape, variance, &[column], &[scale]).unwrap()),
        );
        Kernel::new(terms).unwrap()
    })
}

pub(crate) fn prior_means(dimension: usize) -> impl Strategy<Value = PriorMean> {
    let (from, to) = match dimension {
        1 => (vec![0], vec![0]),
        2 | 3 => (vec![0], vec![1]),
        _ => (vec![0, 1], vec![2, 3]),
    };
    prop_oneof![
        Just(PriorMean::Zero),
        (-2.0..2.0).prop_map(PriorMean::Constant),
        (0.0..3.0, 0.0..1.0)
            .prop_map(move |(intercept, slope)| { PriorMean::range(intercept, slope, &from, &to).unwrap() }),
    ]
}

pub(crate) fn priors(dimension: usize) -> impl Strategy<Value = Prior> {
    (kernels(dimension), prior_means(dimension)).prop_map(|(kernel, mean)| Prior::new(kernel, mean).unwrap())
}

pub(crate) fn points(count: usize, dimension: usize) -> impl Strategy<Value = Inputs> {
    vec(-2.5..2.5, count * dimension).prop_map(move |values| Inputs::new(values, dimension).unwrap())
}

/// Generates outcomes, weights and ω for some events.
pub(crate) fn outcomes(count: usize) -> impl Strategy<Value = (Vec<bool>, Vec<f64>, Vec<f64>)> {
    let weights = prop_oneof![3 => Just(1.0), 1 => 0.3..3.0];
    (vec(any::<bool>(), count), vec(weights, count), vec((-5.0..-1.4f64).prop_map(f64::exp), count))
}

pub(crate) fn problems(events: RangeInclusive<usize>) -> impl Strategy<Value = Problem> {
    (1..=4usize, events).prop_flat_map(|(dimension, count)| {
        (priors(dimension), points(count, dimension), outcomes(count), points(6, dimension)).prop_map(
            |(prior, inputs, (outcomes, weights, omega), elsewhere)| {
                let observations = Observations::weighted(inputs, outcomes, weights).unwrap();
                let sites = Sites::new(&observations, omega).unwrap();
                Problem { prior, observations, sites, elsewhere }
            },
        )
    })
}

/// Returns K − K_·Z K_ZZ⁻¹ K_Z· by elimination.
pub(crate) fn conditional(gram: &Dense, known: &[usize]) -> Dense {
    if known.is_empty() {
        return gram.clone();
    }
    let k_zn: Dense = known.iter().map(|&z| gram[z].clone()).collect();
    let k_zz: Dense = k_zn.iter().map(|row| known.iter().map(|&z| row[z]).collect()).collect();
    let explained = times(&transposed(&k_zn), &solve(&k_zz, &k_zn));
    subtract(gram, &explained)
}

pub(crate) fn subtract(a: &Dense, b: &Dense) -> Dense {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a - b).collect()).collect()
}

pub(crate) fn shuffled(count: usize, seed: u64) -> Vec<usize> {
    use rand::RngExt;
    let mut rng = seeded(seed);
    let mut order: Vec<usize> = (0..count).collect();
    (1..count).rev().for_each(|i| order.swap(i, rng.random_range(0..=i)));
    order
}

pub(crate) fn diagonal_matrix(values: impl Iterator<Item = f64>) -> Dense {
    let values: Vec<f64> = values.collect();
    (0..values.len()).map(|i| (0..values.len()).map(|j| if i == j { values[i] } else { 0.0 }).collect()).collect()
}

pub(crate) fn sum(a: &Dense, b: &Dense) -> Dense {
    a.iter().zip(b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| a + b).collect()).collect()
}

#[track_caller]
pub(crate) fn assert_same_latent(found: &Latent, expected: &Latent, tolerance: f64) {
    assert_near("mean", &found.mean, &expected.mean, tolerance);
    assert_near("variance", &found.variance, &expected.variance, tolerance);
}

#[track_caller]
pub(crate) fn assert_same_message(found: &Summary, expected: &Summary, tolerance: f64) {
    assert_near_matrix("precision", &rows(found.whitened_precision()), &rows(expected.whitened_precision()), tolerance);
    assert_near("shift", found.whitened_shift(), expected.whitened_shift(), tolerance);
}

pub(crate) fn line_prior(shape: Shape) -> Prior {
    let kernel = Kernel::new(vec![Term::isotropic(shape, 2.0, 1.0, 1).unwrap()]).unwrap();
    Prior::new(kernel, PriorMean::Constant(0.2)).unwrap()
}

pub(crate) fn line(points: &[f64]) -> Inputs {
    Inputs::new(points.to_vec(), 1).unwrap()
}

/// Returns the sites of twelve events on a line, with plausible ω.
pub(crate) fn line_sites() -> Sites {
    let inputs = line(&[-1.4, -1.1, -0.8, -0.5, -0.2, 0.0, 0.1, 0.35, 0.6, 0.9, 1.3, 1.7]);
    let outcomes = (0..12).map(|n| n % 3 != 1 && n < 9).collect();
    let observations = Observations::new(inputs, outcomes).unwrap();
    Sites::new(&observations, (0..12).map(|n| 0.25 - 0.01 * f64::from(n)).collect()).unwrap()
}
