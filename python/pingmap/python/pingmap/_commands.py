"""The commands of the program as functions of tables.

Every function runs the command of its name in this process. Other keyword arguments are options of that command: see
``pingmap COMMAND --help``, or the text that ``pingmap.run("learn", "--help")`` returns.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Any, TypeAlias, Union

import numpy as np

from . import _pingmap
from ._options import refuse_standard_input, with_program
from ._tables import Table, TableLike, column_names, from_csv, from_rows
from ._warnings import warn
from ._workspace import Model, PathLike, Workspace

#: A position: easting and northing in metres and perhaps a depth, or text such as ``"41.52N,70.67W"``.
Place: TypeAlias = Union[str, tuple[float, ...]]

#: Columns that ``predict`` adds, or replaces.
PREDICTED = {"probability", "lower", "upper", "log_odds_mean", "log_odds_variance"}

Logs: TypeAlias = Union[TableLike, Sequence[TableLike]]


def run(*arguments: PathLike) -> str:
    """Runs any command, with the arguments of the command line, and returns the text that it prints.

    Parameters
    ----------
    *arguments : str or path
        The command and its arguments, without the program's name.

    Raises
    ------
    ValueError
        For bad input: where the program would have the exit status 2. Also for a command that would read standard
        input, which Ctrl-C could not stop.
    pingmap.Error
        For any other failure: where the program would have the exit status 1.

    Examples
    --------
    >>> print(pingmap.run("packet", "schema").splitlines()[0])
    Map32, DCCL id 124: 32 of 32 bytes, 252 bits used; 5 inducing points in 1 block
    """
    words = [os.fsdecode(argument) for argument in arguments]
    refuse_standard_input(words)
    return _pingmap.run(with_program(words), warn)


def read_log(path: PathLike) -> Table:
    """Reads an event log.

    Parameters
    ----------
    path : str or path
        A CSV file, as ``pingmap import`` writes it.

    Returns
    -------
    Table
        The columns of an event log with standard names. Other columns of the file are left out.

    Raises
    ------
    ValueError
        With file, line, column, the value and the expected value.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/log.csv"
    ...     _ = pingmap.run("simulate", "--slots=10", "--quiet", "-o", path)
    ...     log = pingmap.read_log(path)
    >>> len(log["success"]), log["tx_id"][:3].tolist()
    (20, ['auv1', 'auv1', 'auv2'])
    """
    return from_csv(_pingmap.read_log(os.fsdecode(path)))


def import_mission(*files: PathLike, **options: Any) -> Table:
    """Makes an event log from the recordings of all vehicles.

    Parameters
    ----------
    *files : str or path
        Recorded files, or folders or archives of them.
    **options
        Options of ``pingmap import``, such as ``correct_clocks="auv1"`` or ``always_transmits=True``.

    Returns
    -------
    Table
        The event log. Its ``report`` has counts, offsets of clocks and reasons for excluded transmissions.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "events.csv")
    ...     _ = path.write_text(
    ...         "time_s,tx_id,rx_id,tx_easting_m,tx_northing_m,rx_easting_m,rx_northing_m,success\\n"
    ...         "10,auv1,auv2,0,0,150,0,heard\\n"
    ...         "20,auv2,auv1,150,0,0,0,missed\\n"
    ...     )
    ...     log = pingmap.import_mission(events=path)
    >>> log["success"].tolist()
    [1, 0]
    """
    with Workspace() as workspace:
        return workspace.table("import", [os.fsdecode(file) for file in files], options)


def simulate(
    *, vehicles: int | None = None, slots: int | None = None, seed: int | None = None, **options: Any
) -> Table:
    """Simulates a field trial with an acoustic channel of published formulas.

    Parameters
    ----------
    vehicles : int, optional
        Number of vehicles.
    slots : int, optional
        Number of transmissions.
    seed : int, optional
        Seed of sea floor, tracks, noise and outcomes.
    **options
        Other options of ``pingmap simulate``.

    Returns
    -------
    Table
        The event log, with the column ``true_probability``. Its ``report`` describes vehicles and sea floor.

    Examples
    --------
    >>> log = pingmap.simulate(vehicles=3, slots=20, seed=1)
    >>> len(log["success"]), sorted(set(log["tx_id"].tolist()))
    (40, ['auv1', 'auv2', 'auv3'])
    """
    with Workspace() as workspace:
        return workspace.table("simulate", [], {"vehicles": vehicles, "slots": slots, "seed": seed, **options})


def learn(log: Logs, *, seed: int | None = None, **options: Any) -> Model:
    """Learns a model of links.

    Parameters
    ----------
    log : table, path, or a list of these
        Event logs, read as one log.
    seed : int, optional
        Seed of all random numbers.
    **options
        Other options of ``pingmap learn``, such as ``test_share=0.2``.

    Returns
    -------
    Model
        The model, which the other functions accept. Its ``report`` has the tried structures and their scores.

    Examples
    --------
    >>> model = pingmap.learn(pingmap.simulate(vehicles=2, slots=60, seed=1), additions="range")
    >>> model.report["events"]
    60
    """
    with Workspace() as workspace:
        output = workspace.path("learned.toml")
        given = {"seed": seed, **options}
        report = workspace.run("learn", workspace.logs(log), given, output=output, json=True)
        return Model(Model.read(output).text, json.loads(report))


def predict(log: Logs, links: TableLike, *, model: Model | PathLike | None = None, **options: Any) -> Table:
    """Predicts the probability of success over links.

    Parameters
    ----------
    log : table, path, or a list of these
        Event logs from which the posterior is learned.
    links : table or path
        Columns ``tx_easting_m``, ``tx_northing_m``, ``rx_easting_m`` and ``rx_northing_m``, or ``tx_latitude_deg`` and
        so on. Optional columns ``tx_id``, ``rx_id`` and ``time_s`` select vehicles and time.
    model : Model or path, optional
        The model of links; learned from the log if not given.
    **options
        Other options of ``pingmap predict``.

    Returns
    -------
    Table
        All columns of the links, and ``probability``, the 90 % interval ``lower`` and ``upper``, ``log_odds_mean`` and
        ``log_odds_variance``. Columns of a mapping come back with their values and types.

    Examples
    --------
    >>> log = pingmap.simulate(vehicles=2, slots=60, seed=1)
    >>> links = {"tx_easting_m": [0, 0], "tx_northing_m": [0, 0], "rx_easting_m": [100, 900], "rx_northing_m": [0, 0]}
    >>> predicted = pingmap.predict(log, links, model=pingmap.learn(log))
    >>> near, far = predicted["probability"]
    >>> bool(near > far)
    True
    """
    refused = [name for name in ["json", "output", "o"] if name in options]
    if refused:
        raise ValueError(f"predict returns a table; expected no option {refused[0]}")
    with Workspace() as workspace:
        asked = {"model": model, **options}
        printed = workspace.run("predict", workspace.logs(log), asked, links=workspace.file(links, "links.csv"))
    table = from_rows(printed)
    if isinstance(links, (str, os.PathLike)):
        return table
    # The command prints the columns of the links first.
    given: Any = links
    names = [name for name in column_names(given) if name.strip().lower() not in PREDICTED]
    return Table({name: np.array(given[name]) for name in names} | dict(list(table.items())[len(names) :]))


def map(  # noqa: A001
    log: Logs, at: Place | list[Place], *, model: Model | PathLike | None = None, **options: Any
) -> Table:
    """Maps the probability of success between positions and every cell of an area.

    Parameters
    ----------
    log : table, path, or a list of these
        Event logs from which the posterior is learned.
    at : position, or a list of positions
        Positions that the map is seen from.
    model : Model or path, optional
        The model of links; learned from the log if not given.
    **options
        Other options of ``pingmap map``, such as ``cell_m=25``, ``bounds=(0, 0, 1500, 900)`` or ``as_="rx"``.

    Returns
    -------
    Table
        ``easting_m`` and ``northing_m`` are the coordinates of columns and rows. The other arrays have the shape
        (rows, columns), from south to north and from west to east: ``probability``, the 90 % interval ``lower`` and
        ``upper``, and ``explained``, the share of the prior variance that the data explain. With ``as_="both"`` the
        names of these arrays begin with ``tx_`` and ``rx_``. The ``report`` describes the map.

    Examples
    --------
    >>> log = pingmap.simulate(vehicles=2, slots=60, seed=1)
    >>> map = pingmap.map(log, at=(500, 500), model=pingmap.learn(log), cell_m=200, bounds=(0, 0, 800, 400))
    >>> map["probability"].shape, map["easting_m"].tolist()
    ((2, 4), [100.0, 300.0, 500.0, 700.0])
    """
    with Workspace() as workspace:
        cells = workspace.table("map", workspace.logs(log), {"at": at, "model": model, **options})
    shape = (cells.report["rows"], cells.report["columns"])
    grid = {name: np.reshape(values, shape) for name, values in cells.items()}
    grid["easting_m"], grid["northing_m"] = grid["easting_m"][0], grid["northing_m"][:, 0]
    return Table(grid, reference_system=cells.reference_system, report=cells.report)


def replay(
    log: Logs,
    *,
    model: Model | PathLike | None = None,
    frames: list[int] | None = None,
    online: bool = False,
    seed: int | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Replays a mission, and scores the predictions of each vehicle alone and of the team.

    Parameters
    ----------
    log : table, path, or a list of these
        Event logs, read as one log.
    model : Model or path, optional
        The model of links; learned from the training events if not given.
    frames : list of int, optional
        Numbers of packets that every vehicle sends.
    online : bool, optional
        Whether the mission runs in the order of time.
    seed : int, optional
        Seed of all random numbers.
    **options
        Other options of ``pingmap replay``, such as ``repeats=10`` or ``loss=0.3``.

    Returns
    -------
    dict
        The object that the command prints with ``--json``.

    Examples
    --------
    >>> log = pingmap.simulate(vehicles=2, slots=60, seed=1)
    >>> report = pingmap.replay(log, frames=[1, 5], repeats=1)
    >>> scores = [row["team"]["nll"] for row in report["sharing"]]
    >>> len(scores)
    2
    """
    given = {"model": model, "frames": frames, "online": online, "seed": seed, **options}
    with Workspace() as workspace:
        report: dict[str, Any] = json.loads(workspace.run("replay", workspace.logs(log), given, json=True))
        return report
