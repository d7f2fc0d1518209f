"""Learning from events in shards."""

from __future__ import annotations

import builtins
import os
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._dgpc import Learned, Prior, Summary, greedy_by_variance
from .._dgpc import learn as learn_in_process
from ._files import Map, answers, distinct, naming, opened
from ._fit import FittedShards, fit


class LearnedShards(NamedTuple):
    """A prior that was learned from events in shards, and the fit of all events under it.

    Examples
    --------
        >>> import dgpc, tempfile
        >>> from dgpc.sharded import learn, write_shards
        >>> prior = dgpc.Prior(dgpc.Term("matern52", 1.0, dimension=1))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = learn(prior, write_shards(folder, [[0.0], [1.0]], [0, 1], shards=1), seed=1)
        >>> found.search.searched_events, found.inducing_points.shape
        (2, (2, 1))
    """

    prior: Prior
    """The learned prior."""
    fit: FittedShards
    """The fit of all events."""
    inducing_points: NDArray[np.float64]
    """The inducing points of the fit, without those of the messages."""
    search: Learned
    """The report of the search. Its ``fit`` is that of the gathered events."""


def learn(
    template: Prior,
    shards: Sequence[str | os.PathLike[str]],
    *,
    seed: int,
    events_max: int = 4000,
    inducing_points: int | ArrayLike = 256,
    weighted: bool = False,
    messages: Sequence[Summary] = (),
    map: Map = builtins.map,
    keep: int | None = None,
    progress: Callable[[int, float], object] | None = None,
    search_progress: Callable[[dict[str, Any]], object] | None = None,
    **options: Any,
) -> LearnedShards:
    """Learns a prior from some events of all shards, and fits all events under it.

    `dgpc.learn` searches with at most 4000 events, too. This process holds the gathered events; all other events stay
    with the workers. The result has the same bits for every `map`.

    Parameters
    ----------
    template : Prior
        The structure of the prior, and the most probable values of its parameters.
    shards : sequence of paths
        Files as `write_shards` writes them.
    seed : int
        Seed of the choice of events.
    events_max : int
        Largest number of gathered events. Of more events, one is drawn from each of `events_max` parts of equal size.
    inducing_points : int or array of shape (M, d)
        A number is chosen greedily among the gathered events, for the learned prior.
    weighted : bool
        Whether the last column of the files contains weights. See `dgpc.learn` for their effect.
    messages : sequence of Summary
        Messages of other agents.
    map : callable
        As in `fit`.
    keep : int, optional
        As in `fit`.
    progress : callable, optional
        Receives the number of iterations and the largest change of a tilt after every round of the fit.
    search_progress : callable, optional
        Receives the progress of the search, as `progress` of `dgpc.learn`.
    **options
        Other options of `dgpc.learn`, such as ``bounds`` or ``calibrate``.

    Returns
    -------
    LearnedShards

    Raises
    ------
    ValueError
        As `fit`, and if the shards have no events or differ in their columns. Also if the files seem to have weights
        of 1 but `weighted` is false.

    Examples
    --------
        >>> import dgpc, tempfile
        >>> import numpy as np
        >>> from dgpc.sharded import learn, write_shards
        >>> template = dgpc.Prior(dgpc.Term("matern52", 0.1, variance=4.0, dimension=1))
        >>> x = np.linspace(-3, 3, 60)[:, None]
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found = learn(template, write_shards(folder, x, abs(x[:, 0]) < 2, shards=2), seed=1)
        >>> found.fit.posterior.probability([[0.0], [2.9]]).round(1)
        array([1., 0.])
    """
    paths = distinct(shards)
    table = _gather(paths, weighted, events_max, seed, map)
    dimension = table.shape[1] - 1 - weighted
    x, y, weights = table[:, :dimension], table[:, dimension], table[:, -1] if weighted else None
    if not weighted and _has_weights(template, x, y):
        raise ValueError("the last column contains only ones: if these are weights, set weighted=True")
    search = learn_in_process(
        template, x, y, weights=weights, messages=messages, search_events_max=events_max, progress=search_progress,
        **options,
    )
    if isinstance(inducing_points, (int, np.integer)):
        points = x[greedy_by_variance(search.prior, x, int(inducing_points)).indices]
    else:
        points = np.asarray(inducing_points, dtype=float)
    found = fit(
        search.prior, paths, points, weighted=weighted, messages=messages, map=map, keep=keep, progress=progress
    )
    return LearnedShards(search.prior, found, points, search)


def _has_weights(template: Prior, x: NDArray[np.float64], y: NDArray[np.float64]) -> bool:
    """Returns whether the last input, which the kernel ignores, may be the outcome, and the outcome a weight of 1."""
    used = {column for term in template.kernel.terms for part in term.correlations for column in part.columns}
    return bool(x.shape[1] - 1 not in used and (y == 1.0).all() and np.isin(x[:, -1], [0.0, 1.0]).all())


def _gather(paths: list[str], weighted: bool, events_max: int, seed: int, map: Map) -> NDArray[np.float64]:
    """Returns at most `events_max` rows of all shards, in their order."""
    if events_max < 1:
        raise ValueError(f"events_max must be at least 1, found {events_max}")
    tasks = len(paths)
    shapes = answers(map, _shape, paths, [weighted] * tasks)
    for path, (_, columns) in zip(paths, shapes):
        if columns != shapes[0][1]:
            raise ValueError(f"{path}: expected {shapes[0][1]} columns as in the first shard, found {columns}")
    sizes = np.array([rows for rows, _ in shapes])
    ends = np.cumsum(sizes)
    if ends[-1] == 0:
        raise ValueError("the shards contain no events; expected at least one")
    chosen = _spread_out(int(ends[-1]), events_max, seed)
    rows = [chosen[(begin <= chosen) & (chosen < end)] - begin for begin, end in zip(ends - sizes, ends)]
    return np.vstack(answers(map, _rows, paths, [weighted] * tasks, rows))


def _spread_out(count: int, count_max: int, seed: int) -> NDArray[np.int64]:
    """Returns sorted indices below `count`: one from each of `count_max` parts of nearly equal size, or all."""
    if count <= count_max:
        return np.arange(count)
    edges = np.arange(count_max + 1) * count // count_max
    return np.random.default_rng(seed).integers(edges[:-1], edges[1:])


def _shape(path: str, weighted: bool) -> tuple[int, int]:
    """Returns the number of events of a shard, and its number of columns. Runs in a worker."""
    with naming(path):
        rows, columns = opened(path, None, weighted).shape
        return rows, columns


def _rows(path: str, weighted: bool, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Returns some rows of a shard. Runs in a worker."""
    with naming(path):
        return np.array(opened(path, None, weighted)[rows], dtype=float)
