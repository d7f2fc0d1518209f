"""Sparse fits of events, and learning from events, that exceed the memory of one process.

The events lie in shards: files in NumPy's format ``.npy``, one row an event. Workers read them. Only requests and
contributions of about M² numbers travel, for M inducing points. Any engine with the interface of ``map`` runs the
workers: ``concurrent.futures``, Dask, or Ray (``dgpc.ray``).
"""

from ._files import write_shards
from ._fit import FittedShards, fit
from ._learn import LearnedShards, learn

__all__ = ["FittedShards", "LearnedShards", "fit", "learn", "write_shards"]
