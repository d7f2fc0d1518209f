"""The method agrees with independent computations and with its own identities."""

import dgpc
import numpy as np
import pytest


def integral(mean: float, variance: float, count: int = 200_001) -> float:
    """Returns the mean of the logistic function of a normal variable, by the trapezoidal rule over 12 deviations."""
    z = np.linspace(-12.0, 12.0, count)
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return float(np.trapezoid(density / (1.0 + np.exp(-(mean + np.sqrt(variance) * z))), z))


def logistic(f: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-f))


@pytest.mark.parametrize("mean", [-30.0, -3.0, 0.0, 0.7, 8.0])
@pytest.mark.parametrize("variance", [1e-6, 0.3, 4.0, 100.0])
def test_a_probability_is_the_integral_over_the_latent_function(mean: float, variance: float) -> None:
    assert abs(float(dgpc.success_probability(mean, variance)) - integral(mean, variance)) < 1e-8


def test_kernels_have_their_formulas() -> None:
    x = np.random.default_rng(1).normal(size=(7, 3))
    scales = np.array([0.5, 1.0, 2.0])
    r = np.linalg.norm((x[:, None] - x[None]) / scales, axis=2)
    formulas = {
        "squared-exponential": np.exp(-0.5 * r**2),
        "matern12": np.exp(-r),
        "matern32": (1 + np.sqrt(3) * r) * np.exp(-np.sqrt(3) * r),
        "matern52": (1 + np.sqrt(5) * r + 5 * r**2 / 3) * np.exp(-np.sqrt(5) * r),
        "rational-quadratic:1.5": (1 + r**2 / 3.0) ** -1.5,
    }
    for shape, expected in formulas.items():
        term = dgpc.Term(shape, scales, variance=3.0)
        np.testing.assert_allclose(dgpc.Kernel([term]).gram(x), 3.0 * expected, atol=1e-12)
        np.testing.assert_allclose((term * term + term).gram(x), 9.0 * expected**2 + 3.0 * expected, atol=1e-12)
    label = dgpc.Kernel([dgpc.Term("label", columns=[0])])
    np.testing.assert_array_equal(label.gram([[1.0], [1.0], [2.0]]), [[1, 1, 0], [1, 1, 0], [0, 0, 1]])


def test_a_mean_field_is_a_fixed_point(prior: dgpc.Prior, events) -> None:
    x, y = events
    fit = dgpc.fit(prior, x, y)
    assert fit.converged and len(fit) == len(x)
    tilt = np.sqrt(fit.mean**2 + fit.variance)
    omega, _ = dgpc.polya_gamma_moments(1.0, tilt)
    np.testing.assert_allclose(fit.omega, omega, rtol=1e-8)
    # The posterior given omega, by dense formulas.
    gram, shift = prior.kernel.gram(x), fit.sites.kappa - fit.omega * 0.2
    covariance = np.linalg.inv(np.linalg.inv(gram) + np.diag(fit.omega))
    np.testing.assert_allclose(fit.mean, 0.2 + covariance @ shift, atol=1e-7)
    np.testing.assert_allclose(fit.variance, np.diag(covariance), atol=1e-7)


def test_a_weight_of_two_counts_like_two_events_in_a_fit(prior: dgpc.Prior, events) -> None:
    x, y = events
    weighted = dgpc.fit(prior, x, y, weights=np.full(len(x), 2.0))
    twice = dgpc.fit(prior, np.concatenate([x, x]), np.concatenate([y, y]))
    np.testing.assert_allclose(weighted.mean, twice.mean[: len(x)], atol=1e-7)
    assert weighted.evidence == pytest.approx(twice.evidence, abs=1e-7)


def test_the_gradient_of_the_evidence_is_its_derivative(prior: dgpc.Prior, events) -> None:
    for points in [None, events[0][:8]]:
        _, gradient = dgpc.evidence(prior, *events, inducing_points=points, tolerance=1e-12)
        for place, step in enumerate(np.eye(len(gradient)) * 1e-5):
            ends = [prior.with_parameters(prior.parameter_values + sign * step) for sign in (1, -1)]
            up, down = (dgpc.fit(end, *events, inducing_points=points, tolerance=1e-12).evidence for end in ends)
            assert gradient[place] == pytest.approx((up - down) / 2e-5, abs=1e-4)


def test_gibbs_sampling_agrees_with_numerical_integration() -> None:
    prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=2.0, dimension=1))
    x, y = np.array([[0.0], [0.7]]), np.array([True, False])
    draws = dgpc.gibbs(prior, x, y, 20_000, seed=3, chains=2)
    assert draws["f"].shape == draws["omega"].shape == (2, 20_000, 2)
    grid = np.linspace(-9, 9, 601)
    first, second = np.meshgrid(grid, grid, indexing="ij")
    inverse = np.linalg.inv(prior.kernel.gram(x))
    quadratic = inverse[0, 0] * first**2 + 2 * inverse[0, 1] * first * second + inverse[1, 1] * second**2
    density = np.exp(-0.5 * quadratic) * logistic(first) * logistic(-second)
    exact = [(density * f).sum() / density.sum() for f in (first, second)]
    found = draws["f"].mean(axis=(0, 1))
    size = sum(dgpc.effective_sample_size(draws["f"][chain, :, 0]) for chain in range(2))
    error = draws["f"].std(axis=(0, 1)) / np.sqrt(size)
    assert (np.abs(found - exact) < 5 * error).all(), (found, exact, error)


def test_arviz_reads_the_draws_as_the_readme_says(prior: dgpc.Prior, events) -> None:
    arviz = pytest.importorskip("arviz", reason="ArviZ is not installed")
    draws = dgpc.gibbs(prior, *events, 50, seed=1, chains=2)
    is_old = arviz.__version__.startswith("0.")
    data = arviz.from_dict(posterior=draws) if is_old else arviz.from_dict({"posterior": draws})
    assert len(arviz.summary(data)) == 2 * len(events[0])
    np.testing.assert_array_equal(data.posterior["f"], draws["f"])


def test_seeds_determine_draws_and_chains_differ(prior: dgpc.Prior, events) -> None:
    def first(seed: int) -> np.ndarray:
        return dgpc.gibbs(prior, *events, 3, seed=seed, chains=2, warm_up=1)["f"]

    np.testing.assert_array_equal(first(1), first(1))
    assert (first(1) != first(2)).all() and (first(1)[0] != first(1)[1]).all()
    posterior = dgpc.fit(prior, *events).posterior()
    np.testing.assert_array_equal(posterior.draws(events[0], 2, seed=5), posterior.draws(events[0], 2, seed=5))


def test_polya_gamma_draws_have_the_moments() -> None:
    shape, tilt = np.array([[1], [4]]), np.array([0.0, 1.5, -6.0])
    draws = dgpc.polya_gamma(np.broadcast_to(shape, (40_000, 2, 1)), tilt, seed=7)
    mean, variance = dgpc.polya_gamma_moments(shape, tilt)
    assert draws.shape == (40_000, 2, 3) and mean.shape == (2, 3)
    assert (np.abs(draws.mean(axis=0) - mean) < 5 * np.sqrt(variance / 40_000)).all()
    np.testing.assert_allclose(draws.var(axis=0), variance, rtol=0.1)


def test_draws_of_functions_have_the_joint_moments(prior: dgpc.Prior, events) -> None:
    posterior = dgpc.fit(prior, *events).posterior()
    x = np.array([[0.0, 0.0], [0.3, 0.1], [3.0, 3.0]])
    draws = posterior.draws(x, 40_000, seed=1)
    mean, covariance = posterior.joint(x)
    np.testing.assert_allclose(draws.mean(axis=0), mean, atol=0.05)
    np.testing.assert_allclose(np.cov(draws.T), covariance, atol=0.05)


def test_learning_finds_a_longer_length_scale_and_reports_the_search() -> None:
    x = np.linspace(-3, 3, 80)[:, None]
    template = dgpc.Prior(dgpc.Term("matern52", 0.1, variance=4.0, dimension=1), 0.0)
    learned = dgpc.learn(template, x, np.abs(x[:, 0]) < 2)
    assert learned.prior.kernel.terms[0].correlations[0].length_scales[0] > 0.3
    assert learned.fit.evidence > dgpc.fit(template, x, np.abs(x[:, 0]) < 2).evidence
    assert learned.stop == "converged" and learned.calibration in ("found", "at bound")
    assert learned.searched_events == 80 and learned.evaluations > 0 and len(learned.starts) == 2
    fixed = dgpc.learn(template, x, np.abs(x[:, 0]) < 2, hyper_prior={"length_scale": 0.0})
    assert fixed.prior.kernel.terms[0].correlations[0].length_scales[0] == pytest.approx(0.1)


def test_learning_keeps_the_bounds_of_single_parameters() -> None:
    x = np.linspace(-3, 3, 80)[:, None]
    template = dgpc.Prior(dgpc.Term("matern52", 0.1, variance=4.0, dimension=1), 0.5)
    bounds = [None, (0.05, 0.2), "fixed"]
    learned = dgpc.learn(template, x, np.abs(x[:, 0]) < 2, bounds=bounds)
    length_scale = learned.prior.kernel.terms[0].correlations[0].length_scales[0]
    assert 0.19 < length_scale <= 0.2 * (1 + 1e-12) and learned.prior.mean == 0.5
    for bad, text in [
        ([None], "one per parameter"),
        ([None, (0.2, 0.1), None], "lower bound"),
        ([None, (0.2, 0.3), None], "between its bounds"),
        ([None, "free", None], "must be None, \"fixed\" or a pair"),
    ]:
        with pytest.raises(ValueError, match=text):
            dgpc.learn(template, x, np.abs(x[:, 0]) < 2, bounds=bad)
