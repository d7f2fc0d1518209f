"""The binding gives the numbers of the reference vectors, which were computed by dense formulas."""

import json
import os
from pathlib import Path

import dgpc
import numpy as np
import pytest

SHARED = os.environ.get("PINGMAP_SHARED")

pytestmark = pytest.mark.skipif(SHARED is None, reason="PINGMAP_SHARED is not set: no reference vectors")


@pytest.fixture(scope="module")
def reference() -> dict:
    return json.loads((Path(SHARED or "") / "reference" / "vectors.json").read_text())


@pytest.fixture(scope="module")
def prior(reference: dict) -> dgpc.Prior:
    kernel, mean = reference["kernel"], reference["prior_mean"]
    term = dgpc.Term("squared-exponential", kernel["ell"], variance=kernel["variance"], dimension=4)
    return dgpc.Prior(term, dgpc.RangeMean(mean["a"], mean["b"], [0, 1], [2, 3]))


@pytest.fixture(scope="module")
def sites(reference: dict) -> dgpc.Sites:
    return dgpc.Sites(reference["X"], reference["y"], reference["omega"])


def close(found: object, expected: object, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(found, expected, rtol=tolerance, atol=tolerance)


def test_the_posterior_given_omega(reference, prior, sites) -> None:
    mean, variance = dgpc.Posterior(prior, sites).latent(reference["X"])
    close(mean, reference["posterior_given_omega"]["mean"])
    close(variance, reference["posterior_given_omega"]["variance"])


def test_the_mean_field(reference, prior) -> None:
    fit, expected = dgpc.fit(prior, reference["X"], reference["y"]), reference["mean_field"]
    close(fit.omega, expected["omega"], 1e-7)
    close(fit.mean, expected["mean"], 1e-7)
    close(fit.variance, expected["variance"], 1e-7)
    close(fit.evidence, expected["elbo"], 1e-7)


def test_the_summary_and_the_certificate(reference, prior, sites) -> None:
    expected, bounds = reference["sparse"], reference["bounds"]
    points = np.array(reference["X"])[expected["inducing_indices"]]
    summary = dgpc.Summary.variational(prior, sites, points)
    close(summary.precision, expected["G"])
    close(summary.shift, expected["b"])
    mean, covariance = summary.moments()
    close(mean, expected["mu"])
    close(covariance, expected["Sigma"])
    certificate = dgpc.Certificate(prior, sites, points)
    close(certificate.trace, bounds["trace"])
    close(certificate.gap, bounds["gap"])
    close(certificate.closed_form, bounds["closed_form"])
    close(certificate.paper_closed_form, bounds["paper"])
    close(dgpc.log_evidence(prior, sites) - certificate.lower, bounds["KL"])


def test_the_selection(reference, prior) -> None:
    candidates = dgpc.Candidates(prior, reference["X"])
    for count in ["1", "2"]:
        expected = reference["selection_all_events"][count]
        good, bad = candidates.minimise_trace(int(count)), candidates.maximise_trace(int(count))
        assert (sorted(good.indices), sorted(bad.indices)) == (sorted(expected["good"]), sorted(expected["bad"]))
        close(good.trace, expected["good_trace"])
        close(bad.trace, expected["bad_trace"])


def test_the_team(reference, prior, sites) -> None:
    team, agents = reference["team"], np.array(reference["agent"])
    own = [sites.select(np.flatnonzero(agents == agent)) for agent in (0, 1)]
    packets = []
    for packet in team["packets"]:
        points = np.array(reference["X"])[packet["inducing_indices"]]
        packets.append(dgpc.Summary.variational(prior, own[packet["agent"]], points))
        close(packets[-1].precision, packet["G"])
    predictors = {
        "concatenation": dgpc.Concatenation(prior, packets),
        "site_fusion": dgpc.Posterior(prior, summaries=packets),
        "agent0_own_events_plus_packet_of_agent1": dgpc.Posterior(prior, own[0], packets[1:]),
    }
    for name, predictor in predictors.items():
        mean, variance = predictor.latent(team["test_inputs"])
        close(mean, team[name]["mean"])
        close(variance, team[name]["variance"])
        close(predictor.probability(team["test_inputs"]), team[name]["probability"], 1e-8)


def test_probabilities_and_moments(reference) -> None:
    for case in reference["probability"]:
        close(dgpc.success_probability(case["mean"], case["variance"]), case["p"], 1e-8)
    for case in reference["polya_gamma_moments"]:
        mean, variance = dgpc.polya_gamma_moments(case["b"], case["c"])
        close([mean, variance], [case["mean"], case["variance"]])


def test_the_kernels(reference) -> None:
    kernel, x = reference["kernel"], np.array(reference["X"])
    for name, shape in {"se": "squared-exponential", "matern32": "matern32", "matern52": "matern52"}.items():
        term = dgpc.Term(shape, kernel["ell"], variance=kernel["variance"], dimension=4)
        close(dgpc.Kernel([term]).cross(x[:3], x[3:6]), reference["kernels"][name])
    term = dgpc.Term("squared-exponential", kernel["ell"], variance=kernel["variance"], dimension=4)
    reciprocal = dgpc.Kernel([term.reciprocal([(0, 2), (1, 3)])])
    close(reciprocal.cross(x[:3], x[3:6]), reference["kernels"]["se_reciprocal"])
