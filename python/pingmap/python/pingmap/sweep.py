"""Many replays or simulated missions, on any engine with the interface of ``map``.

A task is a dictionary of arguments. Its result is stored in a file whose name is a digest of the task, the function and
the build of the package. A sweep that was interrupted therefore continues where it stopped, and a task that runs twice
gives one result. The final table does not depend on the number of workers or on their order.
"""

from __future__ import annotations

import builtins
import functools
import hashlib
import inspect
import itertools
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import __version__, _commands, _pingmap

__all__ = ["grid", "replay_scores", "simulated_scores", "sweep"]

#: A function like ``map``: it applies a function to the items of one or several sequences, in order.
Map = Callable[..., Iterable[Any]]


def grid(**axes: Sequence[Any]) -> list[dict[str, Any]]:
    """Returns one task for every combination of values; the last axis changes fastest.

    Examples
    --------
        >>> grid(seed=[1, 2], frames=[5])
        [{'seed': 1, 'frames': 5}, {'seed': 2, 'frames': 5}]
    """
    return [dict(zip(axes, values)) for values in itertools.product(*axes.values())]


def replay_scores(log: Any, *, frames: int = 10, **options: Any) -> dict[str, float]:
    """Returns the negative log-likelihoods of one replay, in nats: a task for `sweep`.

    Parameters
    ----------
    log : path
        An event log.
    frames : int
        Number of packets that every vehicle sends.
    **options
        Other options of ``pingmap replay``, such as ``seed=2``, ``repeats=1`` or ``share="summaries"``.

    Examples
    --------
        >>> log = _commands.simulate(vehicles=2, slots=60, seed=1)
        >>> sorted(replay_scores(log, frames=1, repeats=1, additions="range"))
        ['centralised', 'distance_only', 'own', 'team']
    """
    found = _commands.replay(log, frames=[frames], **options)
    scores = {name: found["scores"][name]["nll"] for name in ["distance_only", "own", "centralised"]}
    return scores | {"team": found["sharing"][0]["team"]["nll"]}


def simulated_scores(
    *, seed: int, vehicles: int | None = None, slots: int | None = None, **options: Any
) -> dict[str, float]:
    """Simulates a mission, and returns the scores of its replay: a task for `sweep`.

    Parameters
    ----------
    seed : int
        Seed of the mission.
    vehicles, slots : int, optional
        Numbers of vehicles and of transmissions.
    **options
        As `replay_scores`.

    Examples
    --------
        >>> scores = simulated_scores(seed=1, vehicles=2, slots=60, frames=1, repeats=1)
        >>> scores["centralised"] < 1.0
        True
    """
    return replay_scores(_commands.simulate(seed=seed, vehicles=vehicles, slots=slots), **options)


def sweep(
    function: Callable[..., Mapping[str, Any]],
    tasks: Sequence[Mapping[str, Any]],
    folder: str | os.PathLike[str],
    *,
    map: Map = builtins.map,
    progress: Callable[[int, int], object] | None = None,
) -> dict[str, list[Any]]:
    """Runs `function` once for every task, and returns a table of tasks and results.

    Tasks of about ten seconds are a good size: shorter ones spend their time on transport, longer ones lose more when
    a worker dies.

    Parameters
    ----------
    function : callable
        A function that is defined with ``def`` in a module that workers can import. It receives the task as keyword
        arguments, and returns a dictionary of values that JSON can hold. Its source and its default values are part of
        the digest. Global variables and other functions that it uses are not: choose another folder when they change.
    tasks : sequence of dictionaries
        Values are numbers, text, or paths. The content of a file that a path or text names is part of the digest.
    folder : path
        Folder of the results; created if it does not exist.
    map : callable
        Applies a function to the items of sequences, in order: ``map`` itself, the method of an executor of
        ``concurrent.futures``, or that of ``pingmap.ray.Workers``.
    progress : callable, optional
        Receives the number of finished tasks and the number of tasks.

    Returns
    -------
    dictionary of lists
        A row for each task, in the order of `tasks`: the columns of the task, then those of the result.

    Raises
    ------
    ValueError
        If two tasks are equal, a result cannot be stored as JSON, or the function is no such function.
    pingmap.Error
        If a result cannot be written, for example because the disk is full. An engine raises its own exception, such as
        ``BrokenProcessPool``, if a worker dies. Stored results stay in both cases.

    Examples
    --------
        >>> import math, tempfile
        >>> def root(x):
        ...     return {"root": math.sqrt(x)}
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sweep(root, grid(x=[4.0, 9.0]), folder)
        {'x': [4.0, 9.0], 'root': [2.0, 3.0]}
    """
    tasks = [{name: _plain(value) for name, value in task.items()} for task in tasks]
    # A worker may have another working directory.
    where = Path(folder).resolve()
    where.mkdir(parents=True, exist_ok=True)
    identity = _identity(function)
    files = [where / f"{_digest(identity, task)}.json" for task in tasks]
    if len(set(files)) < len(files):
        raise ValueError("two tasks of the sweep are equal; expected different tasks")
    missing = [number for number, file in enumerate(files) if _stored(file) is None]
    done = len(files) - len(missing)
    if progress is not None:
        progress(done, len(files))
    chosen = [dict(tasks[number]) for number in missing]
    for _ in map(_run, [function] * len(missing), chosen, [str(files[number]) for number in missing]):
        done += 1
        if progress is not None:
            progress(done, len(files))
    for task, file in zip(tasks, files):
        if _stored(file) is None:
            raise ValueError(f"{file}: the workers stored no result of the task {dict(task)}; all need the folder")
    return _table(tasks, files)


def _plain(value: Any) -> Any:
    """Returns a number of NumPy as a number of Python."""
    return value.item() if isinstance(value, np.generic) else value


def _identity(function: Callable[..., Any]) -> list[Any]:
    """Returns everything of a function that decides its results, except for global variables and other functions."""
    if not inspect.isfunction(function) or function.__name__ == "<lambda>" or function.__closure__:
        raise ValueError(f"expected a function that is defined with def and captures no variable, found {function!r}")
    name = f"{function.__module__}.{function.__qualname__}"
    # Two functions may have one name: one that was edited, or two that are defined in other functions.
    try:
        source = inspect.getsource(function)
    except (OSError, TypeError) as error:
        raise ValueError(f"the source of {name} is unknown; expected a function that is defined in a file") from error
    return [name, source, _described(function.__defaults__), _described(function.__kwdefaults__)]


def _digest(identity: list[Any], task: Mapping[str, Any]) -> str:
    """Returns the digest of everything that decides the result of a task."""
    content = json.dumps([__version__, _build(), identity, _described(task)], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()


@functools.cache
def _build() -> str:
    """Returns the digest of the compiled part of the package."""
    return _sha256(_pingmap.__file__)


def _sha256(file: str | os.PathLike[str]) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def _described(value: Any) -> Any:
    """Returns a value as JSON, with the content of the files that it names."""
    if isinstance(value, Mapping):
        return {name: _described(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_described(part) for part in value]
    if isinstance(value, os.PathLike):
        return {"sha256": _sha256(value)}
    if isinstance(value, str) and os.path.isfile(value):
        return {"text": value, "sha256": _sha256(value)}
    value = _plain(value)
    if value is None or isinstance(value, (str, int, float)):
        return value
    raise ValueError(f"tasks and default values hold numbers, text and paths, found {value!r}")


def _run(function: Callable[..., Mapping[str, Any]], task: dict[str, Any], file: str) -> None:
    """Runs a task and stores its result. Runs in a worker."""
    result = dict(function(**task))
    for name in task.keys() & result.keys():
        raise ValueError(f"the result of the task {task} has the name {name!r} of a parameter; expected another name")
    try:
        content = json.dumps(result)
    except TypeError as error:
        raise ValueError(f"the result of the task {task} cannot be stored: {error}") from error
    # A worker that dies while it writes leaves a temporary file, never half a result.
    handle, temporary = tempfile.mkstemp(dir=os.path.dirname(file), suffix=".part")
    try:
        with os.fdopen(handle, "w") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, file)
    except BaseException as error:
        os.unlink(temporary)
        if isinstance(error, OSError):
            raise _pingmap.Error(f"{file}: cannot be written: {error.strerror}") from error
        raise


def _stored(file: Path) -> dict[str, Any] | None:
    """Returns a stored result, or None if there is none or it is damaged."""
    try:
        result = json.loads(file.read_bytes())
    except (FileNotFoundError, ValueError):
        return None
    return result if isinstance(result, dict) else None


def _table(tasks: Sequence[Mapping[str, Any]], files: Sequence[Path]) -> dict[str, list[Any]]:
    rows = [{**task, **(_stored(file) or {})} for task, file in zip(tasks, files)]
    columns = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in columns}
