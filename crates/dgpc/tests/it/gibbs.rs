//! The Gibbs chain against its stationary distribution: Geweke's joint test, simulation-based calibration, and
//! quadrature of the posterior of one or two events. Thresholds are five standard errors by batch means, or a χ² value
//! at level 1e-6.

use crate::common::{
    BatchMeans, Dense, assert_near, chi_square_critical, cholesky, dot, gaussian_expectation, logistic, rows, seeded,
    solve_vector,
};
use dgpc::*;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

fn prior(variance: f64, length_scale: f64, dimension: usize, mean: PriorMean) -> Prior {
    let term = Term::isotropic(Shape::Matern52, variance, length_scale, dimension).unwrap();
    Prior::new(Kernel::new(vec![term]).unwrap(), mean).unwrap()
}

fn range_mean() -> PriorMean {
    PriorMean::range(1.5, 1.0, &[0], &[1]).unwrap()
}

/// Prior of f at some inputs, for draws that do not use the crate.
struct Joint {
    mean: Vec<f64>,
    covariance: Dense,
    root: Dense,
}

impl Joint {
    fn new(prior: &Prior, inputs: &Inputs) -> Self {
        let covariance = rows(&prior.kernel().gram(inputs).unwrap());
        let root = cholesky(&covariance).unwrap();
        Self { mean: prior.mean().values(inputs).unwrap(), covariance, root }
    }

    fn draw(&self, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let normals: Vec<f64> = self.mean.iter().map(|_| rng.sample(StandardNormal)).collect();
        self.mean.iter().zip(&self.root).map(|(mean, root)| mean + dot(root, &normals)).collect()
    }
}

fn outcomes(f: &[f64], rng: &mut ChaCha8Rng) -> Vec<bool> {
    f.iter().map(|&f| rng.random::<f64>() < logistic(f)).collect()
}

/// Scores and relative standard errors of Geweke's test, one per function of (f, ω, y).
struct Geweke {
    names: Vec<String>,
    /// (found − expected) / standard error.
    scores: Vec<f64>,
    /// Standard error divided by the expected root mean square of the function's argument.
    precision: Vec<f64>,
}

impl Geweke {
    /// Alternates sweeps under `prior` with new outcomes drawn from σ(`gain` · f). With gain 1, the stationary
    /// distribution of the chain is p(f) p(ω | f) p(y | f), so that f has exactly its prior distribution.
    fn new(prior: &Prior, inputs: &Inputs, gain: f64, seed: u64) -> Self {
        const BATCHES: usize = 200;
        const BATCH: usize = 2000;
        let joint = Joint::new(prior, inputs);
        let size = inputs.len();
        let (names, expected, scale) = Self::expectations(&joint);
        let mut rng = seeded(seed);
        let start = joint.draw(&mut rng);
        let mut chain =
            Gibbs::new(prior, Observations::new(inputs.clone(), outcomes(&start, &mut rng)).unwrap()).unwrap();
        assert_eq!(chain.jitter(), 0.0);
        let mut averages = BatchMeans::new(expected.len(), BATCH);
        let mut values = Vec::with_capacity(expected.len());
        // The first batch is discarded, because the start is not from the stationary distribution.
        for step in 0..BATCH * (BATCHES + 1) {
            chain.sweep(&mut rng).unwrap();
            let gained: Vec<f64> = chain.latent().iter().map(|f| gain * f).collect();
            let drawn = outcomes(&gained, &mut rng);
            if step >= BATCH {
                values.clear();
                let (f, omega) = (chain.latent(), chain.omega());
                for n in 0..size {
                    let success = if drawn[n] { 1.0 } else { 0.0 };
                    let square = f[n] * f[n];
                    values.extend([
                        f[n],
                        square,
                        square * square,
                        success,
                        success * f[n],
                        omega[n],
                        omega[n] * success,
                    ]);
                    values.extend((0..n).map(|m| f[n] * f[m]));
                }
                averages.add(&values);
            }
            chain.replace_outcomes(drawn).unwrap();
        }
        let found = averages.finish();
        let scores = found.iter().zip(&expected).map(|((mean, error), expected)| (mean - expected) / error).collect();
        let precision = found.iter().zip(&scale).map(|((_, error), scale)| error / scale).collect();
        Self { names, scores, precision }
    }

    /// Returns names, prior expectations and natural magnitudes, exact or by quadrature over one latent value. After a
    /// sweep and a new draw of the outcomes, ω and y are independent given f: their joint density is p(f) p(ω | f) p(y
    /// | f).
    fn expectations(joint: &Joint) -> (Vec<String>, Vec<f64>, Vec<f64>) {
        let (mut names, mut expected, mut scale) = (Vec::new(), Vec::new(), Vec::new());
        for n in 0..joint.mean.len() {
            let (m, v) = (joint.mean[n], joint.covariance[n][n]);
            let mut push = |name: String, value: f64, magnitude: f64| {
                names.push(name);
                expected.push(value);
                scale.push(magnitude);
            };
            let square = m * m + v;
            let average = |g: &dyn Fn(f64) -> f64| gaussian_expectation(m, v, g);
            push(format!("f{n}"), m, square.sqrt());
            push(format!("f{n}²"), square, square);
            push(
                format!("f{n}⁴"),
                3.0 * v * v + 6.0 * v * m * m + m.powi(4),
                3.0 * v * v + 6.0 * v * m * m + m.powi(4),
            );
            push(format!("y{n}"), average(&logistic), 1.0);
            push(format!("y{n}f{n}"), average(&|f| f * logistic(f)), square.sqrt());
            let omega = average(&|f| polya_gamma::mean(1.0, f));
            push(format!("ω{n}"), omega, omega);
            push(format!("ω{n}y{n}"), average(&|f| polya_gamma::mean(1.0, f) * logistic(f)), omega);
            for (earlier, other) in joint.mean.iter().enumerate().take(n) {
                let covariance = joint.covariance[n][earlier];
                push(format!("f{n}f{earlier}"), m * other + covariance, square);
            }
        }
        (names, expected, scale)
    }

    fn assert_passes(&self) {
        for ((name, score), precision) in self.names.iter().zip(&self.scores).zip(&self.precision) {
            assert!(score.abs() < 5.0, "{name} is off by {score:.1} standard errors of relative size {precision:.4}");
            // With a larger standard error the test could not detect a wrong sampler.
            let enough = if name.ends_with('⁴') { 0.03 } else { 0.01 };
            assert!(*precision < enough, "{name} is known to {precision:.4} only");
        }
    }

    fn worst(&self) -> f64 {
        self.scores.iter().fold(0.0, |worst, score| worst.max(score.abs()))
    }
}

fn line(points: &[f64]) -> Inputs {
    Inputs::new(points.to_vec(), 1).unwrap()
}

fn links() -> Inputs {
    Inputs::from_rows(&[[0.0, 0.5], [0.3, 1.9], [2.0, 0.4], [-1.0, 1.5], [0.1, 3.2]]).unwrap()
}

#[test]
fn geweke_with_zero_prior_mean() {
    let prior = prior(2.0, 1.0, 1, PriorMean::Zero);
    Geweke::new(&prior, &line(&[0.0, 0.4, 1.3, 3.0]), 1.0, 1).assert_passes();
}

#[test]
fn geweke_with_constant_prior_mean() {
    let prior = prior(1.0, 0.7, 1, PriorMean::Constant(-1.2));
    Geweke::new(&prior, &line(&[0.0, 0.5, 1.0, 1.2, 4.0]), 1.0, 2).assert_passes();
}

#[test]
fn geweke_with_range_prior_mean() {
    Geweke::new(&prior(1.5, 1.0, 2, range_mean()), &links(), 1.0, 3).assert_passes();
}

#[test]
fn geweke_detects_a_wrong_likelihood() {
    let prior = prior(2.0, 1.0, 1, PriorMean::Zero);
    let worst = Geweke::new(&prior, &line(&[0.0, 0.4, 1.3, 3.0]), 0.9, 4).worst();
    assert!(worst > 8.0, "a likelihood 10 % flatter is off by {worst} standard errors only");
}

/// Returns χ² of the ranks of the true values among `DRAWS` posterior draws over many data sets, one per function.
fn calibration(truth: &Prior, believed: &Prior, inputs: &Inputs, seed: u64) -> Vec<f64> {
    const REPLICATIONS: usize = 1600;
    const DRAWS: usize = 15;
    const BURN_IN: usize = 100;
    const THINNING: usize = 20;
    let joint = Joint::new(truth, inputs);
    let mut rng = seeded(seed);
    // Every f_n, their sum, and the log-likelihood, which also depends on the outcomes.
    let functions = |f: &[f64], outcomes: &[bool]| {
        let fits = f.iter().zip(outcomes).map(|(&f, &success)| logistic(if success { f } else { -f }).ln());
        let mut values = f.to_vec();
        values.extend([f.iter().sum::<f64>(), fits.sum()]);
        values
    };
    let mut counts = vec![[0.0; DRAWS + 1]; inputs.len() + 2];
    for _ in 0..REPLICATIONS {
        let f = joint.draw(&mut rng);
        let outcomes = outcomes(&f, &mut rng);
        let expected = functions(&f, &outcomes);
        let mut ranks = vec![0; expected.len()];
        let mut chain = Gibbs::new(believed, Observations::new(inputs.clone(), outcomes.clone()).unwrap()).unwrap();
        (0..BURN_IN).for_each(|_| chain.sweep(&mut rng).unwrap());
        for _ in 0..DRAWS {
            (0..THINNING).for_each(|_| chain.sweep(&mut rng).unwrap());
            let found = functions(chain.latent(), &outcomes);
            let below = found.iter().zip(&expected).map(|(found, expected)| usize::from(found < expected));
            ranks.iter_mut().zip(below).for_each(|(rank, below)| *rank += below);
        }
        counts.iter_mut().zip(&ranks).for_each(|(counts, &rank)| counts[rank] += 1.0);
    }
    let expected = REPLICATIONS as f64 / (DRAWS + 1) as f64;
    counts.iter().map(|counts| counts.iter().map(|count: &f64| (count - expected).powi(2) / expected).sum()).collect()
}

#[test]
fn simulation_based_calibration() {
    let inputs = line(&[0.0, 0.2, 0.9, 1.5, 2.8, 3.0]);
    let prior = prior(3.0, 1.0, 1, PriorMean::Constant(0.4));
    let statistics = calibration(&prior, &prior, &inputs, 10);
    assert!(statistics.iter().all(|&statistic| statistic < chi_square_critical(15)), "{statistics:?}");
}

#[test]
fn simulation_based_calibration_over_links() {
    let prior = prior(2.0, 1.5, 2, range_mean());
    let statistics = calibration(&prior, &prior, &links(), 11);
    assert!(statistics.iter().all(|&statistic| statistic < chi_square_critical(15)), "{statistics:?}");
}

#[test]
fn calibration_detects_a_wrong_prior() {
    let inputs = line(&[0.0, 0.2, 0.9, 1.5, 2.8, 3.0]);
    let (truth, believed) = (prior(3.0, 1.0, 1, PriorMean::Zero), prior(2.0, 1.0, 1, PriorMean::Zero));
    let statistics = calibration(&truth, &believed, &inputs, 12);
    assert!(statistics.iter().any(|&statistic| statistic > chi_square_critical(15)), "{statistics:?}");
}

/// Returns the posterior expectations of f_n and f_n² (and of f_0 f_1) of one or two weighted events. The integrals use
/// the trapezoid rule over whitened f.
fn quadrature(prior: &Prior, observations: &Observations) -> Vec<f64> {
    const STEPS: i32 = 400;
    let joint = Joint::new(prior, observations.inputs());
    let size = observations.len();
    let at = |i: i32| 0.045 * f64::from(i - STEPS / 2);
    let mut sums = vec![0.0; 1 + moments(&joint.mean).len()];
    for i in 0..=STEPS {
        for j in if size == 2 { 0..=STEPS } else { 0..=0 } {
            let u = [at(i), at(j)];
            let f: Vec<f64> = (0..size).map(|n| joint.mean[n] + dot(&joint.root[n], &u)).collect();
            let mut ln_density = -0.5 * dot(&u[..size], &u[..size]);
            for (n, f) in f.iter().enumerate() {
                let sign = if observations.outcomes()[n] { 1.0 } else { -1.0 };
                ln_density += observations.weights()[n] * logistic(sign * f).ln();
            }
            sums[0] += ln_density.exp();
            sums[1..].iter_mut().zip(moments(&f)).for_each(|(sum, value)| *sum += ln_density.exp() * value);
        }
    }
    sums[1..].iter().map(|sum| sum / sums[0]).collect()
}

/// Returns f_n, f_n² and f_n f_m.
fn moments(f: &[f64]) -> Vec<f64> {
    let products = (0..f.len()).flat_map(|n| (0..=n).map(move |m| f[n] * f[m]));
    f.iter().copied().chain(products).collect()
}

/// Returns chain averages of [`moments`], with standard errors.
fn chain_moments(prior: &Prior, observations: &Observations, sweeps: usize, seed: u64) -> Vec<(f64, f64)> {
    let mut rng = seeded(seed);
    let mut chain = Gibbs::new(prior, observations.clone()).unwrap();
    (0..1000).for_each(|_| chain.sweep(&mut rng).unwrap());
    let mut averages = BatchMeans::new(moments(chain.latent()).len(), sweeps / 200);
    for _ in 0..sweeps {
        chain.sweep(&mut rng).unwrap();
        averages.add(&moments(chain.latent()));
    }
    averages.finish()
}

#[test]
fn posterior_of_one_or_two_events_by_quadrature() {
    let pair = || line(&[0.0, 0.6]);
    let cases = [
        (prior(4.0, 1.0, 1, PriorMean::Zero), line(&[0.3]), vec![true], vec![1.0]),
        (prior(1.0, 1.0, 1, PriorMean::Constant(2.0)), line(&[0.3]), vec![false], vec![1.0]),
        (prior(2.0, 1.0, 1, PriorMean::Constant(-0.5)), line(&[0.3]), vec![true], vec![3.0]),
        (prior(4.0, 1.0, 1, PriorMean::Zero), pair(), vec![true, false], vec![1.0, 1.0]),
        (prior(2.0, 1.0, 1, PriorMean::Constant(1.0)), pair(), vec![false, true], vec![2.0, 5.0]),
    ];
    for (seed, (prior, inputs, outcomes, weights)) in cases.into_iter().enumerate() {
        let observations = Observations::weighted(inputs, outcomes, weights).unwrap();
        let expected = quadrature(&prior, &observations);
        let found = chain_moments(&prior, &observations, 400_000, 20 + seed as u64);
        for (i, ((found, error), expected)) in found.iter().zip(&expected).enumerate() {
            let score = (found - expected).abs() / error;
            assert!(score < 5.0, "case {seed}, moment {i}: {found}, expected {expected}: {score:.1} standard errors");
            // The prior variance is the scale of all moments, so a 1 % error of it is detected.
            assert!(*error < 0.01, "case {seed}, moment {i} is known to {error} only");
        }
    }
}

#[test]
fn the_chain_counts_an_event_of_weight_two_twice() {
    let prior = prior(3.0, 1.0, 1, PriorMean::Constant(0.7));
    let (inputs, outcomes) = (line(&[0.0, 0.8, 1.5]), vec![true, false, false]);
    let heavy = Observations::weighted(inputs, outcomes, vec![1.0, 2.0, 1.0]).unwrap();
    let twice = Observations::new(line(&[0.0, 0.8, 1.5, 0.8]), vec![true, false, false, false]).unwrap();
    // The first three latent values have the same distribution. The repeated event adds moments at the end.
    let heavy = chain_moments(&prior, &heavy, 300_000, 30);
    let twice = chain_moments(&prior, &twice, 300_000, 31);
    let twice = [&twice[..3], &twice[4..]].concat();
    for (i, (heavy, twice)) in heavy.iter().zip(&twice).enumerate() {
        let score = (heavy.0 - twice.0).abs() / heavy.1.hypot(twice.1);
        assert!(score < 5.0, "moment {i}: {} against {}, {score:.1} standard errors", heavy.0, twice.0);
        assert!(heavy.1.hypot(twice.1) < 0.02, "moment {i} is known to {} only", heavy.1.hypot(twice.1));
    }
}

#[test]
fn averages_over_sites_agree_with_exact_predictions() {
    let prior = prior(2.0, 1.0, 1, PriorMean::Constant(0.3));
    let inputs = line(&[0.0, 0.6]);
    let elsewhere = line(&[-0.5, 0.3, 1.5]);
    let observations = Observations::new(inputs.clone(), vec![true, false]).unwrap();
    // E[f*] = μ₀* + k* K⁻¹ (E[f] − μ₀).
    let exact = quadrature(&prior, &observations);
    let joint = Joint::new(&prior, &inputs);
    let weights = solve_vector(&joint.covariance, &[exact[0] - joint.mean[0], exact[1] - joint.mean[1]]);
    let cross = rows(&prior.kernel().cross(&elsewhere, &inputs).unwrap());
    let expected: Vec<f64> = cross.iter().map(|row| 0.3 + dot(row, &weights)).collect();

    let mut rng = seeded(40);
    let mut chain = Gibbs::new(&prior, observations).unwrap();
    let mut averages = BatchMeans::new(3, 400);
    for sweep in 0..41_000 {
        chain.sweep(&mut rng).unwrap();
        if sweep >= 1000 {
            let posterior = Posterior::fuse(&prior, &chain.sites().unwrap(), &[]).unwrap();
            averages.add(&posterior.latent(&elsewhere).unwrap().mean);
        }
    }
    for ((found, error), expected) in averages.finish().iter().zip(&expected) {
        let score = (found - expected).abs() / error;
        assert!(score < 5.0 && *error < 0.003, "{found}, expected {expected}: {score:.1} standard errors of {error}");
    }
}

#[test]
fn the_same_seed_gives_the_same_chain() {
    let prior = prior(2.0, 1.0, 2, range_mean());
    let observations = Observations::new(links(), vec![true, false, false, true, false]).unwrap();
    let run = |seed| {
        let mut rng = seeded(seed);
        let mut chain = Gibbs::new(&prior, observations.clone()).unwrap();
        let mut bits = Vec::new();
        for _ in 0..200 {
            chain.sweep(&mut rng).unwrap();
            bits.extend(chain.latent().iter().chain(chain.omega()).map(|value| value.to_bits()));
        }
        bits
    };
    assert_eq!(run(50), run(50));
    assert_ne!(run(50), run(51));
}

#[test]
fn sites_carry_the_current_omega() {
    let prior = prior(2.0, 1.0, 2, range_mean());
    let weights = vec![1.0, 2.0, 1.0, 3.0, 1.0];
    let observations = Observations::weighted(links(), vec![true, false, false, true, false], weights).unwrap();
    let mut chain = Gibbs::new(&prior, observations.clone()).unwrap();
    assert_near("start", chain.latent(), &prior.mean().values(&links()).unwrap(), 0.0);
    chain.sweep(&mut seeded(52)).unwrap();
    let sites = chain.sites().unwrap();
    assert_eq!(sites, Sites::new(&observations, chain.omega().to_vec()).unwrap());
    assert_eq!(sites.kappa(), [0.5, -1.0, -0.5, 1.5, -0.5]);
}

#[test]
fn the_chain_refuses_invalid_weights_and_sizes() {
    let prior = prior(2.0, 1.0, 1, PriorMean::Zero);
    let weighted = |weights| Observations::weighted(line(&[0.0, 1.0, 2.0]), vec![true; 3], weights).unwrap();
    let refused = Gibbs::new(&prior, weighted(vec![1.0, 2.0, 1.5])).err();
    assert_eq!(refused, Some(Error::FractionalWeight { event: 2, weight: 1.5 }));
    let refused = Gibbs::new(&prior, weighted(vec![1.0, 0.5, 0.25])).err();
    assert_eq!(refused, Some(Error::FractionalWeight { event: 1, weight: 0.5 }));
    let mut chain = Gibbs::new(&prior, weighted(vec![1.0, 2.0, 1.0])).unwrap();
    let refused = chain.replace_outcomes(vec![true]);
    assert!(matches!(refused, Err(Error::SizeMismatch { expected: 3, found: 1, .. })), "{refused:?}");
    assert!(matches!(
        Gibbs::new(&self::prior(2.0, 1.0, 2, PriorMean::Zero), weighted(vec![1.0; 3])).err(),
        Some(Error::BadColumn { column: 1, columns: 1, .. })
    ));
}

#[test]
fn a_chain_without_events_does_nothing() {
    let mut chain =
        Gibbs::new(&prior(2.0, 1.0, 1, PriorMean::Zero), Observations::new(line(&[]), vec![]).unwrap()).unwrap();
    chain.sweep(&mut seeded(60)).unwrap();
    assert!(chain.latent().is_empty() && chain.sites().unwrap().is_empty());
}

/// Compares 90 % intervals of the probability with the quantiles of a long chain, for expectation propagation and for
/// mean field. Some events have only equal outcomes around them, others have mixed outcomes.
#[test]
fn propagation_intervals_agree_with_a_long_chain() {
    let inputs = line(&(0..40).map(|n| 0.1 * f64::from(n)).collect::<Vec<_>>());
    let observations = Observations::new(inputs.clone(), (0..40).map(|n| n < 22 || n % 5 == 0).collect()).unwrap();
    let prior = prior(6.0, 1.5, 1, PriorMean::Constant(0.5));
    let mut rng = seeded(77);
    let mut chain = Gibbs::new(&prior, observations.clone()).unwrap();
    (0..1000).for_each(|_| chain.sweep(&mut rng).unwrap());
    let mut draws = vec![Vec::new(); inputs.len()];
    for _ in 0..60_000 {
        chain.sweep(&mut rng).unwrap();
        draws.iter_mut().zip(chain.latent()).for_each(|(draws, &f)| draws.push(f));
    }
    let fit = fit(&prior, &observations, &FitOptions::default()).unwrap();
    let wide = fit.propagated_with(&[]).unwrap().posterior().unwrap().latent(&inputs).unwrap();
    let (mut off, mut off_of_mean_field) = (0.0f64, 0.0f64);
    for (n, draws) in draws.iter_mut().enumerate() {
        draws.sort_by(f64::total_cmp);
        for (share, reach) in [(0.05, -1.645), (0.95, 1.645)] {
            let exact = logistic(draws[(share * draws.len() as f64) as usize]);
            let found = logistic(wide.mean[n] + reach * wide.variance[n].sqrt());
            let narrow = logistic(fit.mean()[n] + reach * fit.variance()[n].sqrt());
            off = off.max((found - exact).abs());
            off_of_mean_field = off_of_mean_field.max((narrow - exact).abs());
        }
    }
    assert!(off < 0.03 && off_of_mean_field > 0.05, "{off} {off_of_mean_field}");
}
