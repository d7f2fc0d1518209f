"""One vehicle of a team."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from . import _pingmap
from ._tables import Table, TableLike, from_csv, read_text, to_csv
from ._warnings import warn
from ._workspace import PathLike


class Receipt(NamedTuple):
    """The result of receiving a frame.

    Attributes
    ----------
    accepted : bool
        Whether the content counts from now on.
    reason : str
        The reason why it does not count; empty if it counts.
    """

    accepted: bool
    reason: str


class Agent:
    """One vehicle of a team, as a state machine without input or output, clock, or threads.

    A host records what the vehicle observes, passes on received frames, asks for the next frame to send, and asks for
    predictions. Events may arrive late and in any order. Frames may be lost, repeated and reordered.

    Parameters
    ----------
    name : str
        Name of the vehicle. A vehicle that is no member of the team receives and predicts, but sends nothing.
    team : str or path
        Team file, as ``pingmap team`` writes it. It names the model file and the key file.
    record_all_receivers : bool, optional
        Whether the events of every receiver are recorded as own events, for a station that has the logs of others.

    Raises
    ------
    ValueError
        For a team file, model file or key file that cannot be used.

    Examples
    --------
    >>> import tempfile
    >>> log = pingmap.simulate(vehicles=2, slots=60, seed=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     model, path, team = (f"{folder}/{name}" for name in ["model.toml", "log.csv", "team.toml"])
    ...     pingmap.learn(log, additions="range").save(model)
    ...     _ = pingmap.run("simulate", "--vehicles=2", "--slots=60", "--seed=1", "--quiet", "-o", path)
    ...     _ = pingmap.run("team", path, "--model", model, "--quiet", "-o", team)
    ...     sender, receiver = pingmap.Agent("auv1", team), pingmap.Agent("auv2", team)
    >>> sender.record({name: values[log["rx_id"] == "auv1"] for name, values in log.items()})
    >>> sender.refit()
    >>> receiver.receive(sender.next_frame(time_s=600.0))
    Receipt(accepted=True, reason='')
    """

    def __init__(self, name: str, team: PathLike, *, record_all_receivers: bool = False) -> None:
        self._agent = _pingmap.Agent(
            name, os.fsdecode(team), warn, record_all_receivers=record_all_receivers, snapshot=None
        )

    @classmethod
    def restore(cls, name: str, team: PathLike, snapshot: bytes, *, record_all_receivers: bool = False) -> Agent:
        """Restores the vehicle of a snapshot.

        Under another team configuration it keeps its events and positions, and shares again from nothing. It fits
        nothing: see ``refit_due``.

        Raises
        ------
        ValueError
            For bytes that are no snapshot, damaged, of another vehicle or version, or checked with another key.
        """
        agent = cls.__new__(cls)
        agent._agent = _pingmap.Agent(
            name, os.fsdecode(team), warn, record_all_receivers=record_all_receivers, snapshot=snapshot
        )
        return agent

    @property
    def name(self) -> str:
        """The name of the vehicle."""
        return self._agent.name

    @property
    def refit_due(self) -> bool:
        """Whether enough events came or went since the last fit that ``refit`` is due."""
        return self._agent.refit_due

    def record(self, events: TableLike) -> None:
        """Records events of which the vehicle is the receiver.

        Parameters
        ----------
        events : table or path
            The columns of an event log. Two events at least are needed to derive a course from positions.
        """
        with naming(events, "events"):
            self._agent.record(csv_of(events))

    def record_positions(self, positions: TableLike) -> None:
        """Records positions of the vehicle from its navigation; one a slot is enough.

        Parameters
        ----------
        positions : table or path
            Columns ``time_s``, ``easting_m``, ``northing_m``, and perhaps ``depth_m``.
        """
        with naming(positions, "positions"):
            table = from_csv(csv_of(positions))
            names = ["time_s", "easting_m", "northing_m"]
            for name in names:
                if name not in table:
                    raise ValueError(f"positions: no column {name}; expected {', '.join(names)}, and perhaps depth_m")
            times_s, eastings_m, northings_m = (numbers_of(table, name) for name in names)
            depths_m = numbers_of(table, "depth_m") if "depth_m" in table else [None] * len(times_s)
        self._agent.record_positions(list(zip(times_s, eastings_m, northings_m, depths_m)))

    def record_unused_slots(self, times_s: Iterable[float]) -> None:
        """Records that the vehicle did not transmit in its own slots at these times."""
        self._agent.record_unused_slots([float(time_s) for time_s in times_s])

    def receive(self, frame: bytes, time_s: float | None = None) -> Receipt:
        """Receives a frame, which the next prediction uses.

        Damaged, repeated and foreign frames raise no exception. The receipt has the reason.

        Parameters
        ----------
        frame : bytes
            The bytes as they arrived.
        time_s : float, optional
            The present time, which advances the clock of the vehicle.
        """
        reason = self._agent.receive(frame, time_s)
        return Receipt(reason is None, reason or "")

    def next_frame(self, time_s: float | None = None, frame_bytes: int | None = None) -> bytes | None:
        """Returns the next frame to send, or ``None`` if nothing is worth a frame.

        A host that can lose its memory stores a ``snapshot`` before the frame leaves.

        Parameters
        ----------
        time_s : float, optional
            The time at which the frame will leave.
        frame_bytes : int, optional
            Largest length of the frame, at least 32; that of the team if not given.
        """
        longest = self._agent.frame_bytes if frame_bytes is None else frame_bytes
        if longest < 0:
            raise ValueError(f"frame_bytes must be at least 32, found {longest}")
        return self._agent.next_frame(time_s, min(longest, 2**32))

    def predict(self, links: TableLike, *, own_events_only: bool = False) -> Table:
        """Predicts links.

        Parameters
        ----------
        links : table or path
            As for ``pingmap.predict``, in metres. Without the columns ``tx_id``, ``rx_id``, ``time_s`` and ``kind`` the
            vehicles, the time and the kind of message are typical.
        own_events_only : bool, optional
            Whether the data of other members are left out. The result then has no intervals.

        Returns
        -------
        Table
            ``probability``, the 90 % interval ``lower`` and ``upper``, ``log_odds_mean`` and ``log_odds_variance``.
        """
        with naming(links, "links"):
            columns = self._agent.predict(csv_of(links), own_events_only)
        return Table({name: np.array(values) for name, values in columns.items() if values})

    def refit(self) -> None:
        """Fits own and remote events again, beginning at the last fit, and detects faulty members."""
        self._agent.refit()

    def adapt(self) -> None:
        """Learns a model of the vehicle's own, which its predictions use from then on. Frames keep the team's model."""
        self._agent.adapt()

    def set_muted(self, member: str, is_muted: bool = True) -> None:
        """Mutes a member, so that none of its frames has an effect, or uses its data again."""
        self._agent.set_muted(member, is_muted)

    def status(self) -> dict[str, Any]:
        """Returns the state of the vehicle and, in ``members``, of every other member."""
        return self._agent.status()

    def snapshot(self) -> bytes:
        """Returns everything that the vehicle must not lose. Equal memories give equal bytes."""
        return self._agent.snapshot()

    def __repr__(self) -> str:
        return f"<pingmap.Agent {self.name}>"


def csv_of(table: TableLike) -> str:
    """Returns the CSV of a table or of a file."""
    return read_text(table) if isinstance(table, (str, os.PathLike)) else to_csv(table)


def numbers_of(table: Table, name: str) -> list[Any]:
    """Returns a column of positions as numbers."""
    if table[name].dtype.kind == "U":
        raise ValueError(f"positions: column {name}: expected numbers")
    numbers: list[Any] = table[name].tolist()
    return numbers


@contextmanager
def naming(table: TableLike, role: str) -> Iterator[None]:
    """Names the file of a table in errors, instead of its role."""
    try:
        yield
    except ValueError as error:
        role, is_of_table, problem = str(error).partition(f"{role}: ")
        if role or not is_of_table or not isinstance(table, (str, os.PathLike)):
            raise
        raise ValueError(f"{os.fsdecode(table)}: {problem}") from None
