"""Files of one command, and the model file."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias, Union

from . import _pingmap
from ._options import arguments, refuse_standard_input
from ._tables import Table, TableLike, from_csv, read_text, to_csv
from ._warnings import warn

PathLike: TypeAlias = Union[str, "os.PathLike[str]"]


class Model:
    """A model of links, as ``learn`` returns it.

    Attributes
    ----------
    text : str
        The content of the model file.
    report : dict
        The object that the command prints with ``--json``.

    Examples
    --------
    >>> import tempfile
    >>> model = pingmap.learn(pingmap.simulate(vehicles=2, slots=60, seed=1), additions="range")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     model.save(f"{folder}/model.toml")
    ...     pingmap.Model.read(f"{folder}/model.toml").text == model.text
    True
    """

    def __init__(self, text: str, report: dict[str, Any] | None = None) -> None:
        self.text = text
        self.report = report or {}

    @classmethod
    def read(cls, path: PathLike) -> Model:
        """Reads a model file. Its content is checked when it is used."""
        return cls(read_text(path))

    def save(self, path: PathLike) -> None:
        """Writes the model file, which all commands read with ``--model``."""
        Path(path).write_text(self.text, encoding="utf-8")

    def __repr__(self) -> str:
        return f"<pingmap.Model of {len(self.text.splitlines())} lines>"


class Workspace:
    """A temporary folder for the files of one command. It is removed after the command, also after errors."""

    def __init__(self) -> None:
        self.folder = tempfile.TemporaryDirectory(prefix="pingmap-")

    def __enter__(self) -> Workspace:
        return self

    def __exit__(self, *_: object) -> None:
        self.folder.cleanup()

    def path(self, name: str) -> str:
        """Returns the path of a file of the folder."""
        return os.path.join(self.folder.name, name)

    def file(self, content: Any, name: str) -> str:
        """Returns the path of a file. Tables and models are first written to a file of this name."""
        if isinstance(content, (str, os.PathLike)):
            return os.fsdecode(content)
        text = content.text if isinstance(content, Model) else to_csv(content)
        Path(self.path(name)).write_text(text, encoding="utf-8")
        return self.path(name)

    def logs(self, log: TableLike | Sequence[TableLike]) -> list[str]:
        """Returns the paths of one or several logs."""
        several = log if isinstance(log, (list, tuple)) else [log]
        return [self.file(one, f"log{number or ''}.csv") for number, one in enumerate(several)]

    def run(self, command: str, words: Sequence[str], options: dict[str, Any], **own: Any) -> str:
        """Runs a command and returns the text that it prints. Messages do not name the folder.

        The options of the caller and those in ``own`` are joined, so that the command refuses one that is in both.
        """
        if options.get("help"):
            raise ValueError(f'{command}: expected no option help; see pingmap.run("{command}", "--help")')
        options = {"quiet": True, **options}
        if isinstance(options.get("model"), Model):
            options["model"] = self.file(options["model"], "model.toml")
        given = [command, *arguments(options), *arguments(own), "--", *words]
        refuse_standard_input(given)
        try:
            printed = _pingmap.run(given, lambda text: warn(self.without_folder(text)))
        except (ValueError, _pingmap.Error) as error:
            raise type(error)(self.without_folder(str(error))) from None
        return self.without_folder(printed)

    def without_folder(self, text: str) -> str:
        """Returns the text with the names of the folder's files instead of their paths."""
        return text.replace(self.folder.name + os.sep, "")

    def table(self, command: str, words: Sequence[str], options: dict[str, Any]) -> Table:
        """Runs a command that writes a table and prints a report."""
        output = self.path("table.csv")
        report = self.run(command, words, options, output=output, json=True)
        table = from_csv(read_text(output))
        table.report = json.loads(report)
        return table
