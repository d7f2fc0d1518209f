"""Data that several tests share."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import pingmap

REPOSITORY = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that the whole session shares."""
    return tmp_path_factory.mktemp("shared")


@pytest.fixture(scope="session")
def log(folder: Path) -> Path:
    """An event log of a simulated mission of three vehicles."""
    path = folder / "log.csv"
    pingmap.run("simulate", "--vehicles=3", "--slots=120", "--seed=7", "-o", str(path))
    return path


@pytest.fixture(scope="session")
def model(folder: Path, log: Path) -> Path:
    """A model file, learned from that log."""
    path = folder / "model.toml"
    pingmap.learn(log, additions="range").save(path)
    return path


@pytest.fixture(scope="session")
def team(folder: Path, log: Path, model: Path) -> Path:
    """A team file of the three vehicles."""
    path = folder / "team.toml"
    pingmap.run("team", str(log), "--model", str(model), "-o", str(path))
    return path


@pytest.fixture
def links() -> dict[str, list[float]]:
    """Three links of different lengths."""
    return {
        "tx_easting_m": [100.0, 100.0, 0.1],
        "tx_northing_m": [200.0, 200.0, 0.2],
        "rx_easting_m": [150.0, 900.0, 1 / 3],
        "rx_northing_m": [260.0, 700.0, 300.0],
    }


@pytest.fixture(params=["module", "program"])
def command_line(request: pytest.FixtureRequest) -> Callable[..., str]:
    """Returns what ``python -m pingmap`` prints, or the compiled program that the variable PINGMAP names."""
    program = [sys.executable, "-m", "pingmap"]
    if request.param == "program":
        if "PINGMAP" not in os.environ:
            pytest.skip("the variable PINGMAP names no compiled program")
        program = [os.environ["PINGMAP"]]

    def run(*arguments: str | Path) -> str:
        finished = subprocess.run([*program, *map(str, arguments)], capture_output=True, text=True, check=True)
        return finished.stdout

    return run
