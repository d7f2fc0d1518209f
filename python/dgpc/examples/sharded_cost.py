"""Measures a fit of events in shards: memory of each process, time of a round, and a cost model.

    python examples/sharded_cost.py          # a million events: four minutes
    python examples/sharded_cost.py 100000   # 100 000 events

The model is T = a + b · N/W + c · S seconds a round, for N events, W workers and S shards. Its coefficients are fitted to
rounds with one and two workers, and extended to 10¹⁰ events on 10³ workers on paper.
"""

import itertools
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor

os.environ["RAYON_NUM_THREADS"] = "1"

import dgpc
import numpy as np
from dgpc.sharded import fit, write_shards

PRIOR = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=4.0, dimension=4))
POINTS = np.random.default_rng(2).uniform(-2.0, 2.0, (80, 4))
PLACES = np.random.default_rng(3).uniform(-2.0, 2.0, (500, 4))
ROUNDS = 8


def events(count):
    random = np.random.default_rng(1)
    x = random.uniform(-2.0, 2.0, (count, 4))
    log_odds = 3.0 * np.cos(x[:, 0] - x[:, 2]) + x[:, 1] * x[:, 3]
    return x, random.random(count) < 1.0 / (1.0 + np.exp(-log_odds))


def memory_mb(_=None):
    time.sleep(0.1)  # So that another worker gets the next task.
    return os.getpid(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def in_one_process(count):
    """Fits all events. Returns seconds, megabytes, and mean and variance at the places."""
    x, y = events(count)
    begin = time.monotonic()
    posterior = dgpc.fit(PRIOR, x, y, inducing_points=POINTS).posterior()
    return time.monotonic() - begin, memory_mb()[1], posterior.latent(PLACES)


def in_shards(paths, workers, rounds):
    """Fits the events of the files. Returns seconds, seconds a round, the largest megabytes of a worker, and the fit."""
    times = [time.monotonic()]
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        found = fit(PRIOR, paths, POINTS, map=pool.map, iterations_max=rounds,
                    progress=lambda *_: times.append(time.monotonic()))
        memory = dict(pool.map(memory_mb, range(4 * workers)))
    # The first round reads the files.
    return times[-1] - times[0], float(np.median(np.diff(times[2:]))), max(memory.values()), found


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        seconds, memory, alone = pool.submit(in_one_process, count).result()
    print("| processes | seconds | MB in each | difference of means and variances |\n|---|---|---|---|")
    print(f"| 1, all events | {seconds:.1f} | {memory:.0f} | – |")
    measured = []
    with tempfile.TemporaryDirectory() as folder:
        for size, shards in itertools.product([count // 4, count // 2, count], [4, 16]):
            paths = write_shards(f"{folder}/{size}-{shards}", *events(size), shards=shards)
            for workers in [1, 2]:
                is_whole = (size, shards, workers) == (count, 16, 2)
                seconds, round_s, memory, found = in_shards(paths, workers, 1000 if is_whole else ROUNDS)
                measured.append((size / workers, shards, round_s))
                if is_whole:
                    apart = np.abs(np.subtract(found.posterior.latent(PLACES), alone)).max()
                    print(f"| 2 workers, 16 shards | {seconds:.1f} | {memory:.0f} | {apart:.0e} |")
    share, shards, round_s = np.array(measured).T
    # Least squares of relative errors.
    design = np.stack([np.ones_like(share), share, shards], axis=1) / round_s[:, None]
    model = np.linalg.lstsq(design, np.ones_like(share), rcond=None)[0]
    errors = np.abs(design @ model - 1.0)
    print(f"\nT = {model[0]:.3f} s + {1e6 * model[1]:.3f} µs · N/W + {1e3 * model[2]:.2f} ms · S; largest error"
          f" {100 * errors.max():.0f} % of {len(measured)} cases with {share.min():.0f} to {share.max():.0f} events a worker")
    far = model @ [1.0, 1e7, 1e3]
    print(f"On paper: 10¹⁰ events on 10³ workers, a shard each: {far:.0f} s and {found.contribution_bytes / 1e3:.0f} MB a round")


if __name__ == "__main__":
    main()
