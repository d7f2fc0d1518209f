"""Any layout and any type of real numbers gives the same result, and no argument is changed."""

import tracemalloc

import dgpc
import numpy as np
import pytest

INTEGERS = np.random.default_rng(1).integers(0, 4, size=(30, 2))

LAYOUTS = {
    "float64": lambda x: x.astype(np.float64),
    "float32": lambda x: x.astype(np.float32),
    "float16": lambda x: x.astype(np.float16),
    "long double": lambda x: x.astype(np.longdouble),
    "int64": lambda x: x.astype(np.int64),
    "int8": lambda x: x.astype(np.int8),
    "uint16": lambda x: x.astype(np.uint16),
    "big endian": lambda x: x.astype(">f8"),
    "Fortran order": lambda x: np.asfortranarray(x, dtype=float),
    "every second row": lambda x: np.repeat(x, 2, axis=0)[::2].astype(float, copy=False),
    "strides": lambda x: np.repeat(x.astype(float), 3, axis=0)[::3],
    "reversed": lambda x: x.astype(float)[::-1].copy()[::-1],
    "columns of a wide array": lambda x: np.hstack([x, x]).astype(float)[:, :2],
    "field of a structure": lambda x: np.rec.fromarrays([x.astype(float).T, x.T], names="a,b")["a"].T,
    "misaligned": lambda x: np.frombuffer(b"0" + x.astype(float).tobytes(), dtype=float, offset=1).reshape(x.shape),
    "lists": lambda x: x.tolist(),
    "tuple of tuples": lambda x: tuple(map(tuple, x.tolist())),
    "subclass": lambda x: x.astype(float).view(np.recarray),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_of_inputs_does_not_matter(prior: dgpc.Prior, layout: str) -> None:
    y = INTEGERS.sum(axis=1) > 3
    expected = dgpc.fit(prior, INTEGERS.astype(float), y)
    x = LAYOUTS[layout](INTEGERS)
    np.testing.assert_array_equal(dgpc.fit(prior, x, y).mean, expected.mean)
    np.testing.assert_array_equal(expected.posterior().probability(x), expected.posterior().probability(INTEGERS))


@pytest.mark.parametrize("kind", [bool, np.int8, np.int64, np.uint8, np.float32, np.float64])
def test_a_type_of_outcomes_does_not_matter(prior: dgpc.Prior, kind: type) -> None:
    y = INTEGERS.sum(axis=1) > 3
    np.testing.assert_array_equal(
        dgpc.fit(prior, INTEGERS, y.astype(kind)).mean, dgpc.fit(prior, INTEGERS, y.tolist()).mean
    )


def test_read_only_arrays_are_accepted_and_no_argument_changes(prior: dgpc.Prior, events) -> None:
    x, y = events
    before = x.copy()
    x.flags.writeable = False
    dgpc.fit(prior, x, y, weights=np.ones(len(x)))
    np.testing.assert_array_equal(x, before)


def test_results_are_copies(prior: dgpc.Prior, events) -> None:
    fit = dgpc.fit(prior, *events)
    fit.mean[:] = 0.0
    assert (fit.mean != 0.0).any()


@pytest.mark.parametrize("layout", ["float64", "float32", "Fortran order"])
def test_numpy_holds_no_second_copy_of_an_input(layout: str) -> None:
    x = LAYOUTS[layout](np.ones((400_000, 4)))
    kernel = dgpc.Kernel([dgpc.Term("matern32", columns=[0])])
    tracemalloc.start()
    kernel.diagonal(x)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # The result has 3.2 MB, and NumPy converts blocks of half a megabyte. A copy would have 12.8 MB.
    assert peak < 6e6
