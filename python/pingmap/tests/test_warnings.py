"""Warnings of commands are warnings of Python."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pingmap


def test_a_warning_names_the_line_of_the_caller(
    log: Path, model: Path, links: dict[str, Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    table, output = pingmap.read_log(log), tmp_path / "map.csv"
    words = ["--at=100,200", "--cell-m=200", f"--model={model}", "--events-max=30", "--quiet", "-o", output]
    calls = [
        lambda: pingmap.predict(table, links, model=model, events_max=30),
        lambda: pingmap.run("map", log, *words),
    ]
    for call in calls:
        with pytest.warns(pingmap.Warning, match="^using 30 of ") as found:
            call()
        assert [warning.filename for warning in found] == [__file__]
    assert capfd.readouterr().err == "", "nothing goes to standard error"
    assert issubclass(pingmap.Warning, UserWarning)


def test_a_warning_does_not_name_the_folder_of_the_command(log: Path, model: Path, links: dict[str, Any]) -> None:
    with pytest.warns(pingmap.Warning, match=r"^links\.csv: predictions replace the values of probability"):
        pingmap.predict(log, links | {"probability": np.zeros(3)}, model=model)


def test_a_warning_can_be_an_exception(log: Path, model: Path, links: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", pingmap.Warning)
        with pytest.raises(pingmap.Warning, match="using 30 of"):
            pingmap.predict(log, links, model=model, events_max=30)
        pingmap.predict(log, links, model=model)


def test_a_failure_comes_after_the_warnings(log: Path, model: Path, links: dict[str, Any]) -> None:
    del links["rx_northing_m"]
    with pytest.warns(pingmap.Warning, match="using 30 of"), pytest.raises(ValueError, match="rx_northing_m"):
        pingmap.predict(log, links, model=model, events_max=30)


def test_an_agent_warns_of_a_key_that_others_can_read(log: Path, model: Path, tmp_path: Path) -> None:
    team, key = tmp_path / "team.toml", tmp_path / "team.key"
    key.write_text("0123456789abcdef" * 4 + "\n")
    os.chmod(key, 0o600)
    pingmap.run("team", str(log), "--model", str(model), "--key-file", str(key), "-o", str(team))
    os.chmod(key, 0o644)
    with pytest.warns(pingmap.Warning, match="others on this machine can read the key") as found:
        pingmap.Agent("auv1", team)
    assert [warning.filename for warning in found] == [__file__]
