"""Data that several tests use."""

import signal

import dgpc
import numpy as np
import pytest


@pytest.fixture(autouse=True, scope="session")
def interruptible() -> None:
    """Lets Ctrl-C interrupt. A shell script that starts Python in the background makes it ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def prior() -> dgpc.Prior:
    """A prior over two columns."""
    return dgpc.Prior(dgpc.Term("matern52", 0.8, variance=2.0, dimension=2), mean=0.2)


@pytest.fixture
def events() -> tuple[np.ndarray, np.ndarray]:
    """Forty events: success near the origin."""
    x = np.random.default_rng(1).normal(size=(40, 2))
    return x, np.hypot(*x.T) < 1.2
