"""The quick start of the README runs, and its outputs are as printed. So do the examples of docstrings."""

from __future__ import annotations

import doctest
import os
import re
from pathlib import Path

import pytest

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


def test_the_examples_of_docstrings_run() -> None:
    from pingmap import _commands

    result = doctest.testmod(_commands, extraglobs={"pingmap": pingmap})
    assert result.attempted > 0 and result.failed == 0
