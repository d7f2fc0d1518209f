"""The functions give the numbers of the command line, bit for bit."""

from __future__ import annotations

import csv
import functools
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import REPOSITORY

import pingmap

#: Runs the command line, and returns what it prints.
CommandLine = Callable[..., str]

#: Keys whose values differ between two runs of one command.
VARYING = {"command", "file", "seconds"}


def stable(report: Any) -> Any:
    """Returns a report without the values that differ between two runs."""
    if isinstance(report, dict):
        return {key: stable(value) for key, value in report.items() if key not in VARYING}
    return [stable(value) for value in report] if isinstance(report, list) else report


def columns(text: str) -> dict[str, list[str]]:
    """Returns the columns of CSV as text."""
    rows = csv.reader(line for line in text.splitlines() if not line.startswith("#"))
    header = next(rows)
    return dict(zip(header, map(list, zip(*rows)), strict=True))


def assert_equal(table: pingmap.Table, text: str) -> None:
    """Checks that a table has the columns of CSV, and every number exactly."""
    expected = columns(text)
    assert list(table) == list(expected)
    for name, fields in expected.items():
        if table[name].dtype.kind == "U":
            assert table[name].tolist() == fields
        else:
            assert np.array_equal(table[name], [float(field or "nan") for field in fields], equal_nan=True), name


def test_learn_writes_the_same_model_file(log: Path, tmp_path: Path, command_line: CommandLine) -> None:
    output = tmp_path / "model.toml"
    printed = command_line("learn", log, "--additions", "range", "--test-share", "0.3", "--json", "-o", output)
    learned = pingmap.learn(log, additions="range", test_share=0.3)
    assert learned.text == output.read_text()
    assert stable(learned.report) == stable(json.loads(printed))


def test_predict_gives_the_same_numbers(
    log: Path, model: Path, links: dict[str, list[float]], tmp_path: Path, command_line: CommandLine
) -> None:
    path = tmp_path / "links.csv"
    rows = zip(*links.values(), strict=True)
    path.write_text("\n".join([",".join(links), *(",".join(map(repr, row)) for row in rows)]))
    printed = command_line("predict", log, "--model", model, "--links", path, "--time", "typical")
    for given in (links, path, {name: np.array(values) for name, values in links.items()}):
        assert_equal(pingmap.predict(log, given, model=model, time="typical"), printed)


def test_map_gives_the_same_numbers_as_arrays_with_coordinates(
    log: Path, model: Path, tmp_path: Path, command_line: CommandLine
) -> None:
    output = tmp_path / "map.csv"
    options = ["--at", "600,600", "--at", "100,200", "--cell-m", "100", "--as", "rx", "--json"]
    printed = json.loads(command_line("map", log, "--model", model, *options, "-o", output))
    map = pingmap.map(log, [(600, 600), (100, 200)], model=model, cell_m=100, as_="rx")
    expected = columns(output.read_text())
    shape = (printed["rows"], printed["columns"])
    assert map["probability"].shape == map["explained"].shape == shape
    assert map["easting_m"].shape == shape[1:] and map["northing_m"].shape == shape[:1]
    for name in ("probability", "lower", "upper", "explained"):
        assert np.array_equal(map[name].ravel(), [float(field) for field in expected[name]])
    eastings, northings = np.meshgrid(map["easting_m"], map["northing_m"])
    assert np.array_equal(eastings.ravel(), [float(field) for field in expected["easting_m"]])
    assert np.array_equal(northings.ravel(), [float(field) for field in expected["northing_m"]])
    assert stable(map.report) == stable(printed)


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (["--frames", "1,5", "--repeats", "2"], {"frames": [1, 5], "repeats": 2}),
        (["--online", "--slot-every", "5"], {"online": True, "slot_every": 5}),
        (["--frames", "2", "--loss", "0.3", "--seed", "5"], {"frames": [2], "loss": 0.3, "seed": 5}),
    ],
)
def test_replay_returns_the_object_of_the_command_line(
    log: Path, model: Path, words: list[str], options: dict[str, Any], command_line: CommandLine
) -> None:
    printed = json.loads(command_line("replay", log, "--model", model, *words, "--json"))
    assert stable(pingmap.replay(log, model=model, **options)) == stable(printed)


def test_simulate_gives_the_same_log(tmp_path: Path, command_line: CommandLine) -> None:
    output = tmp_path / "log.csv"
    command_line("simulate", "--vehicles", "4", "--slots", "50", "--seed", "3", "--depths", "-o", output)
    assert_equal(pingmap.simulate(vehicles=4, slots=50, seed=3, depths=True), output.read_text())


def test_import_gives_the_same_log_and_the_same_report(tmp_path: Path, command_line: CommandLine) -> None:
    mission, output = REPOSITORY / "examples/mission", tmp_path / "log.csv"
    printed = command_line(
        "import", mission, "--always-transmits", "--correct-clocks", "auv1", "--json", "-o", output
    )
    imported = pingmap.import_mission(mission, always_transmits=True, correct_clocks="auv1")
    assert_equal(imported, output.read_text())
    assert stable(imported.report) == stable(json.loads(printed))
    assert imported.reference_system is not None
    assert f"# reference system: {imported.reference_system}" in output.read_text()
    assert_equal(pingmap.read_log(output), output.read_text())


def test_a_log_that_was_read_gives_the_same_model_as_its_file(log: Path) -> None:
    table = pingmap.read_log(log)
    assert set(table) >= {"time_s", "tx_id", "success", "true_probability"}
    learned = pingmap.learn(table, additions="range")
    expected = pingmap.learn(log, additions="range")
    assert learned.text == expected.text
    assert pingmap.learn([table], additions="range").text == expected.text


def test_a_returned_model_serves_as_a_model_file(log: Path, model: Path, links: dict[str, list[float]]) -> None:
    learned = pingmap.Model.read(model)
    by_model, by_path = (pingmap.predict(log, links, model=given) for given in (learned, model))
    assert all(np.array_equal(by_model[name], by_path[name]) for name in by_path)


def test_the_script_has_the_exit_status_of_the_program(tmp_path: Path) -> None:
    for words, status in ([], 2), (["--version"], 0), (["learn", "none.csv"], 2), (["learn", "--nonsense"], 2):
        finished = subprocess.run([sys.executable, "-m", "pingmap", *words], cwd=tmp_path, capture_output=True)
        assert finished.returncode == status, finished


@pytest.fixture(scope="module")
def short_log(folder: Path) -> Path:
    """An event log of 60 slots."""
    path = folder / "short.csv"
    pingmap.run("simulate", "--vehicles=2", "--slots=60", "--seed=1", "-o", path)
    return path


def test_fleet_runs_the_vehicles_with_the_program_of_the_package(short_log: Path) -> None:
    found = json.loads(pingmap.run("fleet", short_log, "--no-kill", "--json"))
    program = [sys.executable, "-m", "pingmap", "fleet", str(short_log), "--no-kill", "--json"]
    printed = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    assert stable(found) == stable(json.loads(printed))


def test_fleet_without_a_program_names_the_option(short_log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_, **__: None)
    with pytest.raises(ValueError, match="found no program pingmap.*--program FILE"):
        pingmap.run("fleet", short_log)
    with pytest.raises(pingmap.Error, match="/none/pingmap"):
        pingmap.run("fleet", short_log, "--program", "/none/pingmap")


def test_standard_input_is_refused_and_standard_output_is_not(short_log: Path, model: Path) -> None:
    words = [
        ["learn", "-"],
        ["predict", short_log, "--links=-"],
        ["import", "--nav", "auv1=-"],
        ["vehicle"],
        ["--quiet", "vehicle"],
    ]
    calls = [lambda: pingmap.learn("-"), lambda: pingmap.predict(short_log, "-", model=model)]
    for call in [*calls, *(functools.partial(pingmap.run, *given) for given in words)]:
        with pytest.raises(ValueError, match="standard input is not available in Python; give a path"):
            call()
    for output in [["-o", "-"], ["--output", "-"], ["--output=-"]]:
        assert pingmap.run("simulate", "--slots=2", "--quiet", *output).startswith("time_s,tx_id")
    assert pingmap.run("vehicle", "--example").startswith("#")


def test_help_and_version_are_results() -> None:
    assert "--test-share" in pingmap.run("learn", "--help")
    assert pingmap.run("--version").strip() == f"pingmap {pingmap.__version__}"
