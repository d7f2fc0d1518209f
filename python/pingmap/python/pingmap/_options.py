"""Keyword arguments as options of the command line."""

from __future__ import annotations

import numbers
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Options with the values ``yes`` and ``no``. All other options with a truth value have no value.
YES_OR_NO = {"reciprocal"}


def arguments(options: Mapping[str, Any]) -> list[str]:
    """Returns the options of the command line for keyword arguments.

    ``slot_every=5`` becomes ``--slot-every=5``, and ``online=True`` becomes ``--online``. ``None`` and ``False`` are
    left out. A list repeats the option. A tuple is one value, with commas between its parts. A mapping repeats the
    option with ``NAME=VALUE``. Whether the options exist, the command decides.
    """
    words = []
    for name, value in options.items():
        flag = "--" + name.rstrip("_").replace("_", "-")
        if isinstance(value, (bool, np.bool_)):
            if name in YES_OR_NO:
                words.append(f"{flag}={'yes' if value else 'no'}")
            elif value:
                words.append(flag)
        elif value is not None:
            words += [f"{flag}={text}" for text in texts(name, value)]
    return words


def texts(name: str, value: Any) -> list[str]:
    """Returns the values of an option that may be repeated."""
    if isinstance(value, Mapping):
        return [f"{key}={text(name, part)}" for key, part in value.items()]
    if isinstance(value, (list, np.ndarray)):
        return [text(name, part) for part in value]
    return [text(name, value)]


def text(name: str, value: Any) -> str:
    """Returns one value as text. Numbers keep all their digits."""
    if isinstance(value, (str, os.PathLike)):
        return os.fsdecode(value)
    if isinstance(value, numbers.Integral):
        return str(int(value))
    if isinstance(value, numbers.Real):
        return repr(float(value))
    if isinstance(value, (tuple, list, np.ndarray)):
        return ",".join(text(name, part) for part in value)
    raise ValueError(f"{name}: expected a number, text or a path, found {value!r}")
