"""Threads, forked processes and interruption."""

import os
import signal
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
