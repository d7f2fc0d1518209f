//! The evidence bound: its gradient, the contribution of messages, and leave-one-out.

use super::problems::*;
use crate::common::*;
use dgpc::evidence;
use dgpc::*;
use proptest::prelude::*;

/// Returns ∂value/∂θ at the parameters of `prior` by central differences of fourth order.
fn central_differences(prior: &Prior, value: impl Fn(&Prior) -> f64) -> Vec<f64> {
    let parameters = prior.parameter_values();
    let step = 2e-3;
    let moved = |place: usize, steps: f64| {
        let mut moved = parameters.clone();
        moved[place] += steps * step;
        value(&prior.with_parameters(&moved).unwrap())
    };
    let slope = |place| {
        let (near, far) = (moved(place, 1.0) - moved(place, -1.0), moved(place, 2.0) - moved(place, -2.0));
        (8.0 * near - far) / (12.0 * step)
    };
    (0..parameters.len()).map(slope).collect()
}

fn tight() -> FitOptions<'static> {
    FitOptions::default().tolerance(1e-12)
}

/// Generates problems whose points `elsewhere`, the points of messages, keep a minimal distance.
fn problems_apart(events: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = Problem> {
    let apart = |problem: &Problem| {
        let distance = |a: usize, b: usize| {
            let pairs = problem.elsewhere.row(a).iter().zip(problem.elsewhere.row(b));
            pairs.map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
        };
        (0..6).all(|a| (0..a).all(|b| distance(a, b) > 0.1))
    };
    problems(events).prop_filter("points apart", apart)
}

/// Returns a summary at three points by another agent with another prior.
fn message(problem: &Problem) -> Summary {
    let kernel = Kernel::new(vec![Term::isotropic(Shape::Matern32, 1.5, 1.2, problem.inputs().dimension()).unwrap()]);
    let prior = Prior::new(kernel.unwrap(), PriorMean::Constant(0.3)).unwrap();
    let count = problem.elsewhere.len();
    let observations = Observations::new(problem.elsewhere.clone(), (0..count).map(|n| n % 3 == 0).collect()).unwrap();
    let sites = Sites::new(&observations, vec![0.2; count]).unwrap();
    Summary::marginal(&prior, &sites, &problem.elsewhere.select(&[0, 1, 2])).unwrap()
}

proptest! {
    #![proptest_config(cases(150))]

    #[test]
    fn parameters_round_trip(problem in problems_apart(1..=3)) {
        let prior = &problem.prior;
        let again = prior.with_parameters(&prior.parameter_values()).unwrap();
        assert_near("parameters", &again.parameter_values(), &prior.parameter_values(), 1e-15);
        let gram = |prior: &Prior| rows(&prior.kernel().gram(problem.inputs()).unwrap());
        assert_near_matrix("gram", &gram(&again), &gram(prior), 1e-13);
    }

    #[test]
    fn the_dense_gradient_is_exact(problem in problems_apart(1..=12), with_message in any::<bool>()) {
        let message = message(&problem);
        let messages = if with_message { vec![&message] } else { vec![] };
        let evaluate = |prior: &Prior| evidence(prior, &problem.observations, &tight().messages(&messages)).unwrap();
        let found = evaluate(&problem.prior);
        let expected = central_differences(&problem.prior, |prior| evaluate(prior).fit.evidence());
        assert_near("∂E/∂θ", &found.gradient, &expected, 1e-6);
    }

    #[test]
    fn the_sparse_gradient_is_exact(problem in problems_apart(2..=14), with_message in any::<bool>()) {
        let message = message(&problem);
        let messages = if with_message { vec![&message] } else { vec![] };
        let mut points = problem.inputs().select(&problem.spread(4));
        points.append(&problem.elsewhere.slice(4..6)).unwrap();
        let evaluate = |prior: &Prior| {
            evidence(prior, &problem.observations, &tight().messages(&messages).inducing_points(&points)).unwrap()
        };
        let found = evaluate(&problem.prior);
        prop_assume!(found.fit.jitter() == 0.0);
        let expected = central_differences(&problem.prior, |prior| evaluate(prior).fit.evidence());
        assert_near("∂E/∂θ", &found.gradient, &expected, 1e-6);
    }

    #[test]
    fn messages_at_the_inducing_points_count_fully(problem in problems_apart(2..=10)) {
        let message = message(&problem);
        let messages = [&message];
        let options = tight().messages(&messages);
        let dense = evidence(&problem.prior, &problem.observations, &options).unwrap();
        // The fit adds the points of the messages to the inducing points.
        let sparse = evidence(&problem.prior, &problem.observations, &options.inducing_points(problem.inputs())).unwrap();
        prop_assert_eq!(sparse.fit.inducing_points().unwrap().len(), problem.inputs().len() + 3);
        prop_assume!(sparse.fit.jitter() == 0.0);
        assert_near("E", &[sparse.fit.evidence()], &[dense.fit.evidence()], 1e-5);
        assert_near("mean", sparse.fit.mean(), dense.fit.mean(), 1e-5);
        assert_near("variance", sparse.fit.variance(), dense.fit.variance(), 1e-5);
    }

    #[test]
    fn the_fit_with_messages_is_the_fused_posterior(problem in problems_apart(1..=10)) {
        let message = message(&problem);
        let fit = dgpc::fit(&problem.prior, &problem.observations, &tight().messages(&[&message])).unwrap();
        let own = message.under(&problem.prior).unwrap();
        let fused = Posterior::fuse(&problem.prior, fit.sites(), &[&own]).unwrap().latent(problem.inputs()).unwrap();
        assert_same_latent(&Latent { mean: fit.mean().to_vec(), variance: fit.variance().to_vec() }, &fused, 1e-7);
    }

    /// With ω known, E is the log of ∫ p(own events | f) · factor(f) · p(f) df, here by dense formulas.
    #[test]
    fn the_evidence_of_a_message_alone_agrees_with_its_integral(problem in problems_apart(1..=3)) {
        let message = message(&problem);
        let none = Observations::new(Inputs::empty(problem.inputs().dimension()), Vec::new()).unwrap();
        let found = dgpc::fit(&problem.prior, &none, &tight().messages(&[&message])).unwrap().evidence();
        // ln ∫ exp(−½fᵀPf + ηᵀf) N(f; μ, K) df = −½ ln|I + KP| + ½ (η − Pμ)ᵀ(K⁻¹ + P)⁻¹(η − Pμ) + ηᵀμ − ½ μᵀPμ.
        let factor = message.factor().unwrap();
        let (precision, shift) = (rows(factor.precision()), factor.shift());
        let gram = rows(&problem.prior.kernel().gram(factor.inducing_points()).unwrap());
        let mean = problem.prior.mean().values(factor.inducing_points()).unwrap();
        let precision_mean: Vec<f64> = precision.iter().map(|row| dot(row, &mean)).collect();
        let about: Vec<f64> = shift.iter().zip(&precision_mean).map(|(h, p)| h - p).collect();
        let system = sum(&times(&gram, &precision), &diagonal_matrix((0..3).map(|_| 1.0)));
        let root = cholesky(&gram).unwrap();
        let inner = times(&transposed(&root), &times(&precision, &root));
        let symmetric = sum(&inner, &diagonal_matrix((0..3).map(|_| 1.0)));
        let moved: Vec<f64> = gram.iter().map(|row| dot(row, &about)).collect();
        let solved = solve(&system, &moved.iter().map(|&v| vec![v]).collect());
        let quadratic: f64 = about.iter().zip(&solved).map(|(a, s)| a * s[0]).sum();
        let expected = -0.5 * log_determinant(&symmetric) + 0.5 * quadratic + dot(shift, &mean) - 0.5 * dot(&mean, &precision_mean);
        assert_near("E", &[found], &[expected], 1e-7);
    }

    /// The cavity of an event is the posterior of a fit at the same ω without the event's site.
    #[test]
    fn leave_one_out_agrees_with_removing_the_site(problem in problems_apart(2..=10)) {
        let fit = dgpc::fit(&problem.prior, &problem.observations, &tight()).unwrap();
        let found = fit.leave_one_out();
        for (left_out, &found) in found.iter().enumerate() {
            let others: Vec<usize> = (0..fit.mean().len()).filter(|&n| n != left_out).collect();
            let posterior = Posterior::fuse(&problem.prior, &fit.sites().select(&others), &[]).unwrap();
            let p = posterior.probability(&problem.inputs().select(&[left_out])).unwrap()[0];
            let p = if problem.observations.outcomes()[left_out] { p } else { 1.0 - p };
            assert_near("ln p", &[found], &[p.ln()], 1e-6);
        }
    }
}
