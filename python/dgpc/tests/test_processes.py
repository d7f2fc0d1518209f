"""Threads, forked processes and interruption."""

import os
import signal
import subprocess
import sys
import threading
import time

import dgpc
import numpy as np
import pytest

X = np.random.default_rng(1).normal(size=(900, 2))
Y = np.hypot(*X.T) < 1.2


@pytest.mark.parametrize("work", ["fit", "gibbs", "Candidates"])
def test_other_threads_run_during_work(prior: dgpc.Prior, work: str) -> None:
    jobs = {
        "fit": lambda: dgpc.fit(prior, X, Y),
        "gibbs": lambda: dgpc.gibbs(prior, X, Y, 20, seed=1, warm_up=1),
        "Candidates": lambda: dgpc.Candidates(prior, X).minimise_trace(20),
    }
    thread, ticks = threading.Thread(target=jobs[work]), []
    thread.start()
    while thread.is_alive():
        ticks.append(time.perf_counter())
        time.sleep(0.001)
    assert len(ticks) > 5 and np.diff(ticks).max() < 0.5


def test_threads_share_one_posterior(prior: dgpc.Prior) -> None:
    posterior = dgpc.fit(prior, X[:200], Y[:200]).posterior()
    expected, results = posterior.latent(X), []
    threads = [threading.Thread(target=lambda: results.append(posterior.latent(X))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 4
    for result in results:
        np.testing.assert_array_equal(result, expected)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
def test_a_forked_process_computes_and_does_not_hang(prior: dgpc.Prior) -> None:
    expected = dgpc.fit(prior, X, Y, inducing_points=50).evidence
    child = os.fork()
    if child == 0:
        try:
            os._exit(0 if dgpc.fit(prior, X, Y, inducing_points=50).evidence == expected else 1)
        finally:
            os._exit(2)
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            assert os.waitstatus_to_exitcode(status) == 0
            return
        time.sleep(0.01)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    pytest.fail("the forked process hangs")


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ on Windows")
def test_ctrl_c_stops_sampling_within_a_second(prior: dgpc.Prior) -> None:
    timer = threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        dgpc.gibbs(prior, X, Y, 100_000, seed=1)
    assert time.monotonic() - begin < 1.3


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ on Windows")
@pytest.mark.parametrize("work", ["fit", "posterior"])
def test_ctrl_c_does_not_wait_for_the_end_of_a_long_matrix_operation(work: str) -> None:
    # One factorisation of 8000 rows takes several seconds on one thread. The process ends while it runs.
    program = f"""
import os, signal, threading, time
import dgpc, numpy as np
signal.signal(signal.SIGINT, signal.default_int_handler)
x = np.random.default_rng(1).uniform(-3.0, 3.0, (8000, 2))
prior = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=4.0, dimension=2))
sites = dgpc.Sites(x, x[:, 0] > 0, np.full(8000, 0.2))
jobs = dict(fit=lambda: dgpc.fit(prior, x, x[:, 0] > 0), posterior=lambda: dgpc.Posterior(prior, sites))
threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
begin = time.monotonic()
try:
    jobs["{work}"]()
except KeyboardInterrupt:
    took = time.monotonic() - begin
    small = dgpc.fit(prior, x[:20], x[:20, 0] > 0).posterior().probability(x[:3])
    print("stopped after", took, len(small))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120,
                          env={**os.environ, "RAYON_NUM_THREADS": "1"})
    assert done.returncode == 0 and done.stdout.startswith("stopped after"), (done.stdout, done.stderr)
    assert float(done.stdout.split()[2]) < 1.5 and done.stdout.split()[3] == "3"


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ on Windows")
@pytest.mark.parametrize("work", ["fit", "learn", "predict"])
def test_ctrl_c_stops_fits_learning_and_predictions_within_a_second(prior: dgpc.Prior, work: str) -> None:
    x, y = np.tile(X, (12, 1)) + np.linspace(0.0, 1e-3, 12 * len(X))[:, None], np.tile(Y, 12)
    posterior = dgpc.Posterior(prior, dgpc.Sites(x[:1500], y[:1500], np.full(1500, 0.2)))
    jobs = {
        "predict": lambda: posterior.probability(np.tile(x, (100, 1))),
        "fit": lambda: dgpc.fit(prior, x, y, inducing_points=400, tolerance=0.0),
        "learn": lambda: dgpc.learn(prior, x[:2400], y[:2400], tolerance=0.0),
    }
    timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        jobs[work]()
    assert time.monotonic() - begin < 1.5


def test_long_work_reports_progress_and_ends_with_its_exceptions(prior: dgpc.Prior) -> None:
    class Enough(Exception):
        pass

    seen = []

    def report(progress: dict[str, object]) -> None:
        seen.append(progress)
        if len(seen) == 2:
            raise Enough

    begin = time.monotonic()
    with pytest.raises(Enough):
        for _ in range(100):
            dgpc.learn(prior, np.tile(X, (3, 1)) + np.linspace(0.0, 1e-3, 3 * len(X))[:, None], np.tile(Y, 3),
                       tolerance=0.0, progress=report)
    assert time.monotonic() - begin > 2.0
    assert seen[1]["evaluations"] >= seen[0]["evaluations"] and seen[0]["change"] > 0.0


def test_sampling_reports_the_number_of_sweeps(prior: dgpc.Prior) -> None:
    class Enough(Exception):
        pass

    def report(progress: dict[str, object]) -> None:
        raise Enough(progress)

    with pytest.raises(Enough) as found:
        dgpc.gibbs(prior, X, Y, 1_000_000, seed=1, progress=report)
    (progress,) = found.value.args
    assert progress["iterations"] > 10 and progress["change"] is None


@pytest.mark.skipif(sys.platform == "win32", reason="signals differ on Windows")
def test_ctrl_c_does_not_wait_for_a_visit_of_a_large_shard(prior: dgpc.Prior) -> None:
    x = np.random.default_rng(1).uniform(-3.0, 3.0, (500_000, 2))
    fit = dgpc.ShardedFit(prior, x[:500])
    shard = dgpc.Shard(prior, x, x[:, 0] > 0, fit.inducing_points)
    request = fit.request()
    threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        shard.contribute(request)
    assert time.monotonic() - begin < 1.2
    assert len(shard.mean) == 500_000  # The shard is free again.


def test_a_progress_callable_may_compute_while_learning_waits() -> None:
    program = """
import dgpc, numpy as np
x = np.random.default_rng(1).normal(size=(2700, 2))
y = np.hypot(*x.T) < 1.2
prior = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=2.0, dimension=2))
posterior = dgpc.Posterior(prior, dgpc.Sites(x[:800], y[:800], np.full(800, 0.2)))
seen = []
def report(progress):
    seen.append(posterior.probability(np.tile(x, (5, 1))))
    if len(seen) == 3:
        raise RuntimeError("enough")
try:
    while True:
        dgpc.learn(prior, x, y, further_starts=[prior, prior], tolerance=0.0, progress=report)
except RuntimeError:
    print(len(seen))
"""
    for threads in ("1", "2"):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120,
                              env={**os.environ, "RAYON_NUM_THREADS": threads})
        assert done.stdout == "3\n", done.stderr
