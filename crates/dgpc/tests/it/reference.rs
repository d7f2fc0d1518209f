//! Every number of the reference vectors, which were computed by dense formulas, against this crate. The variable
//! `DGPC_REFERENCE` can name another file of the same format.

use dgpc::*;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Bound on the relative error of closed forms.
const CLOSED_FORM: f64 = 1e-9;
/// Bound on the relative error of mean-field fixed points.
const MEAN_FIELD: f64 = 1e-7;
/// Bound on the absolute error of probabilities.
const PROBABILITY: f64 = 1e-8;

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct Reference {
    kernel: KernelParameters,
    prior_mean: RangeParameters,
    X: Vec<Vec<f64>>,
    y: Vec<f64>,
    omega: Vec<f64>,
    agent: Vec<usize>,
    posterior_given_omega: Gaussian,
    sparse: Sparse,
    bounds: Bounds,
    selection_all_events: BTreeMap<usize, Chosen>,
    team: Team,
    probability: Vec<ProbabilityCase>,
    mean_field: MeanFieldCase,
    polya_gamma_moments: Vec<Moments>,
    kernels: Kernels,
}

#[derive(Deserialize)]
struct KernelParameters {
    ell: f64,
    variance: f64,
}

#[derive(Deserialize)]
struct RangeParameters {
    a: f64,
    b: f64,
}

#[derive(Deserialize)]
struct Gaussian {
    mean: Vec<f64>,
    variance: Vec<f64>,
    probability: Option<Vec<f64>>,
}

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct Sparse {
    inducing_indices: Vec<usize>,
    G: Vec<Vec<f64>>,
    b: Vec<f64>,
    mu: Vec<f64>,
    Sigma: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct Bounds {
    log_evidence: f64,
    L_lower: f64,
    L_upper: f64,
    KL: f64,
    gap: f64,
    closed_form: f64,
    paper: f64,
    trace: f64,
}

#[derive(Deserialize)]
struct Chosen {
    good: Vec<usize>,
    good_trace: f64,
    bad: Vec<usize>,
    bad_trace: f64,
}

#[derive(Deserialize)]
struct Team {
    packets: Vec<Packet>,
    test_inputs: Vec<Vec<f64>>,
    concatenation: Gaussian,
    site_fusion: Gaussian,
    agent0_own_events_plus_packet_of_agent1: Gaussian,
}

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct Packet {
    agent: usize,
    inducing_indices: Vec<usize>,
    mu: Vec<f64>,
    Sigma: Vec<Vec<f64>>,
    G: Vec<Vec<f64>>,
    b: Vec<f64>,
}

#[derive(Deserialize)]
struct ProbabilityCase {
    mean: f64,
    variance: f64,
    p: f64,
}

#[derive(Deserialize)]
struct MeanFieldCase {
    omega: Vec<f64>,
    mean: Vec<f64>,
    variance: Vec<f64>,
    elbo: f64,
}

#[derive(Deserialize)]
struct Moments {
    b: f64,
    c: f64,
    mean: f64,
    variance: f64,
}

#[derive(Deserialize)]
struct Kernels {
    se: Vec<Vec<f64>>,
    se_reciprocal: Vec<Vec<f64>>,
    matern32: Vec<Vec<f64>>,
    matern52: Vec<Vec<f64>>,
}

/// The reference problem in this crate's types.
struct Problem {
    reference: Reference,
    prior: Prior,
    inputs: Inputs,
    observations: Observations,
    sites: Sites,
}

fn inputs(rows: &[Vec<f64>]) -> Inputs {
    Inputs::new(rows.concat(), rows[0].len()).unwrap()
}

impl Problem {
    fn load() -> Self {
        let text = match std::env::var("DGPC_REFERENCE") {
            Ok(path) => std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{path}: {error}")),
            Err(_) => include_str!("../data/vectors.json").to_owned(),
        };
        let reference: Reference = serde_json::from_str(&text).expect("reference vectors in the expected format");
        let inputs = inputs(&reference.X);
        let kernel = Kernel::new(vec![term(&reference, Shape::SquaredExponential)]).unwrap();
        let RangeParameters { a, b } = reference.prior_mean;
        let mean = PriorMean::range(a, b, &[0, 1], &[2, 3]).unwrap();
        let outcomes = reference.y.iter().map(|&y| y == 1.0).collect();
        let observations = Observations::new(inputs.clone(), outcomes).unwrap();
        let sites = Sites::new(&observations, reference.omega.clone()).unwrap();
        Self { prior: Prior::new(kernel, mean).unwrap(), inputs, observations, sites, reference }
    }

    /// Returns the sites of one agent's events.
    fn events_of(&self, agent: usize) -> Sites {
        let own: Vec<usize> = (0..self.inputs.len()).filter(|&n| self.reference.agent[n] == agent).collect();
        self.sites.select(&own)
    }

    /// Returns the packets: the variational summaries of each agent's own events at its chosen points.
    fn packets(&self) -> Vec<Summary> {
        let summarise = |packet: &Packet| {
            let points = self.inputs.select(&packet.inducing_indices);
            Summary::variational(&self.prior, &self.events_of(packet.agent), &points).unwrap()
        };
        self.reference.team.packets.iter().map(summarise).collect()
    }

    fn test_inputs(&self) -> Inputs {
        inputs(&self.reference.team.test_inputs)
    }

    fn assert_predicts(&self, posterior: &Posterior, expected: &Gaussian) {
        assert_eq!(posterior.jitter(), 0.0);
        self.assert_latent(&posterior.latent(&self.test_inputs()).unwrap(), expected);
    }

    fn assert_latent(&self, latent: &Latent, expected: &Gaussian) {
        assert_close("mean", &latent.mean, &expected.mean, CLOSED_FORM);
        assert_close("variance", &latent.variance, &expected.variance, CLOSED_FORM);
        for (p, expected) in latent.probability().iter().zip(expected.probability.as_ref().unwrap()) {
            assert!((p - expected).abs() <= PROBABILITY, "probability {p}, expected {expected}");
        }
    }
}

fn term(reference: &Reference, shape: Shape) -> Term {
    let KernelParameters { ell, variance } = reference.kernel;
    Term::isotropic(shape, variance, ell, reference.X[0].len()).unwrap()
}

fn assert_close(what: &str, found: &[f64], expected: &[f64], relative: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs() / expected.abs();
        assert!(error <= relative, "{what}[{i}]: {found}, expected {expected}, relative error {error:e}");
    }
}

fn assert_matrix(what: &str, found: &Matrix, expected: &[Vec<f64>]) {
    assert_eq!(found.rows(), expected.len(), "{what}");
    for (i, row) in expected.iter().enumerate() {
        let found: Vec<f64> = (0..found.columns()).map(|j| found[(i, j)]).collect();
        assert_close(what, &found, row, CLOSED_FORM);
    }
}

#[test]
fn kernels() {
    let problem = Problem::load();
    let (first, second) = (problem.inputs.slice(0..3), problem.inputs.slice(3..6));
    let gram = |term| Kernel::new(vec![term]).unwrap().cross(&first, &second).unwrap();
    let term = |shape| term(&problem.reference, shape);
    let expected = &problem.reference.kernels;
    assert_matrix("se", &gram(term(Shape::SquaredExponential)), &expected.se);
    assert_matrix("matern32", &gram(term(Shape::Matern32)), &expected.matern32);
    assert_matrix("matern52", &gram(term(Shape::Matern52)), &expected.matern52);
    let swap = Reflection::swap(&[(0, 2), (1, 3)]).unwrap();
    let reciprocal = term(Shape::SquaredExponential).reciprocal(swap).unwrap();
    assert_matrix("se_reciprocal", &gram(reciprocal), &expected.se_reciprocal);
}

#[test]
fn polya_gamma_moments() {
    for case in Problem::load().reference.polya_gamma_moments {
        assert_close("mean", &[polya_gamma::mean(case.b, case.c)], &[case.mean], CLOSED_FORM);
        assert_close("variance", &[polya_gamma::variance(case.b, case.c)], &[case.variance], CLOSED_FORM);
    }
}

#[test]
fn probabilities() {
    for ProbabilityCase { mean, variance, p } in Problem::load().reference.probability {
        let found = success_probability(mean, variance);
        assert!((found - p).abs() <= PROBABILITY, "mean {mean}, variance {variance}: {found}, expected {p}");
    }
}

#[test]
fn posterior_given_omega() {
    let problem = Problem::load();
    let posterior = Posterior::fuse(&problem.prior, &problem.sites, &[]).unwrap();
    let latent = posterior.latent(&problem.inputs).unwrap();
    assert_close("mean", &latent.mean, &problem.reference.posterior_given_omega.mean, CLOSED_FORM);
    assert_close("variance", &latent.variance, &problem.reference.posterior_given_omega.variance, CLOSED_FORM);
}

#[test]
fn sparse_posterior() {
    let problem = Problem::load();
    let expected = &problem.reference.sparse;
    let points = problem.inputs.select(&expected.inducing_indices);
    let summary = Summary::variational(&problem.prior, &problem.sites, &points).unwrap();
    assert_eq!(summary.jitter(), 0.0);
    assert_matrix("G", &summary.precision(), &expected.G);
    assert_close("b", &summary.shift(), &expected.b, CLOSED_FORM);
    let (mean, covariance) = summary.moments().unwrap();
    assert_close("mu", &mean, &expected.mu, CLOSED_FORM);
    assert_matrix("Sigma", &covariance, &expected.Sigma);
}

#[test]
fn bounds() {
    let problem = Problem::load();
    let expected = &problem.reference.bounds;
    let points = problem.inputs.select(&problem.reference.sparse.inducing_indices);
    let certificate = Certificate::new(&problem.prior, &problem.sites, &points).unwrap();
    let log_evidence = log_evidence(&problem.prior, &problem.sites).unwrap();
    assert_eq!(certificate.jitter, 0.0);
    for (what, found, expected) in [
        ("log_evidence", log_evidence, expected.log_evidence),
        ("L_lower", certificate.lower, expected.L_lower),
        ("L_upper", certificate.upper, expected.L_upper),
        ("KL", log_evidence - certificate.lower, expected.KL),
        ("gap", certificate.gap, expected.gap),
        ("closed_form", certificate.closed_form, expected.closed_form),
        ("paper", certificate.paper_closed_form, expected.paper),
        ("trace", certificate.trace, expected.trace),
    ] {
        assert_close(what, &[found], &[expected], CLOSED_FORM);
    }
}

#[test]
fn selection() {
    let problem = Problem::load();
    let candidates = Candidates::new(problem.prior.kernel(), &problem.inputs).unwrap();
    for (&points, expected) in &problem.reference.selection_all_events {
        let sorted = |mut selection: Selection| {
            selection.indices.sort_unstable();
            selection
        };
        let (good, bad) = (sorted(candidates.minimise_trace(points)), sorted(candidates.maximise_trace(points)));
        if points <= 2 {
            assert_eq!((&good.indices, &bad.indices), (&expected.good, &expected.bad), "{points} points");
            assert_close("good trace", &[good.trace], &[expected.good_trace], CLOSED_FORM);
            assert_close("bad trace", &[bad.trace], &[expected.bad_trace], CLOSED_FORM);
        } else {
            assert!(good.trace <= 1.01 * expected.good_trace, "{} against {}", good.trace, expected.good_trace);
            assert!(bad.trace >= expected.bad_trace / 1.01, "{} against {}", bad.trace, expected.bad_trace);
        }
    }
}

#[test]
fn packets() {
    let problem = Problem::load();
    for (packet, expected) in problem.packets().iter().zip(&problem.reference.team.packets) {
        let own: Vec<usize> =
            (0..problem.inputs.len()).filter(|&n| problem.reference.agent[n] == expected.agent).collect();
        let candidates = Candidates::new(problem.prior.kernel(), &problem.inputs.select(&own)).unwrap();
        let mut chosen: Vec<usize> =
            candidates.minimise_trace(expected.inducing_indices.len()).indices.iter().map(|&i| own[i]).collect();
        chosen.sort_unstable();
        assert_eq!(chosen, expected.inducing_indices);
        assert_matrix("G", &packet.precision(), &expected.G);
        assert_close("b", &packet.shift(), &expected.b, CLOSED_FORM);
        let (mean, covariance) = packet.moments().unwrap();
        assert_close("mu", &mean, &expected.mu, CLOSED_FORM);
        assert_matrix("Sigma", &covariance, &expected.Sigma);
    }
}

#[test]
fn concatenation() {
    let problem = Problem::load();
    let packets = problem.packets();
    let stacked = Concatenation::new(&problem.prior, &packets.iter().collect::<Vec<_>>()).unwrap();
    assert_eq!(stacked.jitter(), 0.0);
    problem.assert_latent(&stacked.latent(&problem.test_inputs()).unwrap(), &problem.reference.team.concatenation);
}

#[test]
fn site_fusion() {
    let problem = Problem::load();
    let packets = problem.packets();
    let none = Sites::empty(problem.inputs.dimension());
    let posterior = Posterior::fuse(&problem.prior, &none, &packets.iter().collect::<Vec<_>>()).unwrap();
    problem.assert_predicts(&posterior, &problem.reference.team.site_fusion);
}

#[test]
fn own_events_and_a_packet() {
    let problem = Problem::load();
    let posterior = Posterior::fuse(&problem.prior, &problem.events_of(0), &[&problem.packets()[1]]).unwrap();
    problem.assert_predicts(&posterior, &problem.reference.team.agent0_own_events_plus_packet_of_agent1);
}

#[test]
fn mean_field_fixed_point() {
    let problem = Problem::load();
    let fit = dgpc::fit(&problem.prior, &problem.observations, &FitOptions::default()).unwrap();
    let expected = &problem.reference.mean_field;
    assert!(fit.converged());
    assert_close("omega", fit.sites().omega(), &expected.omega, MEAN_FIELD);
    assert_close("mean", fit.mean(), &expected.mean, MEAN_FIELD);
    assert_close("variance", fit.variance(), &expected.variance, MEAN_FIELD);
    assert_close("elbo", &[fit.evidence()], &[expected.elbo], MEAN_FIELD);
}
