"""Maps of acoustic reception, learned during missions of underwater vehicles.

The functions run the commands of the program ``pingmap`` in this process, on tables. A table is a mapping of column
names to arrays, such as a dictionary or a frame of pandas or Polars, or the path of a CSV file. Equal logs, models and
seeds give the same numbers as the command line.

Bad input raises a ``ValueError``. Any other failure raises ``pingmap.Error``. Suspicious input or results issue a
``pingmap.Warning``. Notes and progress go to standard error if the option ``quiet=False`` is given. Ctrl-C stops a
command within a second.
"""

import importlib
from types import ModuleType

from ._agent import Agent, Receipt
from ._commands import import_mission, learn, map, predict, read_log, replay, run, simulate
from ._pingmap import Error
from ._tables import Table
from ._warnings import Warning  # noqa: A004
from ._workspace import Model

__version__ = "0.1.0"

__all__ = [
    "Agent",
    "Error",
    "Model",
    "Receipt",
    "Table",
    "Warning",
    "import_mission",
    "learn",
    "map",
    "predict",
    "read_log",
    "replay",
    "run",
    "simulate",
]


def __getattr__(name: str) -> ModuleType:
    """Imports a module of the package when it is first used, because Ray is optional."""
    if name not in ("ray", "sweep"):
        raise AttributeError(f"module 'pingmap' has no attribute {name!r}")
    return importlib.import_module(f".{name}", __name__)
