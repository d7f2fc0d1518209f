//! The paper's experiment, implemented a second time from the formulas alone.
//!
//! This implementation uses a plain reader of the file, dense matrices, brute force over all pairs of points, and
//! quadrature. It shares two things with the experiment under test: the random number generators, and the learned
//! length-scale. A separate test checks the length-scale.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;
use std::sync::LazyLock;

use pingmap_trial::paper::{Choice, DataSet, Experiment, Fusion, Omega, Policy, SetOutcome};
use pingmap_trial::{EventLog, Score};
use rand::seq::SliceRandom;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};

/// A data set of the crate with three vehicles.
const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/bay3.csv");

const PERMUTATIONS: usize = 3;

const SEED: u64 = 7;

/// Radius of a region in length-scales, as in the paper.
const RADIUS_LENGTH_SCALES: f64 = 1.384;

/// Two points count as one if either keeps less than this share of its prior variance given the other.
const DISTINCT: f64 = 1e-4;

/// Largest allowed difference between the two implementations.
const TOLERANCE: f64 = 1e-9;

type Input = [f64; 4];

type Matrix = Vec<Vec<f64>>;

// Results of the experiment.

struct Tested {
    length_scale: f64,
    outcome: SetOutcome,
}

/// The experiment, run once for all tests.
static TESTED: LazyLock<Tested> = LazyLock::new(|| {
    let set = DataSet::new("bay3", EventLog::open(Path::new(FILE)).unwrap()).unwrap();
    let experiment = Experiment::new(vec![set], PERMUTATIONS, SEED).unwrap();
    let length_scale = experiment.length_scale();
    let outcome = experiment.at_radius(RADIUS_LENGTH_SCALES * length_scale, &|| ()).unwrap().sets.remove(0);
    Tested { length_scale, outcome }
});

// Events, regions and splits.

/// Some events of the file.
struct Events {
    /// Standardised.
    inputs: Vec<Input>,
    success: Vec<bool>,
    /// The events of every receiver, by name.
    by_receiver: BTreeMap<String, Vec<usize>>,
}

impl Events {
    /// Reads the events in `range`. The columns of the file have fixed positions.
    fn read(range: Range<usize>) -> Self {
        let text = std::fs::read_to_string(FILE).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().skip(1).map(|line| line.split(',').collect()).collect();
        let rows = &rows[range.start..range.end.min(rows.len())];
        let mut by_receiver: BTreeMap<String, Vec<usize>> = BTreeMap::new();
        for (n, row) in rows.iter().enumerate() {
            by_receiver.entry(row[2].to_owned()).or_default().push(n);
        }
        let raw = rows.iter().map(|row| [3, 4, 5, 6].map(|column| row[column].parse().unwrap())).collect();
        let success = rows.iter().map(|row| row[7] == "1").collect();
        Self { inputs: standardised(raw), success, by_receiver }
    }

    fn all() -> Self {
        Self::read(0..usize::MAX)
    }
}

/// Scales every column to mean 0 and population variance 1.
fn standardised(mut inputs: Vec<Input>) -> Vec<Input> {
    let count = inputs.len() as f64;
    for column in 0..4 {
        let mean = inputs.iter().map(|x| x[column]).sum::<f64>() / count;
        inputs.iter_mut().for_each(|x| x[column] -= mean);
        let variance = inputs.iter().map(|x| x[column] * x[column]).sum::<f64>() / count;
        inputs.iter_mut().for_each(|x| x[column] /= variance.sqrt());
    }
    inputs
}

fn distance(a: &Input, b: &Input) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Returns the events of `own` within the radius of the event with the most neighbours, the first of equals.
fn region(inputs: &[Input], own: &[usize], radius: f64) -> Vec<usize> {
    let around = |&centre: &usize| -> Vec<usize> {
        own.iter().copied().filter(|&n| distance(&inputs[n], &inputs[centre]) <= radius).collect()
    };
    let mut best = Vec::new();
    for candidate in own.iter().map(around) {
        if candidate.len() > best.len() {
            best = candidate;
        }
    }
    best
}

/// Returns which events a permutation holds out. Each permutation has one random stream, and the receivers draw from it
/// in turn.
fn held_out(events: &Events, permutation: usize) -> Vec<bool> {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    rng.set_stream(permutation as u64);
    let mut held_out = vec![false; events.inputs.len()];
    for own in events.by_receiver.values() {
        let mut order = own.clone();
        order.shuffle(&mut rng);
        let count = (0.35 * own.len() as f64).round() as usize;
        order[..count].iter().for_each(|&n| held_out[n] = true);
    }
    held_out
}

// Matrices.

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    let columns = b.first().map_or(0, Vec::len);
    let row = |row: &Vec<f64>| {
        let mut sums = vec![0.0; columns];
        for (factor, b) in row.iter().zip(b) {
            sums.iter_mut().zip(b).for_each(|(sum, b)| *sum += factor * b);
        }
        sums
    };
    a.iter().map(row).collect()
}

fn times(a: &Matrix, v: &[f64]) -> Vec<f64> {
    a.iter().map(|row| dot(row, v)).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn transposed(a: &Matrix) -> Matrix {
    (0..a[0].len()).map(|column| a.iter().map(|row| row[column]).collect()).collect()
}

/// Returns A⁻¹B and ln|det A| by Gauss-Jordan elimination with row pivots.
fn solve(mut a: Matrix, mut b: Matrix) -> (Matrix, f64) {
    let mut log_determinant = 0.0;
    for column in 0..a.len() {
        let pivot = (column..a.len()).max_by(|&i, &j| a[i][column].abs().total_cmp(&a[j][column].abs())).unwrap();
        a.swap(column, pivot);
        b.swap(column, pivot);
        let scale = a[column][column];
        log_determinant += scale.abs().ln();
        a[column].iter_mut().chain(&mut b[column]).for_each(|entry| *entry /= scale);
        let (pivot_a, pivot_b) = (a[column].clone(), b[column].clone());
        for row in (0..a.len()).filter(|&row| row != column) {
            let factor = a[row][column];
            a[row].iter_mut().zip(&pivot_a).for_each(|(entry, pivot)| *entry -= factor * pivot);
            b[row].iter_mut().zip(&pivot_b).for_each(|(entry, pivot)| *entry -= factor * pivot);
        }
    }
    (b, log_determinant)
}

fn identity(size: usize) -> Matrix {
    (0..size).map(|i| (0..size).map(|j| if i == j { 1.0 } else { 0.0 }).collect()).collect()
}

fn inverse(a: Matrix) -> Matrix {
    let size = a.len();
    solve(a, identity(size)).0
}

/// The squared-exponential kernel of unit variance.
fn kernel(a: &[Input], b: &[Input], length_scale: f64) -> Matrix {
    let value = |a: &Input, b: &Input| (-distance(a, b).powi(2) / (2.0 * length_scale.powi(2))).exp();
    a.iter().map(|a| b.iter().map(|b| value(a, b)).collect()).collect()
}

// The mean field.

/// The fixed point c² = E f² with its derived quantities.
struct MeanField {
    tilts: Vec<f64>,
    omega: Vec<f64>,
    kappa: Vec<f64>,
    /// Covariance of f at the events.
    covariance: Matrix,
    /// ln|I + ΩK|, which is ln|I + Ω^½KΩ^½|.
    log_determinant: f64,
}

impl MeanField {
    /// Iterates until only rounding errors change.
    fn new(gram: &Matrix, success: &[bool]) -> Self {
        let kappa: Vec<f64> = success.iter().map(|&success| if success { 0.5 } else { -0.5 }).collect();
        let mut tilts = vec![1.0; kappa.len()];
        for _ in 0..10_000 {
            let fit = Self::at(gram, &kappa, tilts);
            let mean = times(&fit.covariance, &kappa);
            let second_moment = |(n, mean): (usize, &f64)| (mean * mean + fit.covariance[n][n]).sqrt();
            let next: Vec<f64> = mean.iter().enumerate().map(second_moment).collect();
            let change = next.iter().zip(&fit.tilts).map(|(next, tilt)| (next - tilt).abs()).fold(0.0, f64::max);
            if change < 1e-13 {
                return fit;
            }
            tilts = next;
        }
        panic!("no fixed point");
    }

    /// (K⁻¹ + Ω)⁻¹ as (I + KΩ)⁻¹K, since events that nearly coincide leave K without an inverse.
    fn at(gram: &Matrix, kappa: &[f64], tilts: Vec<f64>) -> Self {
        let omega: Vec<f64> = tilts.iter().map(|c| (c / 2.0).tanh() / (2.0 * c)).collect();
        let mut system = gram.clone();
        for (i, row) in system.iter_mut().enumerate() {
            row.iter_mut().zip(&omega).for_each(|(entry, omega)| *entry *= omega);
            row[i] += 1.0;
        }
        let (covariance, log_determinant) = solve(system, gram.clone());
        Self { tilts, omega, kappa: kappa.to_vec(), covariance, log_determinant }
    }

    /// Returns the evidence bound E.
    fn evidence(&self) -> f64 {
        let tilted = |(c, omega): (&f64, &f64)| 0.5 * omega * c * c - (2.0 * (c / 2.0).cosh()).ln();
        let sum: f64 = self.tilts.iter().zip(&self.omega).map(tilted).sum();
        sum - 0.5 * self.log_determinant + 0.5 * dot(&self.kappa, &times(&self.covariance, &self.kappa))
    }
}

// Points, summaries and predictions.

/// Returns all sets of one or two of `count` events.
fn subsets(count: usize, points: usize) -> Vec<Vec<usize>> {
    match points {
        1 => (0..count).map(|i| vec![i]).collect(),
        2 => (0..count).flat_map(|j| (0..j).map(move |i| vec![i, j])).collect(),
        _ => panic!("one or two"),
    }
}

fn rows(matrix: &Matrix, indices: &[usize]) -> Matrix {
    indices.iter().map(|&n| matrix[n].clone()).collect()
}

/// tr(K_NN − K_NM K_MM⁻¹ K_MN).
fn unexplained(gram: &Matrix, points: &[usize]) -> f64 {
    let known = rows(gram, points);
    let weights = solve(rows(&transposed(&known), points), known.clone()).0;
    let explained: f64 = weights.iter().zip(&known).map(|(weights, known)| dot(weights, known)).sum();
    gram.len() as f64 - explained
}

fn is_distinct(gram: &Matrix, points: &[usize]) -> bool {
    points.len() < 2 || 1.0 - gram[points[0]][points[1]].powi(2) >= DISTINCT
}

/// Returns the choice with the smallest unexplained variance, or the largest.
fn chosen(gram: &Matrix, Choice { policy, points }: Choice) -> Vec<usize> {
    let candidates = subsets(gram.len(), points).into_iter().filter(|points| is_distinct(gram, points));
    let traces = candidates.map(|points| (unexplained(gram, &points), points));
    let best = match policy {
        Policy::Good => traces.min_by(|a, b| a.0.total_cmp(&b.0)),
        Policy::Bad => traces.max_by(|a, b| a.0.total_cmp(&b.0)),
        Policy::Random => panic!("nothing to compare with"),
    };
    best.unwrap().1
}

/// Mean and covariance of f at some points.
struct Summary {
    points: Vec<Input>,
    mean: Vec<f64>,
    covariance: Matrix,
}

impl Summary {
    /// Summarises the training events of a region at the chosen ones.
    fn new(part: &Part, choice: Choice) -> Self {
        let chosen = chosen(&part.gram, choice);
        let known = rows(&part.gram, &chosen);
        let gram = rows(&transposed(&known), &chosen);
        let weighted: Matrix = known
            .iter()
            .map(|row| row.iter().zip(&part.mean_field.omega).map(|(entry, omega)| entry * omega).collect())
            .collect();
        let mut total = product(&weighted, &transposed(&known));
        total.iter_mut().flatten().zip(gram.iter().flatten()).for_each(|(total, gram)| *total += gram);
        let half = product(&gram, &inverse(total));
        let mean = times(&product(&half, &known), &part.mean_field.kappa);
        Self { points: chosen.iter().map(|&n| part.training[n]).collect(), mean, covariance: product(&half, &gram) }
    }

    /// Stacks means and covariances, as if the summaries of different agents were independent.
    fn concatenated(summaries: &[Summary]) -> Self {
        let size = summaries.iter().map(|summary| summary.points.len()).sum();
        let mut covariance = vec![vec![0.0; size]; size];
        let mut first = 0;
        for summary in summaries {
            for (i, row) in summary.covariance.iter().enumerate() {
                covariance[first + i][first..first + row.len()].copy_from_slice(row);
            }
            first += summary.points.len();
        }
        let points = summaries.iter().flat_map(|summary| summary.points.clone()).collect();
        let mean = summaries.iter().flat_map(|summary| summary.mean.clone()).collect();
        Self { points, mean, covariance }
    }

    /// Scores the predictions of some events.
    fn score(&self, inputs: &[Input], success: &[bool], length_scale: f64) -> Score {
        let inverse = inverse(kernel(&self.points, &self.points, length_scale));
        let cross = kernel(inputs, &self.points, length_scale);
        let moments = cross.iter().map(|cross| {
            let weights = times(&inverse, cross);
            let variance = 1.0 - dot(&weights, cross) + dot(&weights, &times(&self.covariance, &weights));
            (dot(&weights, &self.mean), variance)
        });
        score_of(moments, success)
    }
}

/// A Gaussian factor on f at some points: exp(−½fᵀPf + hᵀf).
struct Factor {
    points: Vec<Input>,
    precision: Matrix,
    shift: Vec<f64>,
}

impl Factor {
    /// Returns the factor of some events: their sites.
    fn of_events(inputs: &[Input], fit: &MeanField) -> Self {
        let mut precision = identity(inputs.len());
        precision.iter_mut().zip(&fit.omega).for_each(|(row, omega)| row.iter_mut().for_each(|entry| *entry *= omega));
        Self { points: inputs.to_vec(), precision, shift: fit.kappa.clone() }
    }

    /// Returns the factor between the prior and a summary: the difference of the precisions.
    fn of_summary(summary: &Summary, length_scale: f64) -> Self {
        let mut precision = inverse(summary.covariance.clone());
        let shift = times(&precision, &summary.mean);
        let prior = inverse(kernel(&summary.points, &summary.points, length_scale));
        precision.iter_mut().flatten().zip(prior.iter().flatten()).for_each(|(entry, prior)| *entry -= prior);
        Self { points: summary.points.clone(), precision, shift }
    }

    /// Returns the product of several factors.
    fn joined(factors: Vec<Factor>) -> Self {
        let size = factors.iter().map(|factor| factor.points.len()).sum();
        let mut joined = Self { points: vec![], precision: vec![vec![0.0; size]; size], shift: vec![] };
        for factor in factors {
            let first = joined.points.len();
            for (i, row) in factor.precision.iter().enumerate() {
                joined.precision[first + i][first..first + row.len()].copy_from_slice(row);
            }
            joined.points.extend(factor.points);
            joined.shift.extend(factor.shift);
        }
        joined
    }

    /// Scores the predictions of prior times factor. f* has mean k*(I + PK)⁻¹h and variance k** − k*(I + PK)⁻¹Pk*ᵀ.
    fn score(&self, inputs: &[Input], success: &[bool], length_scale: f64) -> Score {
        let mut system = product(&self.precision, &kernel(&self.points, &self.points, length_scale));
        system.iter_mut().enumerate().for_each(|(i, row)| row[i] += 1.0);
        let inverse = inverse(system);
        let (weights, explained) = (times(&inverse, &self.shift), product(&inverse, &self.precision));
        let cross = kernel(inputs, &self.points, length_scale);
        let moments = cross.iter().map(|cross| (dot(cross, &weights), 1.0 - dot(cross, &times(&explained, cross))));
        score_of(moments, success)
    }
}

/// Returns the accuracy, NLL and Brier score of some events from the mean and variance of f at each.
fn score_of(moments: impl Iterator<Item = (f64, f64)>, success: &[bool]) -> Score {
    let (mut right, mut nll, mut brier) = (0.0, 0.0, 0.0);
    for ((mean, variance), &success) in moments.zip(success) {
        let p = success_probability(mean, variance);
        right += if (p > 0.5) == success { 1.0 } else { 0.0 };
        nll -= if success { p.ln() } else { (1.0 - p).ln() };
        brier += if success { (1.0 - p) * (1.0 - p) } else { p * p };
    }
    let count = success.len() as f64;
    Score { accuracy: right / count, nll: nll / count, brier: brier / count, regret: None }
}

/// Returns ∫ σ(f) N(f; mean, variance) df by the trapezoidal rule over twelve standard deviations to each side. The
/// integrand is smooth and vanishes at both ends, so the error falls faster than any power of the step.
fn success_probability(mean: f64, variance: f64) -> f64 {
    let step = 0.006;
    let node = |n: i32| {
        let z = step * f64::from(n);
        (-0.5 * z * z).exp() / (1.0 + (-mean - variance.sqrt() * z).exp())
    };
    step / std::f64::consts::TAU.sqrt() * (-2000..=2000).map(node).sum::<f64>()
}

// The experiment.

/// The training and held-out events of one agent in one permutation.
struct Part {
    training: Vec<Input>,
    gram: Matrix,
    mean_field: MeanField,
    inputs: Vec<Input>,
    success: Vec<bool>,
}

impl Part {
    fn new(events: &Events, region: &[usize], held_out: &[bool], length_scale: f64) -> Self {
        let (test, training): (Vec<usize>, Vec<usize>) = region.iter().partition(|&&n| held_out[n]);
        let inputs = |indices: &[usize]| -> Vec<Input> { indices.iter().map(|&n| events.inputs[n]).collect() };
        let success = |indices: &[usize]| -> Vec<bool> { indices.iter().map(|&n| events.success[n]).collect() };
        let gram = kernel(&inputs(&training), &inputs(&training), length_scale);
        let mean_field = MeanField::new(&gram, &success(&training));
        Self { training: inputs(&training), gram, mean_field, inputs: inputs(&test), success: success(&test) }
    }

    fn score(&self, choice: Choice) -> Score {
        Summary::new(self, choice).score(&self.inputs, &self.success, TESTED.length_scale)
    }
}

/// The part of every agent in every permutation, computed once for all tests.
static PERMUTED: LazyLock<Vec<Vec<Part>>> = LazyLock::new(|| {
    let (events, length_scale) = (Events::all(), TESTED.length_scale);
    let own = events.by_receiver.values();
    let radius = RADIUS_LENGTH_SCALES * length_scale;
    let regions: Vec<Vec<usize>> = own.map(|own| region(&events.inputs, own, radius)).collect();
    let parts = |permutation| {
        let held_out = held_out(&events, permutation);
        regions.iter().map(|region| Part::new(&events, region, &held_out, length_scale)).collect()
    };
    (0..PERMUTATIONS).map(parts).collect()
});

/// Compares a cell of a table for each permutation, not only on average.
fn assert_cell(what: &str, tested: &[Score], expected: &[Score]) {
    assert_eq!(tested.len(), expected.len(), "{what}");
    for (tested, expected) in tested.iter().zip(expected) {
        let same = |a: f64, b: f64| (a - b).abs() < TOLERANCE;
        let agree = same(tested.accuracy, expected.accuracy) && same(tested.nll, expected.nll);
        assert!(agree, "{what}: {tested:?} instead of {expected:?}");
    }
}

fn assert_local(choice: Choice) {
    for agent in 0..PERMUTED[0].len() {
        let tested = TESTED.outcome.local(agent);
        let tested: Vec<Score> = tested.iter().map(|local| local.scores[&(choice, Omega::MeanField)]).collect();
        let expected: Vec<Score> = PERMUTED.iter().map(|parts| parts[agent].score(choice)).collect();
        assert_cell(&format!("agent {agent}, {choice:?}"), &tested, &expected);
    }
}

#[test]
fn regions_contain_the_most_events() {
    let events = Events::all();
    assert_eq!(TESTED.outcome.regions.len(), events.by_receiver.len());
    for (tested, own) in TESTED.outcome.regions.iter().zip(events.by_receiver.values()) {
        assert_eq!(tested.members, region(&events.inputs, own, RADIUS_LENGTH_SCALES * TESTED.length_scale));
    }
}

#[test]
fn scores_of_agents_match_the_formulas() {
    for policy in [Policy::Good, Policy::Bad] {
        for points in [1, 2] {
            assert_local(Choice { policy, points });
        }
    }
}

#[test]
fn scores_of_the_team_match_the_formulas() {
    for policy in [Policy::Good, Policy::Bad] {
        let choice = Choice { policy, points: 2 };
        let cell = (choice, Fusion::Concatenation, Omega::MeanField);
        let tested: Vec<Score> = TESTED.outcome.team().iter().map(|team| team.scores[&cell]).collect();
        let score = |parts: &Vec<Part>| {
            let summaries: Vec<Summary> = parts.iter().map(|part| Summary::new(part, choice)).collect();
            let (inputs, success) = all_held_out(parts);
            Summary::concatenated(&summaries).score(&inputs, &success, TESTED.length_scale)
        };
        let expected: Vec<Score> = PERMUTED.iter().map(score).collect();
        assert_cell(&format!("team, {choice:?}"), &tested, &expected);
    }
}

/// Returns the held-out events of all regions.
fn all_held_out(parts: &[Part]) -> (Vec<Input>, Vec<bool>) {
    let inputs = parts.iter().flat_map(|part| part.inputs.clone()).collect();
    (inputs, parts.iter().flat_map(|part| part.success.clone()).collect())
}

/// Site fusion combines the packets of all agents. The other fusion combines an agent's own events with the packets of
/// the others.
#[test]
fn fusion_counts_the_prior_once() {
    let choice = Choice { policy: Policy::Good, points: 2 };
    let length_scale = TESTED.length_scale;
    let packet = |part: &Part| Factor::of_summary(&Summary::new(part, choice), length_scale);
    let fused = |parts: &Vec<Part>| {
        let (inputs, success) = all_held_out(parts);
        Factor::joined(parts.iter().map(packet).collect()).score(&inputs, &success, length_scale)
    };
    let with_own = |parts: &Vec<Part>| {
        let (inputs, success) = all_held_out(parts);
        let of_agent = |agent: usize| {
            let factor = |(other, part): (usize, &Part)| match other == agent {
                true => Factor::of_events(&part.training, &part.mean_field),
                false => packet(part),
            };
            Factor::joined(parts.iter().enumerate().map(factor).collect()).score(&inputs, &success, length_scale)
        };
        let scores: Vec<Score> = (0..parts.len()).map(of_agent).collect();
        Score::mean(&scores).unwrap()
    };
    let tested = |fusion: Fusion| -> Vec<Score> {
        TESTED.outcome.team().iter().map(|team| team.scores[&(choice, fusion, Omega::MeanField)]).collect()
    };
    let expected: Vec<Score> = PERMUTED.iter().map(fused).collect();
    assert_cell("site fusion", &tested(Fusion::SiteFusion), &expected);
    let expected: Vec<Score> = PERMUTED.iter().map(with_own).collect();
    assert_cell("own events and packets", &tested(Fusion::OwnAndPackets), &expected);
}

/// The joint fit uses all training events of all regions.
#[test]
fn the_centralised_score_is_that_of_one_joint_fit() {
    let length_scale = TESTED.length_scale;
    let score = |(permutation, parts): (usize, &Vec<Part>)| {
        let training: Vec<Input> = parts.iter().flat_map(|part| part.training.clone()).collect();
        let kappa = parts.iter().flat_map(|part| part.mean_field.kappa.clone());
        let success: Vec<bool> = kappa.map(|kappa| kappa > 0.0).collect();
        let fit = MeanField::new(&kernel(&training, &training, length_scale), &success);
        let (inputs, asked) = all_held_out(parts);
        let expected = Factor::of_events(&training, &fit).score(&inputs, &asked, length_scale);
        let tested = TESTED.outcome.team()[permutation].centralised[&Omega::MeanField];
        assert_cell("centralised", &[tested], &[expected]);
    };
    PERMUTED.iter().enumerate().for_each(score);
}

/// Averages over 100 draws of a Markov chain are another way to compute ω.
#[test]
fn averaged_draws_give_nearly_the_nll_of_the_mean_field() {
    for agent in 0..PERMUTED[0].len() {
        for local in TESTED.outcome.local(agent) {
            for choice in Choice::all() {
                let nll = |omega| local.scores[&(choice, omega)].nll;
                let difference = nll(Omega::AveragedDraws) - nll(Omega::MeanField);
                assert!(difference.abs() < 0.03, "agent {agent}, {choice:?}: {difference}");
            }
        }
    }
}

#[test]
fn the_learned_length_scale_maximises_the_evidence() {
    let ranges = [0..60, 100..160];
    let log = EventLog::open(Path::new(FILE)).unwrap();
    let set = |range: &Range<usize>| DataSet::new("part", log.select(&range.clone().collect::<Vec<_>>())).unwrap();
    let learned = Experiment::new(ranges.iter().map(set).collect(), 1, SEED).unwrap().length_scale();

    let events = ranges.map(Events::read);
    let evidence_of = |events: &Events, length_scale| {
        MeanField::new(&kernel(&events.inputs, &events.inputs, length_scale), &events.success).evidence()
    };
    let evidence = |length_scale: f64| events.iter().map(|events| evidence_of(events, length_scale)).sum::<f64>();
    let most = evidence(learned);
    for factor in [0.25, 0.5, 1.0 / 1.02, 1.02, 2.0, 4.0] {
        let other = evidence(factor * learned);
        assert!(other <= most, "{other} at {factor} times {learned}, {most} there");
    }
}
