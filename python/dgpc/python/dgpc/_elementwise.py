"""Functions of single numbers, which broadcast their arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _dgpc


def has_masked_values(values: Any) -> bool:
    """Returns whether these are an array of NumPy with masked values."""
    # Some versions of NumPy do not declare the types of this module.
    masked: Any = np.ma
    return isinstance(values, np.ma.MaskedArray) and bool(masked.is_masked(values))


def _flat(*arguments: ArrayLike) -> tuple[tuple[int, ...], list[NDArray[np.generic]]]:
    """Returns the common shape of the arguments, and each argument in one dimension."""
    if any(map(has_masked_values, arguments)):
        raise ValueError("masked values are not supported")
    arrays = np.broadcast_arrays(*(np.asarray(argument) for argument in arguments))
    return arrays[0].shape, [array.reshape(-1) for array in arrays]


def polya_gamma(shape: ArrayLike, tilt: ArrayLike, *, seed: int) -> NDArray[np.float64]:
    """Draws from Pólya-Gamma distributions PG(shape, tilt), exactly.

    Parameters
    ----------
    shape : array of int
        From 1 to a million. A draw costs time in proportion to it.
    tilt : array of float
        The two arrays are broadcast.
    seed : int
        Equal seeds give equal draws.

    Returns
    -------
    array

    Examples
    --------
    >>> import dgpc, numpy as np
    >>> dgpc.polya_gamma(1, np.zeros(1000), seed=1).mean().round(1)
    np.float64(0.2)
    """
    common, (shapes, tilts) = _flat(shape, tilt)
    return _dgpc.polya_gamma_draws(shapes, tilts, seed).reshape(common)


def polya_gamma_moments(shape: ArrayLike, tilt: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the means and the variances of Pólya-Gamma distributions PG(shape, tilt).

    Parameters
    ----------
    shape : array of float
        Positive.
    tilt : array of float
        The two arrays are broadcast.

    Returns
    -------
    mean, variance : arrays

    Examples
    --------
    >>> import dgpc
    >>> mean, variance = dgpc.polya_gamma_moments(1.0, 0.0)
    >>> float(mean)
    0.25
    """
    common, (shapes, tilts) = _flat(shape, tilt)
    mean, variance = _dgpc.polya_gamma_moments(shapes, tilts)
    return mean.reshape(common), variance.reshape(common)


def success_probability(mean: ArrayLike, variance: ArrayLike) -> NDArray[np.float64]:
    """Returns the probability of success for a normal latent function: the mean of its logistic function.

    The absolute error is below 3e-9.

    Parameters
    ----------
    mean : array of float
        Mean of the log-odds.
    variance : array of float
        Variance of the log-odds, at least 0. The two arrays are broadcast.

    Returns
    -------
    array

    Examples
    --------
    >>> import dgpc
    >>> dgpc.success_probability([0.0, 2.0], 4.0).round(3)
    array([0.5  , 0.775])
    """
    common, (means, variances) = _flat(mean, variance)
    return _dgpc.success_probabilities(means, variances).reshape(common)
