"""Sparse fits of events that exceed the memory of one process.

The events lie in shards: files in NumPy's format ``.npy``, one row an event. Workers read them. Only requests and
contributions of about M² numbers travel, for M inducing points. Any engine with the interface of ``map`` runs the
workers: ``concurrent.futures``, Dask, or Ray (``dgpc.ray``).
"""

from __future__ import annotations

import builtins
import hashlib
import os
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._dgpc import Posterior, Prior, Shard, ShardedFit, Summary

__all__ = ["FittedShards", "fit", "write_shards"]

#: A function like ``map``: it applies a function to the items of one or several sequences, in order.
Map = Callable[..., Iterable[Any]]


#: Largest number of covariances that one process keeps, 59 MB, even if it has all shards.
COVARIANCES_MAX = 7 << 20


class FittedShards(NamedTuple):
    """A sparse fit of events in shards."""

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


def write_shards(
    folder: str | os.PathLike[str], x: ArrayLike, y: ArrayLike, *, shards: int, weights: ArrayLike | None = None
) -> list[Path]:
    """Writes events as files of nearly equal size.

    The columns of a file are the d coordinates of the input, the outcome (0 or 1), and the weight if weights are given.

    Parameters
    ----------
    folder : path
        Created if it does not exist. Existing files are not replaced.
    x : array of shape (N, d)
    y : array of shape (N,)
    shards : int
        Number of files.
    weights : array of shape (N,), optional

    Returns
    -------
    list of Path
        In the order that `fit` expects.

    Examples
    --------
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     [path.name for path in write_shards(folder, [[0.0], [1.0]], [0, 1], shards=2)]
        ['shard-0000.npy', 'shard-0001.npy']
    """
    columns = [np.asarray(x, dtype=float), np.asarray(y, dtype=float)[:, None]]
    if weights is not None:
        columns.append(np.asarray(weights, dtype=float)[:, None])
    if shards < 1:
        raise ValueError(f"shards must be at least 1, found {shards}")
    table = np.hstack(columns)
    Path(folder).mkdir(parents=True, exist_ok=True)
    paths = [Path(folder) / f"shard-{number:04}.npy" for number in range(shards)]
    for path, rows in zip(paths, np.array_split(table, shards)):
        # "x" refuses to replace a file.
        with open(path, "xb") as file:
            np.save(file, rows)
    return paths


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
        Files as `write_shards` writes them. Their order decides the last digits of the result.
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

    Examples
    --------
        >>> import dgpc, tempfile
        >>> prior = dgpc.Prior(dgpc.Term("squared-exponential", 1.0, variance=4.0, dimension=1))
        >>> x, y = [[0.0], [1.0], [2.0], [3.0]], [1, 1, 0, 0]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = fit(prior, write_shards(folder, x, y, shards=2), [[0.5], [1.5], [2.5]])
        >>> found.posterior.probability([[0.5], [2.5]]).round(2)
        array([0.75, 0.25])
    """
    paths = _distinct(shards)
    run = ShardedFit(prior, np.asarray(inducing_points, dtype=float), messages=messages, tolerance=tolerance,
                     iterations_max=iterations_max)
    model = _Model(prior.to_bytes(), run.inducing_points, weighted, keep, COVARIANCES_MAX // len(paths))

    def answers(request: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        tasks = len(paths)
        found = list(map(_contribute, paths, [model] * tasks, [request] * tasks))
        if len(found) != tasks:
            raise ValueError(f"map returned {len(found)} contributions of {tasks} shards")
        return found

    sizes = (0, 0)
    while (request := run.request()) is not None:
        contributions, before = answers(request), run.iterations
        run.absorb(contributions)
        if run.iterations > before:
            sizes = (request.nbytes, contributions[0].nbytes)
        if progress is not None:
            progress(run.iterations, run.change)
    gradient = run.gradient(answers(run.gradient_request()))
    return FittedShards(
        run.posterior(), run.summary(), run.evidence, gradient, run.iterations, run.change, run.stop or "", *sizes
    )


def _distinct(shards: Sequence[str | os.PathLike[str]]) -> list[str]:
    """Returns the absolute paths of the shards, all of which must differ."""
    paths = [str(Path(shard).resolve()) for shard in shards]
    if not paths:
        raise ValueError("expected at least one shard")
    for path in paths:
        if paths.count(path) > 1:
            raise ValueError(f"{path}: the shard is named twice, so that its events would count twice")
    return paths


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
_kept: OrderedDict[tuple[str, int, bytes], Shard] = OrderedDict()

#: Several threads may be workers of one process.
_lock = threading.Lock()


def _contribute(path: str, model: _Model, request: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the contribution of one shard to a request. Runs in a worker."""
    try:
        key = (path, os.stat(path).st_mtime_ns, model.digest())
        with _lock:
            shard = _kept.pop(key, None)
            # Earlier models and contents of the file are not needed again.
            for other in [other for other in _kept if other[2] != key[2] or other[0] == path]:
                del _kept[other]
        # An empty shard is false, too.
        shard = _read(path, model) if shard is None else shard
        contribution = shard.contribute(request)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
    with _lock:
        _kept[key] = shard
        while model.keep is not None and len(_kept) > model.keep:
            _kept.popitem(last=False)
    return contribution


def _read(path: str, model: _Model) -> Shard:
    table = np.load(path, mmap_mode="r", allow_pickle=False)
    dimension = model.inducing_points.shape[1]
    columns = dimension + 1 + model.weighted
    if table.ndim != 2 or table.shape[1] != columns:
        named = "inputs, outcome and weight" if model.weighted else "inputs and outcome"
        raise ValueError(f"expected {columns} columns ({named}), found an array of shape {table.shape}")
    weights = table[:, -1] if model.weighted else None
    prior = Prior.from_bytes(model.prior)
    return Shard(prior, table[:, :dimension], table[:, dimension], model.inducing_points, weights=weights,
                 covariances_max=model.covariances_max)
