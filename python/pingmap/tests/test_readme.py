"""The quick start of the README runs, and its outputs are as printed. So do the examples of docstrings."""

from __future__ import annotations

import doctest
import os
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import REPOSITORY

import pingmap

README = Path(__file__).parents[1] / "README.md"


def test_the_quick_start_runs_twice_in_one_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 3
    for _ in range(2):
        names: dict[str, object] = {}
        for block in blocks:
            exec(compile(block, str(README), "exec"), names)
    assert not any(name.startswith("pingmap-") for name in os.listdir(tmp_path))


def test_the_members_of_a_batch_array_share_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    guide = (REPOSITORY / "docs/guides/python.md").read_text(encoding="utf-8")
    (program,) = (block for block in re.findall(r"```python\n(.*?)```", guide, re.DOTALL) if "SLURM" in block)
    program = program.replace("range(1, 1001)", "range(1, 6)").replace("slots=[200]", "slots=[60]")

    def seeds() -> object:
        names: dict[str, Any] = {}
        exec(compile(program, "missions.py", "exec"), names)
        return names["table"]["seed"]

    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "2")
    for member, expected in [("0", [1, 3, 5]), ("1", [2, 4])]:
        monkeypatch.setenv("SLURM_ARRAY_TASK_ID", member)
        assert seeds() == expected
    stored = {file: file.stat().st_mtime_ns for file in (tmp_path / "sweep-results").iterdir()}
    monkeypatch.delenv("SLURM_ARRAY_TASK_COUNT")
    monkeypatch.delenv("SLURM_ARRAY_TASK_ID")
    assert seeds() == [1, 2, 3, 4, 5]
    assert stored == {file: file.stat().st_mtime_ns for file in (tmp_path / "sweep-results").iterdir()}


#: Functions and classes without an example: those of errors, and the result of `Agent.receive`.
WITHOUT_EXAMPLE = {"pingmap.Error", "pingmap.Receipt", "pingmap.Warning"}


def test_every_function_has_an_example_that_runs() -> None:
    modules = {"pingmap": pingmap, "pingmap.sweep": pingmap.sweep}
    found = [(f"{module}.{name}", getattr(of, name)) for module, of in modules.items() for name in of.__all__]
    assert len(found) >= 18
    finder, runner = doctest.DocTestFinder(recurse=False), doctest.DocTestRunner()
    for name, tested in found:
        (test,) = finder.find(tested, name, module=sys.modules[tested.__module__], extraglobs={"pingmap": pingmap})
        assert bool(test.examples) != (name in WITHOUT_EXAMPLE), name
        assert runner.run(test).failed == 0, name
