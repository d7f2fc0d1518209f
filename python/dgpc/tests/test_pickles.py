"""Pickles of fits and posteriors: equal numbers, and refusal of damaged or newer bytes."""

import copy
import pickle
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import dgpc
import numpy as np
import pytest

PLACES = np.random.default_rng(2).normal(size=(20, 2))


@pytest.fixture
def message(prior: dgpc.Prior) -> dgpc.Summary:
    """A message of another agent, formed under another prior."""
    other = dgpc.Prior(prior.kernel, mean=-0.1)
    return dgpc.Summary.marginal(other, dgpc.fit(other, PLACES, PLACES[:, 0] > 0).sites, PLACES[:4])


def again(one):
    """Returns the object of a pickle."""
    return pickle.loads(pickle.dumps(one))


def assert_equal_posteriors(found: dgpc.Posterior, expected: dgpc.Posterior, atol: float = 0.0) -> None:
    assert len(found) == len(expected) and found.prior == expected.prior and found.jitter == expected.jitter
    np.testing.assert_allclose(found.latent(PLACES), expected.latent(PLACES), rtol=0.0, atol=atol)


def test_a_posterior_of_parts_has_the_same_bits(prior: dgpc.Prior, events, message) -> None:
    dense, sparse = dgpc.fit(prior, *events), dgpc.fit(prior, *events, inducing_points=9)
    own = message.under(prior)
    for posterior in [
        dgpc.Posterior(prior, dimension=2),
        dgpc.Posterior(prior, dense.sites),
        dgpc.Posterior(prior, summaries=[own]),
        dgpc.Posterior(prior, dense.sites, [own]),
        dense.posterior(),
        sparse.posterior(),
        dgpc.fit(prior, *events, messages=[message]).posterior(),
        dgpc.fit(prior, *events, messages=[message], inducing_points=9).posterior(),
        dense.posterior([message]),
        dense.posterior_of_part([0, 3], [message]),
        sparse.posterior_of_part(range(30)),
        dense.propagated().posterior(),
        sparse.propagated([message]).posterior(),
    ]:
        assert_equal_posteriors(again(posterior), posterior)
        assert_equal_posteriors(copy.deepcopy(posterior), posterior)


def test_a_posterior_that_absorbed_is_equal_up_to_rounding(prior: dgpc.Prior, events, message) -> None:
    x, y = events
    posterior = dgpc.fit(prior, x[:20], y[:20]).posterior()
    posterior = posterior.absorb_summaries([message.under(prior)]).absorb_events(dgpc.fit(prior, x[20:30], y[20:30]).sites)
    posterior, _ = posterior.absorb_observations(x[30:], y[30:])
    assert_equal_posteriors(again(posterior), posterior, atol=1e-12)
    assert_equal_posteriors(again(posterior).absorb_summaries([]), posterior, atol=1e-12)


def test_sites_of_expectation_propagation_keep_their_bits(prior: dgpc.Prior, events) -> None:
    sites = dgpc.fit(prior, *events).propagated().sites
    np.testing.assert_array_equal(again(sites).kappa, sites.kappa)
    np.testing.assert_array_equal(again(sites).omega, sites.omega)
    np.testing.assert_array_equal(again(sites).x, sites.x)


def numbers(fit: dgpc.Fit) -> np.ndarray:
    return np.concatenate([fit.mean, fit.variance, fit.omega, fit.tilts, [fit.evidence, fit.corrected_evidence]])


@pytest.mark.parametrize("options", [{}, {"inducing_points": 9}, {"iterations_max": 2}, {"tolerance": 0.0}])
@pytest.mark.parametrize("has_message", [False, True])
def test_a_fit_is_equal_up_to_rounding_or_its_change(prior, events, message, options, has_message) -> None:
    messages = [message] if has_message else []
    fit = dgpc.fit(prior, *events, weights=np.linspace(0.5, 2.0, 40), messages=messages, **options)
    found = again(fit)
    np.testing.assert_allclose(numbers(found), numbers(fit), rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(found.weights, fit.weights)
    assert found.prior == fit.prior and len(found) == len(fit) and found.jitter == fit.jitter
    assert (found.iterations, found.change, found.stop) == (fit.iterations, fit.change, fit.stop)
    assert_equal_posteriors(found.posterior(), fit.posterior(), atol=1e-12)
    assert_equal_posteriors(found.posterior([]), fit.posterior([]), atol=1e-12)
    assert again(found).converged == fit.converged


def test_a_sparse_fit_that_stopped_early_differs_by_about_its_change(prior: dgpc.Prior, events) -> None:
    fit = dgpc.fit(prior, *events, inducing_points=9, iterations_max=3)
    found = again(fit)
    np.testing.assert_allclose(found.tilts, fit.tilts, rtol=0.0, atol=2.0 * fit.change)
    assert (found.iterations, found.change, found.stop) == (3, fit.change, "iterations_max")


def test_a_learned_fit_can_be_pickled(prior: dgpc.Prior, events, message) -> None:
    learned = dgpc.learn(prior, *events, messages=[message])
    found = again(learned.fit)
    assert_equal_posteriors(found.posterior(), learned.fit.posterior(), atol=10.0 * learned.fit.change + 1e-12)


def test_terms_kernels_and_learned_priors_are_rebuilt_from_the_prior(prior: dgpc.Prior, events, tmp_path) -> None:
    learned = dgpc.learn(prior, *events)
    for one in (prior.kernel, prior.kernel.terms[0], learned, dgpc.Candidates(prior, events[0])):
        with pytest.raises(TypeError, match="cannot pickle"):
            pickle.dumps(one)
    assert again(prior).kernel == prior.kernel and again(prior).kernel.terms[0] == prior.kernel.terms[0]
    assert again(learned.prior) == learned.prior
    paths = dgpc.sharded.write_shards(tmp_path, *events, shards=2)
    found = dgpc.sharded.learn(prior, paths, seed=1)
    parts = again(tuple(found[:3]))
    assert parts[0] == found.prior and parts[1].evidence == found.fit.evidence


def test_an_amended_fit_is_refused(prior: dgpc.Prior, events) -> None:
    amended = dgpc.fit(prior, *events, inducing_points=9).amended([0], [[0.0, 0.0]], [1])
    assert amended is not None
    with pytest.raises(TypeError, match="an amended fit cannot be pickled"):
        pickle.dumps(amended)
    assert_equal_posteriors(again(amended.posterior()), amended.posterior())


def test_fits_travel_between_processes(prior: dgpc.Prior, events) -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        fit = processes.submit(dgpc.fit, prior, *events).result()
        posterior = processes.submit(dgpc.Fit.posterior, fit).result()
    assert_equal_posteriors(posterior, dgpc.fit(prior, *events).posterior(), atol=1e-12)


@pytest.mark.parametrize("kind", ["Fit", "Posterior", "Sites"])
def test_damaged_foreign_and_newer_bytes_are_refused(prior: dgpc.Prior, events, kind: str) -> None:
    fit = dgpc.fit(prior, events[0][:3], events[1][:3])
    data = {"Fit": fit, "Posterior": fit.posterior(), "Sites": fit.sites}[kind].to_bytes()
    read = getattr(dgpc, kind).from_bytes
    for place in range(len(data)):
        with pytest.raises(ValueError, match="dgpc|version|damaged"):
            read(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        with pytest.raises(ValueError, match="dgpc|incomplete|damaged"):
            read(data[:place])
    with pytest.raises(ValueError, match="damaged"):
        read(prior.to_bytes())
    with pytest.raises(ValueError, match="these bytes have version 2; this package reads versions up to 1"):
        read(data[:4] + bytes([2]) + data[5:])
