"""Options are checked, and count as documented."""

from collections.abc import Callable
from types import MappingProxyType

import dgpc
import numpy as np
import pytest

X = np.random.default_rng(1).normal(size=(12, 2))
Y = X[:, 0] > 0
PRIOR = dgpc.Prior(dgpc.Term("matern52", 0.8, variance=2.0, dimension=2))
FIT = dgpc.fit(PRIOR, X, Y)
POSTERIOR = FIT.posterior()
SUMMARY = POSTERIOR.summarise(X[:3])
SHIFT = dgpc.Posterior(PRIOR, dimension=2).shift_by([SUMMARY])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -3.0, 3.0])
@pytest.mark.parametrize("use", [SUMMARY.tempered, dgpc.Candidates(PRIOR, X).distinct])
def test_a_share_lies_between_0_and_1(use: Callable[[float], object], bad: float) -> None:
    with pytest.raises(ValueError, match="a share from 0 to 1, found"):
        use(bad)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -3.0])
@pytest.mark.parametrize(
    "use", [SHIFT.largest, lambda offset_sd: POSTERIOR.contradiction(X, Y, offset_sd=offset_sd)], ids=["shift", "outcomes"]
)
def test_a_standard_deviation_is_finite_and_not_negative(use: Callable[[float], object], bad: float) -> None:
    with pytest.raises(ValueError, match="a finite standard deviation, at least 0, found"):
        use(bad)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_the_divergence_of_a_certificate_needs_a_finite_evidence(bad: float) -> None:
    with pytest.raises(ValueError, match="a finite number, found"):
        dgpc.Certificate(PRIOR, FIT.sites, X[:3]).divergence(bad)


@pytest.mark.parametrize("bad", [(np.nan, 10.0), (0.1, np.inf), (0.1,), (0.1, 1.0, 2.0), "free", 1.0])
def test_bounds_are_pairs_of_finite_numbers(bad: object) -> None:
    with pytest.raises(ValueError, match='None, "fixed" or a pair of finite numbers'):
        dgpc.learn(PRIOR, X, Y, bounds=[bad, None])  # type: ignore[list-item]


def test_any_sequence_of_two_numbers_is_a_pair_of_bounds() -> None:
    pairs = [[(1.0, 2.0), None], [[1.0, 2.0], None], [np.array([1.0, 2.0]), None]]
    variances = [dgpc.learn(PRIOR, X, Y, bounds=bounds).prior.parameter_values for bounds in pairs]
    assert all((values == variances[0]).all() for values in variances)


def test_a_hyperprior_is_any_mapping() -> None:
    deviations = {"length_scale": 0.0}
    learned = [dgpc.learn(PRIOR, X, Y, hyper_prior=given).prior for given in (deviations, MappingProxyType(deviations))]
    assert learned[0] == learned[1]
    with pytest.raises(TypeError):
        dgpc.learn(PRIOR, X, Y, hyper_prior=[("length_scale", 0.0)])  # type: ignore[arg-type]


@pytest.mark.parametrize("width", [1, 3])
def test_points_have_the_columns_of_the_events(width: int) -> None:
    other = np.ones((4, width))
    concatenation = dgpc.Concatenation(PRIOR, [SUMMARY])
    for use in (POSTERIOR.latent, POSTERIOR.probability, POSTERIOR.joint, concatenation.latent):
        with pytest.raises(ValueError, match=f"expected 2, found {width}"):
            use(other)
    with pytest.raises(ValueError, match="expected sites of 7 columns, found 2"):
        dgpc.Posterior(PRIOR, FIT.sites, dimension=7)
