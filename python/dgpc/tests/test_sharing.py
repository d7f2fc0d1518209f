"""Summaries and posteriors of several agents."""

import copy
import pickle

import dgpc
import numpy as np
import pytest


@pytest.fixture
def sites(prior: dgpc.Prior, events) -> dgpc.Sites:
    return dgpc.fit(prior, *events).sites


def test_a_summary_at_all_events_is_the_posterior(prior: dgpc.Prior, events, sites) -> None:
    full = dgpc.Posterior(prior, sites)
    received = dgpc.Posterior(prior, summaries=[dgpc.Summary.variational(prior, sites, events[0])])
    places = np.array([[0.0, 0.5], [4.0, 4.0]])
    for found, expected in zip(received.latent(places), full.latent(places), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_variational_summaries_add_up_over_events(prior: dgpc.Prior, events, sites) -> None:
    points, first, second = events[0][:3], sites.select(np.arange(15)), sites.select(np.arange(15, 40))
    whole = dgpc.Summary.variational(prior, sites, points)
    parts = [dgpc.Summary.variational(prior, part, points) for part in (first, second)]
    np.testing.assert_allclose((parts[0] + parts[1]).precision, whole.precision, rtol=1e-10)
    np.testing.assert_allclose((whole - parts[0]).shift, parts[1].shift, atol=1e-9)
    np.testing.assert_allclose(parts[0].observe(second).shift, whole.shift, atol=1e-9)
    np.testing.assert_allclose(whole.forget(second).precision, parts[0].precision, atol=1e-8)
    with pytest.raises(ValueError, match="same inducing points"):
        whole + dgpc.Summary.variational(prior, sites, events[0][:2])


def test_no_method_changes_its_object(prior: dgpc.Prior, events, sites) -> None:
    posterior, summary = dgpc.Posterior(prior, sites), dgpc.Summary.empty(prior, events[0][:3])
    before = posterior.latent(events[0])
    assert len(posterior.absorb_summaries([posterior.summarise(events[0][:3])])) == 43 and len(posterior) == 40
    larger, new = posterior.absorb_observations(events[0][:2], events[1][:2])
    assert (len(larger), len(new)) == (42, 2)
    assert (summary.observe(sites).shift != 0).any() and (summary.shift == 0).all()
    np.testing.assert_array_equal(posterior.latent(events[0]), before)


def test_a_residual_tells_the_receiver_what_it_lacks(prior: dgpc.Prior, events, sites) -> None:
    own, known = dgpc.Posterior(prior, sites), dgpc.Posterior(prior, sites.select(np.arange(20)))
    points = events[0][20:23]
    after = known.absorb_summaries([own.residual(known, points)])
    np.testing.assert_allclose(after.latent(points)[0], own.latent(points)[0], atol=1e-6)
    candidates = dgpc.Candidates.for_residual(known, own, events[0])
    assert len(candidates.greedy(2)) == 2


def test_factors_do_not_depend_on_the_prior(prior: dgpc.Prior, events, sites) -> None:
    summary = dgpc.Summary.marginal(prior, sites, events[0][:3])
    precision, shift = summary.factor()
    other = prior.with_parameters(prior.parameter_values + 0.3)
    read = dgpc.Summary.from_factor(other, summary.points, precision, shift)
    np.testing.assert_allclose(read.whitened_precision, summary.under(other).whitened_precision, atol=1e-6)
    whitened = (prior, summary.points, summary.whitened_precision, summary.whitened_shift)
    np.testing.assert_array_equal(dgpc.Summary.from_whitened(*whitened).shift, summary.shift)
    with pytest.raises(ValueError, match="different priors"):
        dgpc.Posterior(other, summaries=[summary])


def test_bytes_and_pickles_give_equal_objects(prior: dgpc.Prior, events, sites) -> None:
    summary = dgpc.Summary.marginal(prior, sites, events[0][:3])
    link = dgpc.Term("rational-quadratic:1.7", 0.3, dimension=4).reciprocal([(0, 2)], [1, 3], reciprocity=0.4)
    priors = [prior, dgpc.Prior(link, dgpc.RangeMean(1.0, 0.1, [0, 1], [2, 3])), dgpc.Prior(link)]
    for one in priors:
        assert pickle.loads(pickle.dumps(one)) == copy.deepcopy(one) == one == dgpc.Prior.from_json(one.to_json())
    for again in [pickle.loads(pickle.dumps(summary)), dgpc.Summary.from_bytes(summary.to_bytes())]:
        assert again.prior == prior
        np.testing.assert_array_equal(again.whitened_precision, summary.whitened_precision)
        np.testing.assert_array_equal(again.whitened_shift, summary.whitened_shift)
    again = pickle.loads(pickle.dumps(sites))
    np.testing.assert_array_equal(again.kappa, sites.kappa)
    np.testing.assert_array_equal(again.omega, sites.omega)


def test_damaged_foreign_and_newer_bytes_are_refused(prior: dgpc.Prior, events, sites) -> None:
    data = dgpc.Summary.marginal(prior, sites, events[0][:3]).to_bytes()
    for place in range(len(data)):
        damaged = data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]
        with pytest.raises(ValueError, match="dgpc|version|damaged"):
            dgpc.Summary.from_bytes(damaged)
    for end in range(len(data)):
        with pytest.raises(ValueError, match="dgpc|incomplete|damaged"):
            dgpc.Summary.from_bytes(data[:end])
    with pytest.raises(ValueError, match="this package reads versions up to 1"):
        dgpc.Summary.from_bytes(data[:4] + b"\x02" + data[5:])
    with pytest.raises(ValueError, match="damaged"):
        dgpc.Summary.from_bytes(prior.to_bytes())


def test_a_sparse_fit_is_amended_without_a_new_fit(prior: dgpc.Prior, events) -> None:
    x, y = events
    fit = dgpc.fit(prior, x[:30], y[:30], inducing_points=8)
    amended = fit.amended([0, 1], x[30:], y[30:])
    assert amended is not None and len(amended) == 38
    assert dgpc.fit(prior, x, y).amended([0], x[:1], y[:1]) is None
    part = fit.posterior_of_part(np.arange(10))
    assert (part.latent(x[:30])[1] > fit.posterior().latent(x[:30])[1] - 1e-9).all()


def test_contradicting_outcomes_stand_out(prior: dgpc.Prior, events, sites) -> None:
    posterior = dgpc.Posterior(prior, sites)
    assert posterior.contradiction(*events) < 2.0 < posterior.contradiction(events[0], ~events[1])
    message = posterior.summarise(events[0][:2])
    assert dgpc.Posterior(prior, dimension=2).shift_by([message]).largest() >= 0.0


def test_regions_hold_the_inputs_within_their_radius(events) -> None:
    x = events[0]
    region = dgpc.region_around(x, [0.0, 0.0], 1.0)
    np.testing.assert_array_equal(region.members, np.flatnonzero(np.hypot(*x.T) <= 1.0))
    assert len(dgpc.region_around(x, [0.0, 0.0], 1.0, count_max=3).members) == 3
    busiest = dgpc.busiest_region(x, 1.0)
    assert busiest is not None and len(busiest.members) >= len(region.members)
    assert dgpc.busiest_region(np.empty((0, 2)), 1.0) is None


def test_selections_agree_with_the_trace_by_dense_formulas(prior: dgpc.Prior, events) -> None:
    x = events[0]
    candidates, gram = dgpc.Candidates(prior, x), prior.kernel.gram(x)
    good, bad, drawn = candidates.minimise_trace(3), candidates.maximise_trace(3), candidates.random(3, seed=1)
    for selection in (good, bad, drawn, dgpc.greedy_by_variance(prior, x, 3), dgpc.greedy_judged(prior, x, 3)):
        chosen = selection.indices
        explained = gram[:, chosen] @ np.linalg.solve(gram[np.ix_(chosen, chosen)], gram[chosen])
        assert selection.trace == pytest.approx(np.trace(gram - explained), rel=1e-8)
    assert good.trace < drawn.trace < bad.trace
    assert candidates.condition_on(good.indices).trace == pytest.approx(good.trace, rel=1e-8)
    assert dgpc.Candidates(prior, x, x[good.indices]).trace == pytest.approx(good.trace, rel=1e-6)


def test_expectation_propagation_uses_the_messages_of_the_fit(prior: dgpc.Prior, events, sites) -> None:
    x, y = events
    message = dgpc.Posterior(prior, sites).summarise(np.array([[3.0, 3.0], [-3.0, 3.0]]))
    fit = dgpc.fit(prior, x[:5], y[:5], messages=[message])
    place = np.array([[3.0, 3.0]])
    variances = [fit.propagated(*given).posterior().latent(place)[1][0] for given in ([], [[message]], [[]])]
    assert variances[0] == variances[1] < variances[2]


def test_predictions_in_parts_have_the_bits_of_one_part(prior: dgpc.Prior) -> None:
    random = np.random.default_rng(3)
    x = random.normal(size=(1200, 2))
    posterior = dgpc.fit(prior, x, x[:, 0] > 0, iterations_max=2).posterior()
    # 2983 points fill one part: 2^32 multiply-adds, in whole blocks of 256.
    places = random.normal(size=(7000, 2))
    mean, variance = posterior.latent(places)
    pieces = [posterior.latent(places[first : first + 2560]) for first in range(0, 7000, 2560)]
    assert (mean == np.concatenate([piece[0] for piece in pieces])).all()
    assert (variance == np.concatenate([piece[1] for piece in pieces])).all()
    assert (posterior.probability(places) == dgpc.success_probability(mean, variance)).all()
