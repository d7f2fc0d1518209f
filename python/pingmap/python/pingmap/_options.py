"""Keyword arguments as options of the command line."""

from __future__ import annotations

import numbers
import os
import shutil
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

#: Options with the values ``yes`` and ``no``. All other options with a truth value have no value.
YES_OR_NO = {"reciprocal"}

#: Options for which ``-`` is standard output.
OUTPUTS = {"-o", "--output", "--write-splits"}


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


def command_of(words: Sequence[str]) -> str | None:
    """Returns the command of a command line."""
    return next((word for word in words if not word.startswith("-")), None)


def with_program(words: list[str]) -> list[str]:
    """Names the program that runs the vehicles of ``fleet``, which would otherwise be the interpreter."""
    if command_of(words) != "fleet" or any(word.partition("=")[0] == "--program" for word in words):
        return words
    beside = os.path.dirname(sys.executable or "")
    program = shutil.which("pingmap", path=beside) or shutil.which("pingmap")
    if program is None:
        raise ValueError(f"fleet: found no program pingmap in {beside} or on the PATH; name it with --program FILE")
    after = words.index("fleet") + 1
    return [*words[:after], f"--program={program}", *words[after:]]


def refuse_standard_input(words: Sequence[str]) -> None:
    """Raises a ``ValueError`` if the command would read standard input, because Ctrl-C does not end that."""
    reads_lines = command_of(words) == "vehicle" and not {"--check", "--example", "--help", "-h"} & set(words)
    for before, word in zip(["", *words], words):
        name, _, value = word.rpartition("=")
        reads_lines |= value == "-" and not {before, name} & OUTPUTS
    if reads_lines:
        raise ValueError("standard input is not available in Python; give a path, or run the program pingmap")
