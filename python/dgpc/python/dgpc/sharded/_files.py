"""Files of events, and the tasks that read them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import ArrayLike, NDArray

from .._dgpc import Sites
from .._elementwise import has_masked_values

#: A function like ``map``: it applies a function to the items of one or several sequences, in order.
Map = Callable[..., Iterable[Any]]


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
        Outcomes, 0 or 1.
    shards : int
        Number of files.
    weights : array of shape (N,), optional

    Returns
    -------
    list of Path
        In the order that `fit` expects.

    Raises
    ------
    ValueError
        If lengths differ, an input is not finite, an outcome is not 0 or 1, or a weight is not positive.
    OSError
        If a file exists or cannot be written, for example because the disk is full. No file of this call remains.

    Examples
    --------
        >>> import tempfile
        >>> from dgpc.sharded import write_shards
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     [path.name for path in write_shards(folder, [[0.0], [1.0]], [0, 1], shards=2)]
        ['shard-0000.npy', 'shard-0001.npy']
    """
    if any(map(has_masked_values, (x, y, weights))):
        raise ValueError("masked values are not supported; leave out the rows that have some")
    columns = [np.asarray(values, dtype=float) for values in (x, y, weights) if values is not None]
    # Sites have the same conditions: lengths, finite inputs, outcomes and weights.
    Sites(columns[0], columns[1], np.ones(columns[1].shape), *columns[2:])
    if shards < 1:
        raise ValueError(f"shards must be at least 1, found {shards}")
    table = np.ascontiguousarray(np.column_stack(columns))
    Path(folder).mkdir(parents=True, exist_ok=True)
    paths = [Path(folder) / f"shard-{number:04}.npy" for number in range(shards)]
    written = []
    # Some versions of NumPy do not declare the types of this module.
    header: Any = npy_format
    try:
        for path, rows in zip(paths, np.array_split(table, shards)):
            # "x" refuses to replace a file.
            with open(path, "xb") as file:
                written.append(path)
                # `np.save` does not notice a disk that becomes full.
                header.write_array_header_1_0(file, header.header_data_from_array_1_0(rows))
                file.write(rows.data)
    except BaseException:
        for path in written:
            path.unlink()
        raise
    return paths


def distinct(shards: Sequence[str | os.PathLike[str]]) -> list[str]:
    """Returns the absolute paths of the shards, all of which must differ."""
    if isinstance(shards, (str, os.PathLike)):
        raise TypeError(f"expected a sequence of paths, found the path {os.fspath(shards)}")
    paths = [str(Path(shard).resolve()) for shard in shards]
    if not paths:
        raise ValueError("expected at least one shard")
    seen: set[Any] = set()
    for path in paths:
        # Hard links are two names of one file. A file that only workers can read is identified by its name.
        file = os.stat(path) if os.path.exists(path) else None
        identity = (file.st_dev, file.st_ino) if file else path
        if identity in seen:
            raise ValueError(f"{path}: the shard is named twice, so that its events would count twice")
        seen.add(identity)
    return paths


def answers(map: Map, task: Callable[..., Any], paths: list[str], *arguments: Sequence[Any]) -> list[Any]:
    """Runs one task for each shard, and returns the results in the order of the shards."""
    found = list(map(task, paths, *arguments))
    if len(found) != len(paths):
        raise ValueError(f"map returned {len(found)} results of {len(paths)} shards")
    return found


@contextmanager
def naming(path: str) -> Iterator[None]:
    """Adds the path of a shard to errors about its content."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error


def opened(path: str, columns: int | None, weighted: bool) -> NDArray[Any]:
    """Opens a shard. Its rows are read from the file when they are used.

    Without a number of columns, any number is accepted that leaves at least one input.
    """
    try:
        table: Any = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header may raise a SyntaxError, a damaged archive a BadZipFile
        raise ValueError(f"expected an array (.npy): {error}") from error
    if not isinstance(table, np.memmap):
        raise ValueError("expected one array (.npy), found an archive of arrays")
    size, expected = os.path.getsize(path), table.offset + table.nbytes
    if size != expected:
        raise ValueError(f"expected {expected} bytes for an array of shape {table.shape}, found {size} bytes")
    named = "inputs, outcome and weight" if weighted else "inputs and outcome"
    found = f"({named}), found an array of shape {table.shape}"
    if columns is None and (table.ndim != 2 or table.shape[1] < 2 + weighted):
        raise ValueError(f"expected at least {2 + weighted} columns {found}")
    if columns is not None and (table.ndim != 2 or table.shape[1] != columns):
        raise ValueError(f"expected {columns} columns {found}")
    return table
