"""Ctrl-C stops every function within a second, and leaves no file."""

from __future__ import annotations

import gzip
import multiprocessing
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import pingmap
from pingmap import Agent

SCRIPT = """
import signal, sys, tempfile
import numpy
import pingmap
# A shell script that starts Python in the background makes it ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
tempfile.tempdir = sys.argv[2]
log = sys.argv[1]
names = ["tx_easting_m", "tx_northing_m", "rx_easting_m", "rx_northing_m"]
links = dict(zip(names, numpy.linspace(0, 1000, 100_000).reshape(4, 25_000)))
print("begin", flush=True)
try:
    {call}
    print("finished", flush=True)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""

#: Calls that take several seconds.
CALLS = {
    "learn": "pingmap.learn(log)",
    "replay": "pingmap.replay(log, repeats=20)",
    "replay online": "pingmap.replay(log, online=True)",
    "map": "pingmap.map(log, (0, 0), model=sys.argv[3], cell_m=2, events_max=1200)",
    "predict": "pingmap.predict(log, links, model=sys.argv[3], events_max=1200)",
    "simulate": "pingmap.simulate(vehicles=4, slots=40_000)",
    "import": "pingmap.import_mission(sys.argv[4])",
}


@pytest.fixture(scope="module")
def long_log(folder: Path) -> Path:
    """An event log from which learning takes several seconds."""
    path = folder / "long.csv"
    pingmap.run("simulate", "--vehicles=4", "--slots=1200", "-o", str(path))
    return path


@pytest.fixture(scope="module")
def long_archive(folder: Path) -> Path:
    """A compressed log of 8 GB, which takes many seconds to unpack."""
    path = folder / "long.alog.gz"
    path.write_bytes(gzip.compress(b"% no record of a vehicle\n" * 400_000, 1) * 800)
    return path


@pytest.mark.parametrize("name", CALLS)
@pytest.mark.parametrize("after_s", [0.4, 1.3])
def test_ctrl_c_ends_a_function_within_a_second(
    long_log: Path, long_archive: Path, model: Path, tmp_path: Path, name: str, after_s: float
) -> None:
    program = SCRIPT.format(call=CALLS[name])
    words = [sys.executable, "-c", program, str(long_log), str(tmp_path), str(model), str(long_archive)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "begin\n"
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        answer, errors = process.communicate(timeout=60)
        took_s = time.monotonic() - begin
    assert answer == "interrupted\n", errors
    # The end of the interpreter is included.
    assert took_s < 1.5, f"{took_s:.2f} s"
    assert list(tmp_path.iterdir()) == []


def test_other_threads_run_during_a_command(long_log: Path, model: Path) -> None:
    ticks = 0
    thread = threading.Thread(target=lambda: pingmap.replay(long_log, model=model, repeats=2, frames=[1]))
    thread.start()
    while thread.is_alive():
        time.sleep(0.01)
        ticks += 1
    assert ticks > 5


def test_a_forked_process_runs_commands_and_agents(log: Path, model: Path, team: Path) -> None:
    expected = pingmap.replay(log, model=model, frames=[1])["sharing"]
    Agent("survey", team, record_all_receivers=True).record(log)
    with multiprocessing.get_context("fork").Pool(1) as pool:
        found = pool.apply_async(replayed, (log, model, team)).get(timeout=60)
    assert found == expected


def replayed(log: Path, model: Path, team: Path) -> object:
    """Uses an agent, which learns, and then replays a log."""
    agent = Agent("survey", team, record_all_receivers=True)
    agent.record(log)
    agent.adapt()
    return pingmap.replay(log, model=model, frames=[1])["sharing"]


def test_two_threads_run_commands_at_once(log: Path, model: Path) -> None:
    expected = pingmap.replay(log, model=model, frames=[1])
    found = []

    def replay() -> None:
        found.append(pingmap.replay(log, model=model, frames=[1])["sharing"])

    threads = [threading.Thread(target=replay) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected["sharing"]] * 2
