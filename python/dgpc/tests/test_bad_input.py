"""Every bad argument raises an exception with a message. No panic crosses the border."""

import contextlib
import inspect

import dgpc
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

ACCEPTED = (ValueError, TypeError, MemoryError, dgpc.Error)

X = np.random.default_rng(1).normal(size=(12, 2))
Y = X[:, 0] > 0
OMEGA = np.full(12, 0.2)
PRIOR = dgpc.Prior(dgpc.Term("matern52", 0.8, variance=2.0, dimension=2))
SITES = dgpc.Sites(X, Y, OMEGA)
FIT = dgpc.fit(PRIOR, X, Y)
SPARSE = dgpc.fit(PRIOR, X, Y, inducing_points=4)
POSTERIOR = FIT.posterior()
SUMMARY = POSTERIOR.summarise(X[:3])
CANDIDATES = dgpc.Candidates(PRIOR, X)

# For every function: what it needs, as arguments by position. Each is replaced by bad values in turn.
CALLS = {
    "Term": (lambda *a: dgpc.Term("matern52", a[0], columns=a[1], ties=a[2]), [0.5, 1.0], [0, 1], [0, 1]),
    "Term.variance": (lambda *a: dgpc.Term(a[0], variance=a[1], dimension=a[2]), "matern32", 1.0, 2),
    "Term.reciprocal": (lambda *a: dgpc.Term("matern32", dimension=4).reciprocal([(0, a[0])], [a[1]]), 2, 3),
    "Term.reciprocity": (lambda a: dgpc.Term("matern32", dimension=2).reciprocal([(0, 1)], reciprocity=a), 0.5),
    "Term.mul": (lambda a: a * dgpc.Term("matern32", dimension=2), 2.0),
    "RangeMean": (dgpc.RangeMean, 1.0, 2.0, [0], [1]),
    "Prior": (dgpc.Prior, PRIOR.kernel, 0.5),
    "Prior.with_parameters": (PRIOR.with_parameters, PRIOR.parameter_values),
    "Prior.from_json": (dgpc.Prior.from_json, PRIOR.to_json()),
    "Prior.from_bytes": (dgpc.Prior.from_bytes, PRIOR.to_bytes()),
    "Prior.mean_at": (PRIOR.mean_at, X),
    "gram": (PRIOR.kernel.gram, X),
    "cross": (PRIOR.kernel.cross, X, X),
    "diagonal": (PRIOR.kernel.diagonal, X),
    "Sites": (dgpc.Sites, X, Y, OMEGA, OMEGA),
    "Sites.select": (SITES.select, [0, 1]),
    "fit": (lambda *a: dgpc.fit(PRIOR, a[0], a[1], weights=a[2], start=a[3]), X, Y, OMEGA, OMEGA),
    "fit.sparse": (lambda *a: dgpc.fit(PRIOR, a[0], a[1], inducing_points=a[2]), X, Y, X[:3]),
    "fit.count": (lambda a: dgpc.fit(PRIOR, X, Y, inducing_points=a), 3),
    "fit.options": (lambda *a: dgpc.fit(PRIOR, X, Y, tolerance=a[0], iterations_max=a[1]), 1e-6, 20),
    "fit.messages": (lambda a: dgpc.fit(PRIOR, X, Y, messages=a), [SUMMARY]),
    "evidence": (lambda *a: dgpc.evidence(PRIOR, a[0], a[1], weights=a[2]), X, Y, OMEGA),
    "learn": (lambda *a: dgpc.learn(PRIOR, a[0], a[1], weights=a[2], start=a[3]), X, Y, OMEGA, OMEGA),
    "learn.counts": (
        lambda *a: dgpc.learn(PRIOR, X, Y, start_events_max=a[0], race_events_max=a[1], search_events_max=a[2]),
        *(5, 5, 5),
    ),
    "learn.sparse": (
        lambda *a: dgpc.learn(PRIOR, X, Y, dense_events_max=a[0], inducing_points_max=a[1], iterations_max=a[2]),
        *(5, 5, 5),
    ),
    "learn.tolerance": (lambda a: dgpc.learn(PRIOR, X, Y, tolerance=a), 1e-5),
    "learn.hyper_prior": (lambda a: dgpc.learn(PRIOR, X, Y, hyper_prior={"variance": a}), 1.0),
    "gibbs": (lambda *a: dgpc.gibbs(PRIOR, a[0], a[1], a[2], seed=a[3], warm_up=2), X, Y, 2, 1),
    "gibbs.weights": (lambda *a: dgpc.gibbs(PRIOR, X, Y, 2, seed=1, weights=a[0]), np.ones(12)),
    "effective_sample_size": (dgpc.effective_sample_size, OMEGA),
    "polya_gamma": (lambda *a: dgpc.polya_gamma(a[0], a[1], seed=a[2]), 1, OMEGA, 1),
    "polya_gamma_moments": (dgpc.polya_gamma_moments, 1.0, OMEGA),
    "success_probability": (dgpc.success_probability, OMEGA, OMEGA),
    "Posterior": (lambda a: dgpc.Posterior(PRIOR, dimension=a), 2),
    "Posterior.summaries": (lambda a: dgpc.Posterior(PRIOR, SITES, a), [SUMMARY]),
    "Posterior.latent": (POSTERIOR.latent, X),
    "Posterior.probability": (POSTERIOR.probability, X),
    "Posterior.joint": (POSTERIOR.joint, X),
    "Posterior.draws": (lambda *a: POSTERIOR.draws(a[0], a[1], seed=a[2]), X, 2, 1),
    "Posterior.summarise": (POSTERIOR.summarise, X[:3]),
    "Posterior.residual": (POSTERIOR.residual, POSTERIOR, X[:3]),
    "Posterior.absorb_observations": (POSTERIOR.absorb_observations, X, Y, OMEGA),
    "Posterior.sites_given": (POSTERIOR.sites_given, X, Y, OMEGA),
    "Posterior.contradiction": (lambda *a: POSTERIOR.contradiction(a[0], a[1], offset_sd=a[2]), X, Y, 0.1),
    "Shift.largest": (POSTERIOR.shift_by([SUMMARY]).largest, 0.1),
    "Fit.posterior_of_part": (FIT.posterior_of_part, [0, 3]),
    "Fit.posterior_of_part.sparse": (SPARSE.posterior_of_part, [0, 3]),
    "Fit.amended": (SPARSE.amended, [0, 1], X, Y, OMEGA),
    "Fit.latent_at_events": (FIT.latent_at_events, X),
    "Summary.empty": (dgpc.Summary.empty, PRIOR, X[:3]),
    "Summary.marginal": (dgpc.Summary.marginal, PRIOR, SITES, X[:3]),
    "Summary.variational": (dgpc.Summary.variational, PRIOR, SITES, X[:3]),
    "Summary.from_whitened": (dgpc.Summary.from_whitened, PRIOR, X[:3], np.eye(3), np.ones(3)),
    "Summary.from_factor": (dgpc.Summary.from_factor, PRIOR, X[:3], np.eye(3), np.ones(3)),
    "Summary.from_bytes": (dgpc.Summary.from_bytes, SUMMARY.to_bytes()),
    "Summary.tempered": (SUMMARY.tempered, 0.5),
    "Candidates": (dgpc.Candidates, PRIOR, X, X[:2]),
    "Candidates.minimise_trace": (CANDIDATES.minimise_trace, 3),
    "Candidates.maximise_trace": (CANDIDATES.maximise_trace, 3),
    "Candidates.greedy": (CANDIDATES.greedy, 3),
    "Candidates.random": (lambda *a: CANDIDATES.random(a[0], seed=a[1]), 3, 1),
    "Candidates.distinct": (CANDIDATES.distinct, 1e-4),
    "Candidates.condition_on": (CANDIDATES.condition_on, [0, 1]),
    "greedy_by_variance": (dgpc.greedy_by_variance, PRIOR, X, 3),
    "greedy_judged": (dgpc.greedy_judged, PRIOR, X, 3, 5),
    "Certificate": (dgpc.Certificate, PRIOR, SITES, X[:3]),
    "region_around": (lambda *a: dgpc.region_around(a[0], a[1], a[2], count_max=a[3]), X, X[0], 1.0, 2),
    "busiest_region": (lambda *a: dgpc.busiest_region(a[0], a[1], count_max=a[2]), X, 1.0, 2),
}

BAD = {
    "nan": np.nan,
    "inf": np.inf,
    "huge": 1e308,
    "tiny": 5e-324,
    "zero": 0,
    "one": 1,
    "minus one": -1,
    "half": 0.5,
    "large count": 2**62,
    "larger count": 2**64,
    "negative count": -(2**70),
    "true": True,
    "none": None,
    "text": "text",
    "empty text": "",
    "bytes": b"dgpc\x01damaged",
    "object": object(),
    "complex": 1j,
    "list": [],
    "ragged": [[0.0], [0.0, 1.0]],
    "list of text": ["a", "b"],
    "list of none": [None, None],
    "dictionary": {"a": 1},
    "no dimensions": np.array(1.0),
    "empty": np.empty(0),
    "no rows": np.empty((0, 2)),
    "no columns": np.empty((12, 0)),
    "no rows or columns": np.empty((0, 0)),
    "one column": np.ones((12, 1)),
    "three columns": np.ones((12, 3)),
    "three dimensions": np.ones((12, 2, 2)),
    "zeros": np.zeros(12),
    "ones": np.ones(12),
    "twos": np.full(12, 2.0),
    "minus ones": -np.ones(12),
    "halves": np.full(12, 0.5),
    "too few": np.ones(5),
    "too many": np.ones(500),
    "nan inside": np.array([[np.nan, 1.0]] * 12),
    "inf inside": np.array([[np.inf, 1.0]] * 12),
    "infinite numbers": np.full(12, np.inf),
    "no numbers": np.full(12, np.nan),
    "huge rows": np.full((12, 2), 1e308),
    "huge numbers": np.full(12, 1e308),
    "tiny numbers": np.full(12, 5e-324),
    "equal rows": np.zeros((12, 2)),
    "indices out of range": np.array([0, 1, 12]),
    "negative indices": np.array([-1, 0]),
    "repeated indices": np.array([3, 3, 3]),
    "huge indices": np.array([2**63 - 1]),
    "objects": np.array([object()] * 12),
    "texts": np.array(["a"] * 12),
    "complex numbers": np.ones((12, 2), dtype=complex),
    "dates": np.array(["2020-01-01"] * 12, dtype="datetime64[D]"),
    "structure": np.zeros(12, dtype=[("a", float), ("b", float)]),
    "masked": np.ma.masked_array(np.ones((12, 2)), mask=True),
    "square": np.eye(3),
    "negative definite": -np.eye(3),
    "not symmetric": np.triu(np.ones((3, 3))),
    "huge square": np.full((3, 3), 1e308),
    "summaries": [SUMMARY, SUMMARY],
    "posterior": POSTERIOR,
}


#: Ranges of results and attributes by the last part of their names.
RANGES = {
    "probability": (0.0, 1.0),
    "success_probability": (0.0, 1.0),
    "reciprocity": (0.0, 1.0),
    "effective_sample_size": (0.0, np.inf),
    **dict.fromkeys(["variance", "diagonal", "omega", "trace", "jitter", "change", "radius", "gap"], (0.0, np.inf)),
}


def assert_right(result: object, name: str = "") -> None:
    """Checks all numbers of a result: they are finite and in the range of their names, and indices are distinct."""
    if isinstance(result, dict):
        for key, part in result.items():
            assert_right(part, key)
    elif isinstance(result, (tuple, list)):
        names = ["mean", "variance"] if name == "latent" else [""] * len(result)
        for key, part in zip(names, result):
            assert_right(part, key)
    elif isinstance(result, dgpc.Summary):
        # Precisions near the largest number overflow. A posterior of such a summary raises an error.
        with contextlib.suppress(dgpc.Error):
            assert_right(dgpc.Posterior(result.prior, summaries=[result]).latent(result.points), "latent")
    elif type(result).__module__ == "dgpc":
        for key, attribute in vars(type(result)).items():
            if inspect.isgetsetdescriptor(attribute):
                assert_right(getattr(result, key), key)
        if isinstance(result, dgpc.Posterior) and result.prior == PRIOR and len(result) > 0:
            assert_right(result.latent(X), "latent")
    elif isinstance(result, float) or (isinstance(result, np.ndarray) and result.dtype.kind == "f"):
        numbers, (low, high) = np.asarray(result), RANGES.get(name, (-np.inf, np.inf))
        assert np.isfinite(numbers).all() and (low <= numbers).all() and (numbers <= high).all(), name
    elif isinstance(result, np.ndarray) and result.dtype.kind == "i":
        assert len(np.unique(result)) == len(result) and (result >= 0).all(), name


@pytest.mark.parametrize("name", CALLS)
def test_a_bad_argument_raises_an_exception_or_gives_right_numbers(name: str) -> None:
    call, *good = CALLS[name]
    last = name.split(".")[-1]
    assert_right(call(*good), last)
    for place in range(len(good)):
        for kind, bad in BAD.items():
            arguments = [*good[:place], bad, *good[place + 1 :]]
            try:
                result = call(*arguments)
            except ACCEPTED as error:
                assert str(error), (name, place, kind)
            except BaseException as error:
                pytest.fail(f"{name}, argument {place}, {kind}: {error!r}")
            else:
                try:
                    assert_right(result, last)
                except BaseException as error:
                    pytest.fail(f"{name}, argument {place}, {kind}: {error!r}")


@settings(deadline=None, max_examples=300, derandomize=True)
@given(st.data())
def test_random_numbers_of_any_size_cause_no_panic(data: st.DataObject) -> None:
    count = data.draw(st.integers(0, 6))
    numbers = st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from([0.0, -0.0, 1.0, 1e-300, 1e300])
    x = np.array(data.draw(st.lists(st.tuples(numbers, numbers), min_size=count, max_size=count))).reshape(-1, 2)
    y = np.array(data.draw(st.lists(st.booleans(), min_size=count, max_size=count)), dtype=bool)
    weights = np.array(data.draw(st.lists(numbers, min_size=count, max_size=count)))
    scale, variance, mean = data.draw(numbers), data.draw(numbers), data.draw(numbers)
    shape = data.draw(st.sampled_from(["squared-exponential", "matern12", "rational-quadratic:2", "label"]))
    try:
        prior = dgpc.Prior(dgpc.Term(shape, abs(scale), variance=abs(variance), dimension=2), mean)
        fit = dgpc.fit(prior, x, y, weights=abs(weights), inducing_points=data.draw(st.sampled_from([None, x[:3], 2])))
        assert_right({"mean": fit.mean, "variance": fit.variance, "latent": fit.posterior().latent(x)})
        assert_right(fit.leave_one_out())
        dgpc.evidence(prior, x, y)
        dgpc.learn(prior, x, y, iterations_max=3)
        dgpc.Certificate(prior, fit.sites, x[:2])
        dgpc.Candidates(prior, x).minimise_trace(2)
        fit.propagated()
        dgpc.gibbs(prior, x, y, 2, seed=1)
    except ACCEPTED:
        pass


def test_messages_name_the_argument_and_the_place() -> None:
    bad = X.copy()
    bad[3, 1] = np.nan
    with pytest.raises(ValueError, match="input must be finite, found NaN at row 3, column 1") as caught:
        dgpc.fit(PRIOR, bad, Y)
    assert not hasattr(caught.value, "__notes__") or "'x'" in caught.value.__notes__[0]
    with pytest.raises(ValueError, match="outcomes must be 0 or 1, found 2 at place 0"):
        dgpc.fit(PRIOR, X, np.full(12, 2))
    with pytest.raises(ValueError, match="outcomes, one per input: expected 12, found 5"):
        dgpc.fit(PRIOR, X, Y[:5])
    with pytest.raises(ValueError, match="masked"):
        dgpc.fit(PRIOR, np.ma.masked_array(X, mask=False), Y)


def test_a_computation_that_fails_raises_the_error_of_the_package() -> None:
    wide = dgpc.Prior(dgpc.Term("squared-exponential", 1e-3, variance=1e308, dimension=2))
    with pytest.raises(dgpc.Error, match="finite|definite"):
        dgpc.Posterior(wide, dgpc.Sites(X, Y, np.full(12, 1e300)))
    assert issubclass(dgpc.Error, RuntimeError)


def test_a_matrix_that_is_too_large_raises_a_memory_error() -> None:
    kernel = dgpc.Kernel([dgpc.Term("matern32", columns=[0])])
    with pytest.raises(MemoryError, match="10000000 × 10000000 numbers"):
        kernel.gram(np.zeros((10_000_000, 1)))


def test_one_outcome_is_no_error_for_functions() -> None:
    assert (dgpc.fit(PRIOR, X, np.ones(12)).mean > 0).all()


def test_more_inducing_points_than_events_are_reduced() -> None:
    fit = dgpc.fit(PRIOR, X, Y, inducing_points=100)
    assert fit.inducing_points is not None and len(fit.inducing_points) == 12
    np.testing.assert_allclose(fit.mean, FIT.mean, atol=1e-6)


def test_equal_inducing_points_give_the_fit_of_distinct_ones() -> None:
    twice = dgpc.fit(PRIOR, X, Y, inducing_points=np.concatenate([X[:4], X[:4]]))
    once = dgpc.fit(PRIOR, X, Y, inducing_points=X[:4])
    np.testing.assert_allclose(twice.mean, once.mean, atol=1e-4)
    assert twice.jitter > 0
