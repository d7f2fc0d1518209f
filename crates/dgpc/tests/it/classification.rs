//! Classic data sets, compared with the scores of two reference methods on the same splits.
//!
//! The reference methods are scikit-learn's Laplace approximation with learned hyperparameters, and Gibbs sampling
//! under the same hyperparameters. All sets use one recipe: a squared-exponential kernel with one length-scale and a
//! constant prior mean, learned with the default options, which calibrate. The predictions come from mean field or
//! Gibbs sampling.
//!
//! Ringnorm needs the constant mean. Far from its centre all events are of one class, which a zero mean cannot
//! represent: its NLL is .19 instead of .13.
//!
//! The tests look for the data in the folder that `PINGMAP_SHARED` names.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use crate::common::seeded;
use dgpc::*;
use rand::RngExt;

const SPLITS: u64 = 5;

/// Number of training events in a set without predefined splits.
const TRAINING_EVENTS: usize = 400;

/// Upper limit of a score.
struct Limit {
    /// The better score of the two reference methods.
    reference: f64,
    /// Standard error of our score over the splits, as measured once. A standard error computed in every run would grow
    /// with the very failures that these tests must detect.
    standard_error: f64,
}

struct DataSet {
    name: &'static str,
    /// Share of test events with a wrong prediction.
    error: Limit,
    /// Mean negative log-likelihood of the test events, in nats.
    nll: Limit,
}

const BANANA: DataSet = DataSet {
    name: "banana",
    error: Limit { reference: 0.106, standard_error: 0.001 },
    nll: Limit { reference: 0.243, standard_error: 0.002 },
};

const PIMA: DataSet = DataSet {
    name: "pima",
    error: Limit { reference: 0.235, standard_error: 0.008 },
    nll: Limit { reference: 0.495, standard_error: 0.012 },
};

const GERMAN_CREDIT: DataSet = DataSet {
    name: "statlog-german-credit",
    error: Limit { reference: 0.239, standard_error: 0.007 },
    nll: Limit { reference: 0.506, standard_error: 0.009 },
};

const RINGNORM: DataSet = DataSet {
    name: "ringnorm",
    error: Limit { reference: 0.050, standard_error: 0.001 },
    nll: Limit { reference: 0.169, standard_error: 0.002 },
};

const HEART: DataSet = DataSet {
    name: "statlog-heart",
    error: Limit { reference: 0.162, standard_error: 0.010 },
    nll: Limit { reference: 0.401, standard_error: 0.028 },
};

/// Length of a Gibbs chain.
struct Chain {
    burn_in: usize,
    draws: usize,
    sweeps_per_draw: usize,
}

/// For many test events a prediction costs as much as dozens of sweeps, so few draws far apart are most efficient.
const SHORT: Chain = Chain { burn_in: 50, draws: 20, sweeps_per_draw: 5 };
const LONG: Chain = Chain { burn_in: 100, draws: 200, sweeps_per_draw: 5 };

#[test]
fn banana_is_predicted_as_well_as_by_references() {
    assert_as_good_as_references(&BANANA, &SHORT);
}

#[test]
fn pima_is_predicted_as_well_as_by_references() {
    assert_as_good_as_references(&PIMA, &SHORT);
}

#[test]
fn german_credit_is_predicted_as_well_as_by_references() {
    assert_as_good_as_references(&GERMAN_CREDIT, &SHORT);
}

#[test]
fn ringnorm_is_predicted_as_well_as_by_references() {
    assert_as_good_as_references(&RINGNORM, &SHORT);
}

#[test]
fn heart_is_predicted_as_well_as_by_references() {
    assert_as_good_as_references(&HEART, &SHORT);
}

#[test]
#[ignore = "takes minutes: the other tests with chains ten times as long"]
fn long_chains_predict_every_set_as_well_as_references() {
    for set in [BANANA, PIMA, GERMAN_CREDIT, RINGNORM, HEART] {
        assert_as_good_as_references(&set, &LONG);
    }
}

/// Learns on every split and predicts by mean field and by Gibbs sampling. Asserts that the mean scores are within the
/// limits.
fn assert_as_good_as_references(set: &DataSet, chain: &Chain) {
    let Some(folder) = data_folder() else { return };
    let (mut mean_field, mut gibbs) = (Vec::new(), Vec::new());
    for number in 0..SPLITS {
        let split = Split::read(&folder, set.name, number);
        let learned = learned(&split.train);
        mean_field.push(split.score(&mean_field_probability(&learned, &split.test)));
        gibbs.push(split.score(&gibbs_probability(&learned.prior, &split, chain, number)));
    }
    assert_below(set, "mean field", &mean_field);
    assert_below(set, "Gibbs", &gibbs);
}

fn assert_below(set: &DataSet, method: &str, scores: &[Score]) {
    let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    for (what, mean, limit_of) in [("error", mean(|s| s.error), &set.error), ("NLL", mean(|s| s.nll), &set.nll)] {
        let limit = limit_of.reference + limit_of.standard_error;
        eprintln!("{} {method}: {what} {mean:.4}, reference {:.3}, at most {limit:.3}", set.name, limit_of.reference);
        assert!(mean <= limit, "{} {method}: {what} {mean:.4} is above {limit:.3}", set.name);
    }
}

/// Learns a prior from the library's defaults for inputs of unit standard deviation in every column.
fn learned(train: &Observations) -> Learned {
    let dimension = train.inputs().dimension();
    let distance = (dimension as f64).sqrt();
    let term = Term::isotropic(Shape::SquaredExponential, 4.0, distance, dimension).unwrap();
    let template = Prior::new(Kernel::new(vec![term]).unwrap(), PriorMean::Constant(0.0)).unwrap();
    learn(&template, train, &LearnOptions::default()).unwrap()
}

fn mean_field_probability(learned: &Learned, test: &Observations) -> Vec<f64> {
    let posterior = Posterior::fuse(&learned.prior, learned.fit.sites(), &[]).unwrap();
    posterior.probability(test.inputs()).unwrap()
}

/// Returns the mean over draws of ω of the probability given ω.
fn gibbs_probability(prior: &Prior, split: &Split, length: &Chain, seed: u64) -> Vec<f64> {
    let mut rng = seeded(seed);
    let mut chain = Gibbs::new(prior, split.train.clone()).unwrap();
    for _ in 0..length.burn_in {
        chain.sweep(&mut rng).unwrap();
    }
    let mut sum = vec![0.0; split.test.len()];
    for _ in 0..length.draws {
        for _ in 0..length.sweeps_per_draw {
            chain.sweep(&mut rng).unwrap();
        }
        let posterior = Posterior::fuse(prior, &chain.sites().unwrap(), &[]).unwrap();
        let probability = posterior.probability(split.test.inputs()).unwrap();
        sum.iter_mut().zip(probability).for_each(|(sum, probability)| *sum += probability);
    }
    sum.iter().map(|sum| sum / length.draws as f64).collect()
}

struct Score {
    error: f64,
    nll: f64,
}

/// Training and test events. Every column has mean 0 and standard deviation 1 over the training events.
struct Split {
    train: Observations,
    test: Observations,
}

impl Split {
    fn read(folder: &Path, name: &str, number: u64) -> Self {
        let events = read_events(&folder.join(format!("{name}.csv")));
        let indices = |part: &str| read_indices(&folder.join(format!("splits/{name}_s{number}_{part}_idx.csv")));
        let (train, test) = if name == BANANA.name {
            drawn(events.len(), TRAINING_EVENTS, number)
        } else {
            (indices("train"), indices("test"))
        };
        assert!(train.iter().all(|n| !test.contains(n)), "an event of {name} is in both parts of split {number}");
        let (train, test) = (events.select(&train), events.select(&test));
        Self { train: standardised(&train, train.inputs()), test: standardised(&test, train.inputs()) }
    }

    fn score(&self, probability: &[f64]) -> Score {
        // The probability of the actual class, bounded away from 0 to keep its logarithm finite.
        let right: Vec<f64> = probability
            .iter()
            .zip(self.test.outcomes())
            .map(|(&p, &class)| if class { p } else { 1.0 - p }.max(1e-12))
            .collect();
        let mean = |of: fn(f64) -> f64| right.iter().map(|&p| of(p)).sum::<f64>() / right.len() as f64;
        Score { error: mean(|p| f64::from(p < 0.5)), nll: mean(|p| -p.ln()) }
    }
}

/// Returns `data/classification` in the shared folder. Without a shared folder, prints a message and returns `None`.
fn data_folder() -> Option<PathBuf> {
    let Some(root) = std::env::var_os("PINGMAP_SHARED") else {
        // Write to stderr directly, because the test harness hides the output of the macros.
        let message = b"skipped: PINGMAP_SHARED is not set, so there is no data/classification\n";
        std::io::stderr().write_all(message).unwrap();
        return None;
    };
    let folder = Path::new(&root).join("data/classification");
    assert!(folder.exists(), "PINGMAP_SHARED is set, but {} does not exist", folder.display());
    Some(folder)
}

/// Reads lines of numbers separated by commas, with the class 0 or 1 last. A line that begins with a letter is a
/// header.
fn read_events(path: &Path) -> Observations {
    let text = std::fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with(char::is_alphabetic));
    let (mut values, mut classes, mut dimension) = (Vec::new(), Vec::new(), 0);
    for line in lines {
        let row: Vec<f64> = line.split(',').map(|number| number.trim().parse().unwrap()).collect();
        let (class, columns) = row.split_last().unwrap();
        values.extend_from_slice(columns);
        classes.push(*class == 1.0);
        dimension = columns.len();
    }
    Observations::new(Inputs::new(values, dimension).unwrap(), classes).unwrap()
}

fn read_indices(path: &Path) -> Vec<usize> {
    let text = std::fs::read_to_string(path).unwrap();
    text.split_whitespace().map(|index| index.parse().unwrap()).collect()
}

/// Draws `chosen` of the indices below `count` at random. Returns them, and the remaining indices.
fn drawn(count: usize, chosen: usize, seed: u64) -> (Vec<usize>, Vec<usize>) {
    let mut rng = seeded(seed);
    let mut order: Vec<usize> = (0..count).collect();
    for place in 0..chosen {
        order.swap(place, rng.random_range(place..count));
    }
    let others = order.split_off(chosen);
    (order, others)
}

/// Standardises every column with its mean and standard deviation over `reference`.
fn standardised(events: &Observations, reference: &Inputs) -> Observations {
    let mean_over = |of: &dyn Fn(&[f64]) -> f64| reference.rows().map(of).sum::<f64>() / reference.len() as f64;
    let moments = |column: usize| {
        let mean = mean_over(&|row| row[column]);
        (mean, mean_over(&|row| (row[column] - mean).powi(2)).sqrt())
    };
    let moments: Vec<(f64, f64)> = (0..reference.dimension()).map(moments).collect();
    let scaled = |row: &[f64]| row.iter().zip(&moments).map(|(x, (mean, sd))| (x - mean) / sd).collect::<Vec<_>>();
    let values = events.inputs().rows().flat_map(scaled).collect();
    let inputs = Inputs::new(values, reference.dimension()).unwrap();
    Observations::new(inputs, events.outcomes().to_vec()).unwrap()
}
