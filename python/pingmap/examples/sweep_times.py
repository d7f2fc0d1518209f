"""Prints the times of one sweep on several engines, with one and with two workers.

    python examples/sweep_times.py [MISSIONS [SLOTS]]

A task simulates a mission and replays it with random splits or with blocks of time. Every engine must store the same
files. The start of the workers is not part of the sweep.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

# One thread for each worker. Libraries read the variable when they start their threads.
os.environ["RAYON_NUM_THREADS"] = "1"

from pingmap.sweep import grid, simulated_scores, sweep

Map = Callable[..., Any]


@contextmanager
def in_this_process(workers: int) -> Iterator[Map]:
    yield map


@contextmanager
def processes(workers: int) -> Iterator[Map]:
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as executor:
        # A process starts with its first task.
        list(executor.map(time.sleep, [0.5] * workers))
        yield executor.map


@contextmanager
def ray_workers(workers: int) -> Iterator[Map]:
    import ray

    from pingmap.ray import Workers

    ray.init(num_cpus=2, object_store_memory=200_000_000, include_dashboard=False, log_to_driver=False)
    try:
        with Workers(workers) as several:
            list(several.map(time.sleep, [0.5] * workers))
            yield several.map
    finally:
        ray.shutdown()


ENGINES = [
    ("this process", in_this_process, 1),
    ("concurrent.futures", processes, 1),
    ("concurrent.futures", processes, 2),
    ("Ray", ray_workers, 1),
    ("Ray", ray_workers, 2),
]


def main(missions: int = 12, slots: int = 200) -> None:
    tasks = grid(seed=list(range(1, missions + 1)), split_by=["random", "time"], slots=[slots], vehicles=[3])
    print(f"{missions} missions × 2 kinds of splits, {slots} transmissions each; load average {os.getloadavg()[0]:.1f}")
    print("| engine | workers | start in s | sweep in s | ratio |\n|---|---|---|---|---|")
    alone_s, expected = None, None
    for name, engine, workers in ENGINES:
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            try:
                with engine(workers) as run:
                    started = time.perf_counter()
                    sweep(simulated_scores, tasks, folder, map=run)
                    ended = time.perf_counter()
            except ImportError as error:
                print(f"skipped: {name}: {error}")
                continue
            files = {file.name: file.read_bytes() for file in Path(folder).iterdir()}
        alone_s, expected = alone_s or ended - started, expected or files
        assert files == expected, "the engines stored different files"
        start_s, sweep_s = started - begin, ended - started
        print(f"| {name} | {workers} | {start_s:.1f} | {sweep_s:.1f} | {alone_s / sweep_s:.2f} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
