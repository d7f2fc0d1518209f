"""Fits of events in shards: equality with the fit of all events, lost workers, and bad files."""

import doctest
import os
import resource
import signal
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context

import numpy as np
import pytest

import dgpc
from dgpc import sharded


def wave(count, seed=1):
    generator = np.random.default_rng(seed)
    x = generator.uniform(0.0, 1.0, (count, 2))
    y = generator.uniform(size=count) < 0.5 + 0.4 * np.sin(7.0 * x[:, 0] + 3.0 * x[:, 1])
    return x, y.astype(int)


PRIOR = dgpc.Prior(dgpc.Term("matern52", 0.3, variance=3.0, dimension=2), mean=0.4)
X, Y = wave(600)
POINTS = X[::40]
PLACES = np.array([[0.2, 0.3], [0.7, 0.6], [3.0, 3.0]])


def bits(found):
    mean, variance = found.posterior.latent(PLACES)
    return [found.evidence, found.iterations, *mean, *variance, *found.gradient]


@pytest.fixture
def paths(tmp_path):
    return sharded.write_shards(tmp_path, X, Y, shards=4)


@pytest.fixture(scope="module")
def ray():
    """A cluster of Ray with two processors."""
    module = pytest.importorskip("ray", reason="Ray is not installed")
    module.init(num_cpus=2, object_store_memory=200_000_000, include_dashboard=False, log_to_driver=False)
    yield module
    module.shutdown()


def test_a_fit_of_shards_equals_the_fit_of_all_events(paths):
    whole, gradient = dgpc.evidence(PRIOR, X, Y, inducing_points=POINTS)
    found = sharded.fit(PRIOR, paths, POINTS)
    mean, variance = found.posterior.latent(PLACES)
    expected_mean, expected_variance = whole.posterior().latent(PLACES)
    np.testing.assert_allclose(mean, expected_mean, atol=1e-6)
    np.testing.assert_allclose(variance, expected_variance, atol=1e-6)
    np.testing.assert_allclose(found.gradient, gradient, atol=1e-6)
    assert found.evidence == pytest.approx(whole.evidence, abs=1e-8)


def test_weighted_shards_equal_the_weighted_fit(tmp_path):
    weights = np.arange(len(Y)) % 3 + 0.5
    paths = sharded.write_shards(tmp_path, X, Y, shards=3, weights=weights)
    found = sharded.fit(PRIOR, paths, POINTS, weighted=True)
    assert found.evidence == pytest.approx(dgpc.fit(PRIOR, X, Y, weights=weights, inducing_points=POINTS).evidence)
    with pytest.raises(ValueError, match="shard-0000.npy: expected 3 columns"):
        sharded.fit(PRIOR, paths, POINTS)


def test_every_map_gives_the_same_bits(paths):
    expected = bits(sharded.fit(PRIOR, paths, POINTS))
    assert bits(sharded.fit(PRIOR, paths, POINTS, keep=1)) == expected
    with ThreadPoolExecutor(3) as threads:
        assert bits(sharded.fit(PRIOR, paths, POINTS, map=threads.map)) == expected
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        assert bits(sharded.fit(PRIOR, paths, POINTS, map=processes.map)) == expected


def test_a_new_worker_in_every_round_changes_no_bit(paths):
    def forgetful(function, *sequences):
        sharded._fit._kept.clear()
        return list(map(function, *sequences))

    assert bits(sharded.fit(PRIOR, paths, POINTS, map=forgetful)) == bits(sharded.fit(PRIOR, paths, POINTS))


def test_a_changed_file_is_read_again(tmp_path, paths):
    before = sharded.fit(PRIOR, paths, POINTS).evidence
    table = np.load(paths[0])
    table[:, 2] = 1.0 - table[:, 2]
    np.save(paths[0], table)
    os.utime(paths[0], ns=(1, 1))
    assert sharded.fit(PRIOR, paths, POINTS).evidence != before


def test_a_changed_file_with_the_old_time_of_modification_is_read_again(tmp_path, paths):
    before, state = sharded.fit(PRIOR, paths, POINTS).evidence, os.stat(paths[0])
    table = np.load(paths[0])
    table[:, 2] = 1.0 - table[:, 2]
    np.save(paths[0], table)
    os.utime(paths[0], ns=(state.st_atime_ns, state.st_mtime_ns))
    found = sharded.fit(PRIOR, paths, POINTS).evidence
    sharded._fit._kept.clear()
    assert found == sharded.fit(PRIOR, paths, POINTS).evidence != before


def test_threads_with_many_inducing_points_give_the_same_bits(tmp_path):
    paths = sharded.write_shards(tmp_path, X, Y, shards=8)
    with ThreadPoolExecutor(4) as threads:
        found = [sharded.fit(PRIOR, paths, X[::4], map=threads.map, keep=keep, iterations_max=3) for keep in [None, 2, 0]]
    assert bits(found[0]) == bits(found[1]) == bits(found[2])
    assert found[0].stop == "iterations_max" and found[0].contribution_bytes == 8 * (5 + 150 * 153 // 2)


def test_progress_is_reported_after_every_round(paths):
    seen = []
    found = sharded.fit(PRIOR, paths, POINTS, progress=lambda *progress: seen.append(progress))
    assert seen[-1] == (found.iterations, found.change)


def test_bad_shards_are_refused_by_name(tmp_path, paths):
    def refused(shards, text):
        with pytest.raises(ValueError, match=text):
            sharded.fit(PRIOR, shards, POINTS)

    refused([], "at least one shard")
    refused([*paths, paths[0]], "shard-0000.npy: the shard is named twice")
    refused([*paths, tmp_path / "missing.npy"], "missing.npy: .*No such file")
    bad = tmp_path / "bad.npy"
    for table, text in [
        (np.zeros((3, 2)), "expected 3 columns"),
        (np.zeros(3), "expected 3 columns"),
        (np.full((2, 3), np.nan), "bad.npy: .*finite"),
        (np.full((2, 3), 0.5), "bad.npy: .*outcomes must be 0 or 1"),
        (np.array([["a", "b", "c"]]), "bad.npy: .*real numbers"),
    ]:
        np.save(bad, table)
        refused([*paths, bad], text)
    bad.write_bytes(paths[0].read_bytes()[:200])
    refused([*paths, bad], "bad.npy")
    bad.write_bytes(b"no array")
    refused([*paths, bad], "bad.npy")
    with pytest.raises(ValueError, match="shards must be at least 1"):
        sharded.write_shards(tmp_path / "none", X, Y, shards=0)
    with pytest.raises(FileExistsError):
        sharded.write_shards(tmp_path, X, Y, shards=2)


def test_a_shard_with_a_damaged_header_is_refused(tmp_path):
    (path,) = sharded.write_shards(tmp_path, X[:200], Y[:200], shards=1)
    content = path.read_bytes()
    bits_of_header = [(place, 1 << bit) for place in range(128) for bit in range(8)]
    refused = 0
    for place, bit in bits_of_header:
        path.write_bytes(content[:place] + bytes([content[place] ^ bit]) + content[place + 1 :])
        try:
            table = sharded._files.opened(str(path), 3, False)
        except ValueError:
            refused += 1
        else:
            assert table.shape == (200, 3) and (table.dtype.byteorder == ">" or (table[:, 2] == Y[:200]).all())
    assert refused > 500
    path.write_bytes(content.replace(b"(200, 3)", b"(000, 3)"))
    for call in (lambda: sharded.fit(PRIOR, [path], POINTS), lambda: sharded.learn(PRIOR, [path], seed=1)):
        with pytest.raises(ValueError, match=r"shard-0000.npy: expected 128 bytes .* \(0, 3\), found 4928 bytes"):
            call()
    path.write_bytes(content + b"\0")
    with pytest.raises(ValueError, match="shard-0000.npy: expected 4928 bytes .* found 4929 bytes"):
        sharded.fit(PRIOR, [path], POINTS)


def test_a_file_that_numpy_cannot_parse_is_named(tmp_path, paths):
    content, bad = paths[0].read_bytes(), tmp_path / "bad.npy"
    damaged = [(b"'descr'", b"'descr("), (b"}", b" "), (b"'descr': ", b"'descr':=1")]
    for bytes_of_file in [b"PK\x03\x04junk", *(content.replace(*parts, 1) for parts in damaged)]:
        bad.write_bytes(bytes_of_file)
        for call in (lambda: sharded.fit(PRIOR, [bad], POINTS), lambda: sharded.learn(PRIOR, [bad], seed=1)):
            with pytest.raises(ValueError, match="bad.npy: expected an array"):
                call()


def test_a_file_with_two_names_is_refused(tmp_path, paths):
    for name, make in [("soft.npy", os.symlink), ("hard.npy", os.link)]:
        make(paths[0], tmp_path / name)
        with pytest.raises(ValueError, match="the shard is named twice"):
            sharded.fit(PRIOR, [*paths, tmp_path / name], POINTS)


def test_one_path_in_place_of_a_sequence_is_refused(paths):
    for path in (paths[0], str(paths[0])):
        with pytest.raises(TypeError, match="expected a sequence of paths, found the path .*shard-0000.npy"):
            sharded.fit(PRIOR, path, POINTS)


@pytest.mark.parametrize(
    ("y", "weights", "text"),
    [
        (Y[:5], None, "outcomes, one per input: expected 600, found 5"),
        (Y * 2 - 1, None, "outcomes must be 0 or 1, found -1"),
        (np.full(600, np.nan), None, "outcomes must be 0 or 1, found NaN"),
        (Y[:, None], None, "one dimension"),
        (0, None, "one dimension"),
        (Y, np.ones(5), "expected 600, found 5"),
        (Y, np.zeros(600), "weight must be a finite positive number, found 0"),
        (Y, np.full(600, np.inf), "finite"),
    ],
)
def test_events_that_no_fit_accepts_are_not_written(tmp_path, y, weights, text):
    with pytest.raises(ValueError, match=text):
        sharded.write_shards(tmp_path, X, y, shards=2, weights=weights)
    with pytest.raises(ValueError, match="finite"):
        sharded.write_shards(tmp_path, np.full((600, 2), np.inf), Y, shards=2)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("limit", [3000, 4096])
def test_no_file_remains_after_a_full_disk(tmp_path, paths, limit):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
        with pytest.raises(OSError):
            sharded.write_shards(tmp_path / "full", X[:599], Y[:599], shards=2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list((tmp_path / "full").iterdir())
    paths[0].unlink()
    with pytest.raises(FileExistsError):
        sharded.write_shards(tmp_path, X, Y, shards=4)
    assert sorted(tmp_path.glob("shard-*")) == paths[1:], "existing files remain"


def test_a_process_that_dies_raises_the_error_of_its_pool(paths):
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        def kill(iterations, change):
            for process in processes._processes.values():
                process.kill()

        with pytest.raises(BrokenProcessPool):
            sharded.fit(PRIOR, paths, POINTS, map=processes.map, progress=kill)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes, pytest.raises(BrokenProcessPool):
        sharded.fit(PRIOR, paths, POINTS, map=lambda function, *items: processes.map(os._exit, [1] * 4))


def test_an_empty_shard_changes_nothing(tmp_path, paths):
    empty = tmp_path / "empty.npy"
    np.save(empty, np.zeros((0, 3)))
    with_empty = sharded.fit(PRIOR, [*paths, empty], POINTS)
    assert with_empty.evidence == pytest.approx(sharded.fit(PRIOR, paths, POINTS).evidence, abs=1e-9)


def test_a_map_that_loses_results_is_refused(paths):
    with pytest.raises(ValueError, match="map returned 3 results of 4 shards"):
        sharded.fit(PRIOR, paths, POINTS, map=lambda function, *sequences: list(map(function, *sequences))[:3])


def test_forty_thousand_events_give_the_same_bits_on_ray_even_if_a_worker_is_killed(tmp_path, paths, ray):
    from dgpc.ray import Workers

    x, y = wave(40_000)
    points = x[::500]
    shards = sharded.write_shards(tmp_path / "many", x, y, shards=4)
    with Workers(2) as workers:
        alone = sharded.fit(PRIOR, shards, points)
        assert bits(sharded.fit(PRIOR, shards, points, map=workers.map)) == bits(alone)
        whole = dgpc.fit(PRIOR, x, y, inducing_points=points).posterior()
        for found, expected in zip(alone.posterior.latent(x[::100]), whole.latent(x[::100])):
            assert np.abs(found - expected).max() < 1e-6

        first = ray.get(workers.actors[0].process.remote())

        # The worker ends while it works on the next round.
        timer = threading.Timer(0.005, lambda: os.kill(first, signal.SIGKILL))

        def kill(iterations, change):
            if iterations == 3:
                timer.start()

        assert bits(sharded.fit(PRIOR, shards, points, map=workers.map, progress=kill)) == bits(alone)
        timer.join()
        assert ray.get(workers.actors[0].process.remote()) != first, "the worker was not killed"
        with pytest.raises(ray.exceptions.RayActorError):
            list(workers.map(os._exit, [3]))
        with pytest.raises(ValueError, match="missing.npy"):
            sharded.fit(PRIOR, [*paths, "missing.npy"], POINTS, map=workers.map)

        begin = time.monotonic()
        next(workers.map(time.sleep, [0.0, 60.0]))
        assert time.monotonic() - begin < 30.0, "the first result does not wait for the second"


def test_ctrl_c_stops_the_tasks_of_ray(tmp_path, ray):
    from dgpc.ray import Workers

    def nap(path):
        open(path, "w").close()
        time.sleep(20.0)

    with Workers(2) as workers:
        assert list(workers.map(pow, iter([2, 3]), iter([3, 2]))) == [8, 9]
        begun = [str(tmp_path / str(number)) for number in range(8)]
        timer = threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            list(workers.map(nap, begun))
        begin = time.monotonic()
        assert list(workers.map(abs, [-1, -2, -3])) == [1, 2, 3]
        assert time.monotonic() - begin < 15.0 and len(list(tmp_path.iterdir())) <= 2
        with pytest.raises(TypeError):
            list(workers.map(abs, ["text", 1]))
    with pytest.raises(ValueError, match="these workers were closed"):
        workers.map(abs, [1])


def test_more_workers_than_processors_are_refused(ray):
    from dgpc.ray import Workers

    with pytest.raises(ValueError, match="the workers need 3 processors; the cluster has 2"):
        Workers(3)


@pytest.mark.parametrize("name", sharded.__all__)
def test_examples_in_the_documentation_are_right(name):
    found = doctest.DocTestFinder(exclude_empty=True).find(getattr(sharded, name), name, module=False, globs={})
    assert found and found[0].examples
    for example in found:
        assert doctest.DocTestRunner().run(example).failed == 0


TEMPLATE = dgpc.Prior(dgpc.Term("matern52", 1.0, variance=1.0, dimension=2), mean=0.0)


def test_learning_from_shards_equals_learning_and_fitting_all_events(paths):
    learned = dgpc.learn(TEMPLATE, X, Y)
    found = sharded.learn(TEMPLATE, paths, seed=1, inducing_points=60)
    assert found.prior == learned.prior and found.search.searched_events == len(Y)
    whole = dgpc.fit(learned.prior, X, Y, inducing_points=found.inducing_points)
    np.testing.assert_allclose(found.fit.posterior.latent(PLACES), whole.posterior().latent(PLACES), atol=1e-6)
    np.testing.assert_allclose(
        found.fit.posterior.probability(PLACES), learned.fit.posterior().probability(PLACES), atol=0.01
    )


def test_learning_gathers_an_even_seeded_sample_of_all_shards(tmp_path):
    x, y = wave(4000)
    number = np.arange(len(y))
    paths = sharded.write_shards(tmp_path, np.column_stack([x, number]), y, shards=7)
    gathered = [sharded._learn._gather(paths, False, 1000, seed, map)[:, 2] for seed in (1, 1, 2)]
    assert (gathered[0] == gathered[1]).all() and (gathered[0] != gathered[2]).any()
    assert (gathered[0] // 4 == np.arange(1000)).all(), "one event from each four"
    template = dgpc.Prior(dgpc.Term("matern52", [1.0, 1.0]))
    learned = dgpc.learn(template, x, y)
    with ThreadPoolExecutor(2) as threads:
        found = sharded.learn(template, paths, seed=1, events_max=1000, inducing_points=100, map=threads.map)
    assert found.search.searched_events == 1000
    np.testing.assert_allclose(found.prior.parameter_values, learned.prior.parameter_values, atol=0.5)
    at = np.column_stack([PLACES, [0.0, 0.0, 0.0]])
    expected = learned.fit.posterior().probability(PLACES)
    np.testing.assert_allclose(found.fit.posterior.probability(at), expected, atol=0.03)


def test_learning_passes_weights_messages_and_options(tmp_path, paths):
    message = dgpc.fit(PRIOR, X[:50], Y[:50], inducing_points=X[:5]).posterior().summarise(X[:3] + 5.0)
    found = sharded.learn(TEMPLATE, paths, seed=1, inducing_points=POINTS, messages=[message], calibrate=False)
    expected = dgpc.learn(TEMPLATE, X, Y, messages=[message], calibrate=False)
    assert found.prior == expected.prior and found.search.calibration == "not asked"
    weighted = sharded.write_shards(tmp_path / "weighted", X, Y, shards=2, weights=np.full(len(Y), 0.5))
    found = sharded.learn(TEMPLATE, weighted, seed=1, inducing_points=POINTS, weighted=True)
    assert found.prior == dgpc.learn(TEMPLATE, X, Y, weights=np.full(len(Y), 0.5)).prior


def test_learning_reports_the_progress_of_its_search_and_of_its_fit(paths, monkeypatch):
    searched, fitted = [], []

    def slow(*arguments, progress, **options):
        progress({"evaluations": 1})
        return dgpc.learn(*arguments, **options)

    monkeypatch.setattr(sharded._learn, "learn_in_process", slow)
    found = sharded.learn(TEMPLATE, paths, seed=1, inducing_points=POINTS, search_progress=searched.append,
                          progress=lambda *progress: fitted.append(progress))
    assert searched == [{"evaluations": 1}] and fitted[-1] == (found.fit.iterations, found.fit.change)


def test_learning_without_weighted_refuses_files_with_weights_of_one(tmp_path):
    paths = sharded.write_shards(tmp_path, X, Y, shards=2, weights=np.ones(len(Y)))
    with pytest.raises(ValueError, match="only ones: if these are weights, set weighted=True"):
        sharded.learn(TEMPLATE, paths, seed=1)
    for shape, number in [("label", Y), ("matern52", X[:, 0])]:
        template = dgpc.Prior(dgpc.Term("matern52", 1.0, dimension=2) + dgpc.Term(shape, columns=[2]))
        x = np.column_stack([X, number])[:50]
        success = sharded.write_shards(tmp_path / shape, x, np.ones(50), shards=1)
        assert (sharded.learn(template, success, seed=1).search.fit.mean > 0.0).all(), "a template may use the column"


def test_learning_refuses_bad_shards(tmp_path, paths):
    def refused(shards, text, **options):
        with pytest.raises(ValueError, match=text):
            sharded.learn(TEMPLATE, shards, seed=1, **options)

    refused([], "at least one shard")
    refused(paths, "events_max must be at least 1", events_max=0)
    for table, text in [
        (np.zeros((3, 1)), "bad.npy: expected at least 2 columns"),
        (np.zeros((3, 4)), "bad.npy: expected 3 columns as in the first shard, found 4"),
        (np.full((2, 3), 0.5), "outcomes must be 0 or 1"),
    ]:
        np.save(tmp_path / "bad.npy", table)
        refused([*paths, tmp_path / "bad.npy"], text)
    np.save(tmp_path / "empty.npy", np.zeros((0, 3)))
    refused([tmp_path / "empty.npy"], "the shards contain no events")
    refused(paths, "map returned 0 results of 4 shards", map=lambda *arguments: [])


def test_files_that_are_no_shards_are_named(tmp_path):
    empty, archive = tmp_path / "empty.npy", tmp_path / "archive.npy"
    empty.touch()
    with open(archive, "wb") as file:
        np.savez(file, a=X, b=Y)
    for path in (empty, archive):
        with pytest.raises(ValueError, match=f"{path.name}: expected"):
            sharded.fit(PRIOR, [path], POINTS)
    with pytest.raises(ValueError, match="keep must be at least 0"):
        sharded.fit(PRIOR, [empty], POINTS, keep=-1)
    with pytest.raises(ValueError, match="masked"):
        sharded.write_shards(tmp_path, np.ma.masked_greater(X, 0.0), Y, shards=2)
