"""Warnings of commands as warnings of Python."""

from __future__ import annotations

import sys
import warnings


class Warning(UserWarning):  # noqa: A001
    """The input of a command or its result looks suspicious. The command continues."""


Warning.__module__ = "pingmap"


def warn(text: str) -> None:
    """Issues a warning that names the line of the caller outside of this package."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__package__") == __package__:
        level, frame = level + 1, frame.f_back
    warnings.warn(text, Warning, stacklevel=level)
