"""Tables: any mapping of column names to arrays as CSV, and CSV as a dictionary of arrays."""

from __future__ import annotations

import csv
import io
import numbers
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, TypeAlias, Union

import numpy as np
import numpy.typing as npt

Array: TypeAlias = npt.NDArray[Any]


class Columns(Protocol):
    """A mapping of column names to arrays, such as a dictionary, or a frame of pandas or Polars."""

    def __getitem__(self, name: Any, /) -> Any: ...


TableLike: TypeAlias = Union[str, "os.PathLike[str]", Columns]

#: Columns that are text, even if all their fields look like numbers.
TEXT_COLUMNS = {"tx_id", "rx_id", "kind"}


class Table(dict[str, Array]):
    """A dictionary of arrays. Except for maps they have one length, so that ``pandas.DataFrame`` accepts it.

    Attributes
    ----------
    reference_system : str or None
        The reference system of an event log, such as ``"EPSG:32619"`` or ``"41.52,-70.67"``, the latitude and longitude
        of (0, 0). Copies to other types lose it; the options ``crs`` and ``origin`` state it again.
    report : dict
        The object that the command prints with ``--json``; empty if there is none.

    Examples
    --------
    >>> log = pingmap.simulate(vehicles=2, slots=10, seed=1)
    >>> log["time_s"][:2].tolist(), log.reference_system, len(log.report["vehicles"])
    ([10.0, 20.0], None, 2)
    """

    def __init__(self, columns: Any = (), /, reference_system: str | None = None, report: Any = None) -> None:
        super().__init__(columns)
        self.reference_system = reference_system
        self.report: dict[str, Any] = report or {}


#: Start of the line of an event log that names its reference system.
REFERENCE = "# reference system:"


def column_names(table: Any) -> list[str]:
    """Returns the names of the columns of a mapping or a frame."""
    names = table.keys() if hasattr(table, "keys") else getattr(table, "columns", None)
    if names is None or isinstance(table, (str, bytes)):
        raise ValueError(
            f"expected a path, or a mapping of column names to arrays such as a dictionary or a pandas frame, "
            f"found {type(table).__name__}"
        )
    names = list(names)
    for name in names:
        if not isinstance(name, str):
            raise ValueError(f"names of columns must be text, found {name!r}")
    return names


def column(table: Any, name: str) -> list[str]:
    """Returns the fields of a column as text.

    Numbers keep all their digits. A missing name, kind or heading is an empty field.
    """
    # Some versions of NumPy do not declare the types of this module.
    masked: Any = np.ma
    if isinstance(table[name], np.ma.MaskedArray) and masked.is_masked(table[name]):
        raise ValueError(f"column {name}: masked values are not supported; leave out these rows")
    values = np.asarray(table[name])
    if values.ndim != 1:
        raise ValueError(f"column {name}: expected an array of one dimension, found {values.ndim}")
    if values.dtype.kind in "mM":
        raise ValueError(f"column {name}: expected numbers, such as seconds since 1970, found {values.dtype}")
    return [field(value, name) for value in values.tolist()]


def field(value: object, name: str) -> str:
    """Returns one value as text."""
    if isinstance(value, float):
        is_blank = value != value and (name in TEXT_COLUMNS or name.endswith("_heading_deg"))
        return "" if is_blank else repr(float(value))
    if isinstance(value, str):
        return value
    if value is None or type(value).__name__ in ("NAType", "NaTType"):
        return ""
    if isinstance(value, numbers.Integral):
        return str(int(value))
    if isinstance(value, numbers.Real):
        return repr(float(value))
    raise ValueError(f"column {name}: expected numbers or text, found {value!r}")


def to_csv(table: Any) -> str:
    """Returns a table as CSV. The numbers of the text are exactly those of the table."""
    names = column_names(table)
    columns = [column(table, name) for name in names]
    lengths = {len(fields) for fields in columns}
    if len(lengths) > 1:
        found = ", ".join(f"{name} {len(fields)}" for name, fields in zip(names, columns))
        raise ValueError(f"all columns must have one length, found {found}")
    text = io.StringIO()
    reference = getattr(table, "reference_system", None)
    if isinstance(reference, str):
        text.write(f"{REFERENCE} {reference}\n")
    # Quoted fields cannot begin a remark or end a line.
    writer = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL)
    writer.writerow(names)
    writer.writerows(zip(*columns))
    return text.getvalue()


def read_text(path: str | os.PathLike[str]) -> str:
    """Returns the text of a file."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        problem = getattr(error, "strerror", None) or error
        raise ValueError(f"{os.fsdecode(path)}: cannot be read: {problem}") from error


def from_csv(text: str) -> Table:
    """Returns the columns of CSV that may begin with remarks."""
    reference = None
    while text.startswith("#"):
        remark, _, text = text.partition("\n")
        if remark.startswith(REFERENCE):
            reference = remark[len(REFERENCE) :].strip()
    table = from_rows(text)
    table.reference_system = reference
    return table


def from_rows(text: str) -> Table:
    """Returns the columns of CSV without remarks: numbers where all fields are numbers, and text elsewhere."""
    rows = csv.reader(io.StringIO(text, newline=""))
    header = next(rows, [])
    columns: list[tuple[str, ...]] = list(zip(*rows)) or [()] * len(header)
    return Table({name: array(name, fields) for name, fields in zip(header, columns)})


def array(name: str, fields: Sequence[str]) -> Array:
    """Returns the fields of one column as an array. An empty field among numbers is NaN."""
    if name.lower() in TEXT_COLUMNS:
        return np.array(fields, dtype=str)
    try:
        # Python accepts "1_000" as a number, other readers do not.
        values = np.array([float(text.replace("_", "x")) if text else np.nan for text in fields], dtype=float)
    except ValueError:
        return np.array(fields, dtype=str)
    is_outcome = name == "success" and np.isin(values, [0.0, 1.0]).all()
    return values.astype(np.int64) if is_outcome else values
