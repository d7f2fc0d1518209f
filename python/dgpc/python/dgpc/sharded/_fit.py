"""Fits of events in shards."""

from __future__ import annotations

import builtins
import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._dgpc import Posterior, Prior, Shard, ShardedFit, Summary
from ._files import Map, answers, distinct, naming, opened

#: Largest number of covariances that one process keeps, 59 MB, even if it has all shards.
COVARIANCES_MAX = 7 << 20


class FittedShards(NamedTuple):
    """A sparse fit of events in shards.

    Examples
    --------
        >>> import dgpc, tempfile
        >>> from dgpc.sharded import fit, write_shards
        >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, dimension=1))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = fit(prior, write_shards(folder, [[0.0], [1.0]], [0, 1], shards=1), [[0.5]])
        >>> found.stop, found.evidence < 0, len(found.gradient) == len(prior.parameters)
        ('converged', True, True)
    """

    posterior: Posterior
    """The posterior of all events and messages."""
    summary: Summary
    """The summary of the events at the inducing points."""
    evidence: float
    """The evidence bound, in nats."""
    gradient: NDArray[np.float64]
    """Its derivative by each of ``Prior.parameter_values``."""
    iterations: int
    change: float
    """Largest change of a tilt in the last iteration."""
    stop: str
    """The reason why the iteration ended, as ``Fit.stop``."""
    request_bytes: int
    """Bytes that each shard received in the last iteration."""
    contribution_bytes: int
    """Bytes that each shard sent in the last iteration."""


def fit(
    prior: Prior,
    shards: Sequence[str | os.PathLike[str]],
    inducing_points: ArrayLike,
    *,
    weighted: bool = False,
    messages: Sequence[Summary] = (),
    tolerance: float = 1e-10,
    iterations_max: int = 1000,
    map: Map = builtins.map,
    keep: int | None = None,
    progress: Callable[[int, float], object] | None = None,
) -> FittedShards:
    """Fits the events of all shards, as `dgpc.fit` would fit them in one process.

    In every round, every shard receives one request. Its answer depends on the request and the file alone. A repeated
    task replaces the lost one, and the result has the same bits for every `map`.

    Parameters
    ----------
    prior : Prior
    shards : sequence of paths
        Files as `write_shards` writes them. Their order decides the last digits of the result. A file may have only
        one of its names here. Events count twice if the sequence has a file and a copy of it.
    inducing_points : array of shape (M, d)
    weighted : bool
        Whether the last column of the files contains weights.
    messages : sequence of Summary
        Messages of other agents.
    tolerance : float
        The fit stops when no tilt changes by more than this in one iteration.
    iterations_max : int
    map : callable
        Applies a function to the items of sequences, in order: ``map`` itself, the method of an executor of
        ``concurrent.futures``, or that of ``dgpc.ray.Workers``.
    keep : int, optional
        Largest number of shards that a worker process keeps in memory between rounds; all if not given.
    progress : callable, optional
        Receives the number of iterations and the largest change of a tilt after every round.

    Returns
    -------
    FittedShards

    Raises
    ------
    ValueError
        If a file is missing, empty of columns or damaged, or is named twice; the message names the file.
    TypeError
        If `shards` is a path.
    Exception
        Any exception of `map`, for example ``BrokenProcessPool`` if a process of ``concurrent.futures`` dies.

    Examples
    --------
        >>> import dgpc, tempfile
        >>> from dgpc.sharded import fit, write_shards
        >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
        >>> x, y = [[0.0], [1.0], [2.0], [3.0]], [1, 1, 0, 0]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = fit(prior, write_shards(folder, x, y, shards=2), [[0.5], [1.5], [2.5]])
        >>> found.posterior.probability([[0.5], [2.5]]).round(2)
        array([0.75, 0.25])
    """
    paths = distinct(shards)
    if keep is not None and keep < 0:
        raise ValueError(f"keep must be at least 0, found {keep}")
    run = ShardedFit(prior, np.asarray(inducing_points, dtype=float), messages=messages, tolerance=tolerance,
                     iterations_max=iterations_max)
    model = _Model(prior.to_bytes(), run.inducing_points, weighted, keep, COVARIANCES_MAX // len(paths))

    def contributions_to(request: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        return answers(map, _contribute, paths, [model] * len(paths), [request] * len(paths))

    sizes = (0, 0)
    while (request := run.request()) is not None:
        contributions, before = contributions_to(request), run.iterations
        run.absorb(contributions)
        if run.iterations > before:
            sizes = (request.nbytes, contributions[0].nbytes)
        if progress is not None:
            progress(run.iterations, run.change)
    gradient = run.gradient(contributions_to(run.gradient_request()))
    return FittedShards(
        run.posterior(), run.summary(), run.evidence, gradient, run.iterations, run.change, run.stop or "", *sizes
    )


class _Model(NamedTuple):
    """What a worker needs besides its events."""

    prior: bytes
    inducing_points: NDArray[np.float64]
    weighted: bool
    keep: int | None
    covariances_max: int

    def digest(self) -> bytes:
        content = self.prior + self.inducing_points.tobytes() + bytes([self.weighted])
        return hashlib.sha256(content).digest()


#: The shards that this process keeps, by file and model; the least recently used one is first.
_kept: OrderedDict[tuple[str, tuple[int, ...], bytes], Shard] = OrderedDict()

#: Several threads may be workers of one process.
_lock = threading.Lock()


def _contribute(path: str, model: _Model, request: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the contribution of one shard to a request. Runs in a worker."""
    with naming(path):
        state = os.stat(path)
        # The time of modification alone can be restored after a change; the other numbers differ then.
        version = (state.st_mtime_ns, state.st_ctime_ns, state.st_size, state.st_ino)
        key = (path, version, model.digest())
        with _lock:
            shard = _kept.pop(key, None)
            # Earlier models and contents of the file are not needed again.
            for other in [other for other in _kept if other[2] != key[2] or other[0] == path]:
                del _kept[other]
        # An empty shard is false, too.
        shard = _read(path, model) if shard is None else shard
        contribution = shard.contribute(request)
    with _lock:
        _kept[key] = shard
        while model.keep is not None and len(_kept) > model.keep:
            _kept.popitem(last=False)
    return contribution


def _read(path: str, model: _Model) -> Shard:
    dimension = model.inducing_points.shape[1]
    table = opened(path, dimension + 1 + model.weighted, model.weighted)
    weights = table[:, -1] if model.weighted else None
    prior = Prior.from_bytes(model.prior)
    return Shard(prior, table[:, :dimension], table[:, dimension], model.inducing_points, weights=weights,
                 covariances_max=model.covariances_max)
