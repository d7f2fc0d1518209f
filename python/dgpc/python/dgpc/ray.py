"""Workers of Ray for `dgpc.sharded` and `pingmap.sweep`.

Ray starts with ``ray.init``. Ray 2.60 writes a token into the home directory. A worker reserves one processor for as
long as it exists: other tasks of the cluster wait if workers reserve all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from types import TracebackType
from typing import Any

try:
    import ray
except ModuleNotFoundError as error:
    raise ImportError("dgpc.ray needs Ray 2.60 or later: pip install 'dgpc[ray]'") from error

__all__ = ["Workers"]

#: Number of times that a task is repeated after its worker died. It may need more memory than the machine has.
TASK_RETRIES = 5


class Workers:
    """Worker processes of a Ray cluster, with the interface of ``map``.

    Item n of a sequence always goes to worker n modulo `count`, so that a worker keeps its shards between rounds. If a
    worker dies, Ray starts it again and repeats its task. A task whose worker dies six times raises an exception of
    Ray.

    Parameters
    ----------
    count : int
        Number of worker processes.
    cpus : float
        Processors that each worker reserves.

    Raises
    ------
    ValueError
        If the cluster has fewer processors. Those that an autoscaler has not started yet do not count.

    Examples
    --------
        >>> import ray  # doctest: +SKIP
        >>> ray.init(num_cpus=2)  # doctest: +SKIP
        >>> with Workers(2) as workers:  # doctest: +SKIP
        ...     found = dgpc.sharded.fit(prior, paths, points, map=workers.map)
    """

    def __init__(self, count: int, *, cpus: float = 1.0) -> None:
        if count < 1:
            raise ValueError(f"the number of workers must be at least 1, found {count}")
        if not ray.is_initialized():
            ray.init()
        found = ray.cluster_resources().get("CPU", 0.0)  # type: ignore[no-untyped-call]
        if found < count * cpus:
            raise ValueError(f"the workers need {count * cpus:g} processors; the cluster has {found:g}")
        # One thread for each worker: several workers of one machine would otherwise compete for its processors.
        environment = {"env_vars": {"RAYON_NUM_THREADS": "1"}}
        start = _Worker.options(  # type: ignore[attr-defined]
            num_cpus=cpus, max_restarts=-1, max_task_retries=TASK_RETRIES, runtime_env=environment
        )
        self.actors: list[Any] = [start.remote() for _ in range(count)]

    def map(self, function: Callable[..., Any], *items: Iterable[Any]) -> Iterator[Any]:
        """Applies a function to the items of sequences, and returns an iterator over the results, in order.

        All tasks are sent at once. The iterator waits for the next result only, so that a caller can report progress.
        If it ends early, for example by Ctrl-C or an exception of a task, the other tasks are cancelled. All workers
        end and start again if a task was unfinished.
        """
        if not self.actors:
            raise ValueError("these workers were closed")
        sequences = [list(sequence) for sequence in items]
        # An argument that all items share is sent to the cluster once.
        shared = [ray.put(sequence[0]) if _is_constant(sequence) else None for sequence in sequences]
        calls = []
        for number, row in enumerate(zip(*sequences)):
            arguments = [item if put is None else put for item, put in zip(row, shared)]
            calls.append(self.actors[number % len(self.actors)].run.remote(function, *arguments))
        return self._results(calls)

    def _results(self, calls: list[Any]) -> Iterator[Any]:
        try:
            for call in calls:
                yield ray.get(call)
        except BaseException as error:
            # Ray may have ended before an unused iterator.
            unfinished = ray.wait(calls, num_returns=len(calls), timeout=0)[1] if ray.is_initialized() else []
            for call in unfinished:
                ray.cancel(call)
            # A call that has begun can be stopped only with its process.
            for actor in self.actors if unfinished else []:
                ray.kill(actor, no_restart=False)
            if isinstance(error, ray.exceptions.RayTaskError):
                raise error.cause from error
            raise

    def close(self) -> None:
        """Ends the worker processes."""
        for actor in self.actors:
            ray.kill(actor)
        self.actors = []

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _is_constant(sequence: Sequence[Any]) -> bool:
    return len(sequence) > 1 and all(item is sequence[0] for item in sequence)


@ray.remote
class _Worker:
    def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments)

    def process(self) -> int:
        """Returns the identifier of the worker process."""
        import os

        return os.getpid()
