"""Sweeps: order, interruption, damaged results, and bad tasks."""

from __future__ import annotations

import errno
import functools
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pingmap
from pingmap.sweep import grid, replay_scores, simulated_scores, sweep


def area(width: float, height: float) -> dict[str, float]:
    return {"area": width * height}


def unstorable(x: int) -> dict[str, object]:
    return {"result": object()}


def same(x: int) -> dict[str, int]:
    return {"x": x}


def mortal(x: int) -> dict[str, int]:
    if os.environ.get("PINGMAP_TEST_DIES_AT") == str(x):
        os._exit(1)
    return {"result": x * x}


TASKS = grid(width=[1.0, 2.0], height=[3.0, 4.0, 5.0])


def files(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_the_table_has_a_row_for_each_task_in_order(tmp_path: Path) -> None:
    table = sweep(area, TASKS, tmp_path)
    assert table["width"] == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    assert table["area"] == [3.0, 4.0, 5.0, 6.0, 8.0, 10.0]


def test_files_and_table_do_not_depend_on_workers_or_order(tmp_path: Path) -> None:
    expected = sweep(area, TASKS, tmp_path / "one")
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        assert sweep(area, TASKS, tmp_path / "two", map=processes.map) == expected

    def backwards(function: Callable[..., Any], *items: Iterable[Any]) -> list[Any]:
        return [function(*arguments) for arguments in reversed(list(zip(*items)))]

    assert sweep(area, TASKS, tmp_path / "three", map=backwards) == expected
    assert files(tmp_path / "one") == files(tmp_path / "two") == files(tmp_path / "three")


def test_ray_gives_the_same_files_and_the_errors_of_tasks(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray", reason="Ray is not installed")
    workers_of_ray = pytest.importorskip("pingmap.ray", reason="dgpc is not installed", exc_type=ImportError)
    folder, tasks = tmp_path / "ray", grid(seed=[1, 2, 3], vehicles=[2], slots=[60])
    expected = sweep(simulated_scores, tasks, tmp_path / "one")
    ray.init(num_cpus=2, object_store_memory=200_000_000, include_dashboard=False, log_to_driver=False)
    try:
        with workers_of_ray.Workers(2) as workers:
            assert sweep(simulated_scores, tasks, folder, map=workers.map) == expected
            with pytest.raises(ValueError, match="--vehicles"):
                sweep(simulated_scores, grid(seed=[1], vehicles=[-1]), folder, map=workers.map)
    finally:
        ray.shutdown()
    assert files(folder) == files(tmp_path / "one")


def test_workers_of_ray_without_ray_name_the_extra() -> None:
    program = (
        "import sys; sys.modules['ray'] = None\n"
        "try: import pingmap.ray\n"
        "except ImportError as error: assert 'pingmap[ray]' in str(error)\n"
        "else: raise SystemExit('no error')"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_modules_are_attributes_of_the_package() -> None:
    program = (
        "import sys, pingmap\n"
        "assert not {'ray', 'dgpc', 'pingmap.sweep'} & set(sys.modules)\n"
        "assert pingmap.sweep.grid(seed=[1]) == [{'seed': 1}]\n"
        "sys.modules['ray'] = None\n"
        "try: pingmap.ray\n"
        "except ImportError as error: assert 'pingmap[ray]' in str(error)\n"
        "else: raise SystemExit('no error')\n"
        "try: pingmap.nothing\n"
        "except AttributeError as error: assert 'nothing' in str(error)\n"
        "else: raise SystemExit('no error')"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_an_interrupted_sweep_continues_where_it_stopped(tmp_path: Path) -> None:
    class Interrupted(Exception):
        pass

    def three(done: int, tasks: int) -> None:
        if done == 3:
            raise Interrupted

    with pytest.raises(Interrupted):
        sweep(area, TASKS, tmp_path, progress=three)
    assert len(files(tmp_path)) == 3
    seen: list[tuple[int, int]] = []
    again = sweep(area, TASKS, tmp_path, progress=lambda *progress: seen.append(progress))
    assert seen[0] == (3, 6) and seen[-1] == (6, 6)
    assert again == sweep(area, TASKS, tmp_path / "whole")


def test_a_damaged_result_is_computed_again(tmp_path: Path) -> None:
    expected = sweep(area, TASKS, tmp_path)
    for number, damage in enumerate([b"", b"{", b"[1]"]):
        sorted(tmp_path.iterdir())[number].write_bytes(damage)
    assert sweep(area, TASKS, tmp_path) == expected


def test_a_full_disk_leaves_no_half_result_and_names_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = sweep(area, TASKS, tmp_path / "whole")
    sweep(area, TASKS[:2], tmp_path / "full")
    before = files(tmp_path / "full")

    def fails(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as disk:
        disk.setattr(os, "fsync", fails)
        with pytest.raises(pingmap.Error, match=r"/full/\w{64}\.json: cannot be written: No space left on device"):
            sweep(area, TASKS, tmp_path / "full")
    assert files(tmp_path / "full") == before
    assert sweep(area, TASKS, tmp_path / "full") == expected


def test_results_stay_when_a_worker_dies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tasks = grid(x=[0, 1, 2, 3, 4])
    monkeypatch.setenv("PINGMAP_TEST_DIES_AT", "3")
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        with pytest.raises(BrokenProcessPool, match="terminated abruptly"):
            sweep(mortal, tasks, tmp_path, map=processes.map)
    before = files(tmp_path)
    assert len(before) == 3
    monkeypatch.delenv("PINGMAP_TEST_DIES_AT")
    assert sweep(mortal, tasks, tmp_path)["result"] == [0, 1, 4, 9, 16]
    assert before.items() <= files(tmp_path).items() and len(files(tmp_path)) == 5


def test_the_content_of_a_file_is_part_of_the_task(tmp_path: Path) -> None:
    file = tmp_path / "task.txt"

    def size(paths: list[Any]) -> dict[str, int]:
        return {"size": sum(os.stat(path).st_size for path in paths)}

    for given in [[file], [str(file)], [str(file), file]]:
        for content in ["a", "ab"]:
            file.write_text(content)
            found = sweep(size, [{"paths": given}], tmp_path / "results")
            assert found["size"] == [len(given) * len(content)]
    assert len(files(tmp_path / "results")) == 6


def test_bad_tasks_and_results_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="two tasks of the sweep are equal"):
        sweep(area, [TASKS[0], TASKS[0]], tmp_path)
    with pytest.raises(ValueError, match="numbers, text and paths"):
        sweep(area, [{"width": object(), "height": 1.0}], tmp_path)
    with pytest.raises(ValueError, match="cannot be stored"):
        sweep(unstorable, [{"x": 1}], tmp_path)
    assert not files(tmp_path), "no half result remains"
    with pytest.raises(ValueError, match="the workers stored no result of the task"):
        sweep(area, TASKS, tmp_path, map=lambda *arguments: [])
    with pytest.raises(TypeError, match="unexpected keyword"):
        sweep(area, [{"depth": 1.0}], tmp_path)


def test_simulated_missions_and_replays_are_tasks(tmp_path: Path, log: Path) -> None:
    table = sweep(simulated_scores, grid(seed=[1, 2], vehicles=[2], slots=[60]), tmp_path)
    assert all(0.0 < own < 1.5 for own in table["own"]) and table["own"][0] != table["own"][1]
    table = sweep(replay_scores, grid(log=[log], repeats=[1], frames=[1, 5]), tmp_path)
    assert table["centralised"][0] == table["centralised"][1] and len(table["team"]) == 2
    assert json.dumps([table["own"], table["team"]])


def test_the_example_with_times_runs() -> None:
    example = Path(__file__).parents[1] / "examples" / "sweep_times.py"
    finished = subprocess.run([sys.executable, str(example), "1", "60"], capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    assert "| concurrent.futures | 2 |" in finished.stdout
    assert "| Ray | 2 |" in finished.stdout or "skipped: Ray: " in finished.stdout


def test_functions_of_one_name_have_results_of_their_own(tmp_path: Path) -> None:
    def twice(x: int) -> dict[str, int]:
        return {"result": 2 * x}

    first = twice

    def twice(x: int) -> dict[str, int]:  # noqa: F811
        return {"result": x + x + 1}

    tasks = grid(x=np.arange(1, 3))
    assert sweep(first, tasks, tmp_path)["result"] == [2, 4]
    assert sweep(twice, tasks, tmp_path)["result"] == [3, 5]


def test_functions_that_differ_in_default_values_have_results_of_their_own(tmp_path: Path) -> None:
    def scaled(factor: int) -> Callable[..., dict[str, int]]:
        def scale(x: int, factor: int = factor) -> dict[str, int]:
            return {"result": factor * x}

        return scale

    def shifted(offset: int) -> Callable[..., dict[str, int]]:
        def shift(x: int, *, offset: int = offset) -> dict[str, int]:
            return {"result": offset + x}

        return shift

    assert [sweep(scaled(factor), grid(x=[5]), tmp_path)["result"] for factor in [2, 3]] == [[10], [15]]
    assert [sweep(shifted(offset), grid(x=[5]), tmp_path)["result"] for offset in [2, 3]] == [[7], [8]]


def test_functions_without_a_source_of_their_own_are_refused(tmp_path: Path) -> None:
    class Area:
        __qualname__ = "area"  # type: ignore[assignment]

        def __call__(self, x: int) -> dict[str, int]:
            return {"result": x}

    names: dict[str, Any] = {}
    exec("def hidden(x): return {'result': x}", names)
    offset = 1
    for function, words in [
        (Area(), "defined with def"),
        (lambda x: {"result": x}, "defined with def"),
        (lambda x: {"result": x + offset}, "defined with def"),
        (functools.partial(same, x=1), "defined with def"),
        (dict, "defined with def"),
        ("".join, "defined with def"),
        (names["hidden"], "defined in a file"),
    ]:
        with pytest.raises(ValueError, match=words):
            sweep(function, grid(x=[1]), tmp_path)
    assert not files(tmp_path)


def test_results_of_another_build_are_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for build in ["one", "two"]:
        monkeypatch.setattr("pingmap.sweep._build", lambda: build)
        sweep(area, TASKS, tmp_path)
    assert len(files(tmp_path)) == 2 * len(TASKS)


def test_results_do_not_replace_parameters(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="'x' of a parameter"):
        sweep(same, grid(x=[1]), tmp_path)
