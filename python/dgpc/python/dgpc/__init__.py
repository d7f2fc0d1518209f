"""Decentralised Gaussian process classification.

Several agents observe binary outcomes of one latent function. Each fits its events, summarises them at a few inducing
points, and fuses the summaries of the others.

All arguments are arrays, or objects that NumPy turns into arrays. Bad arguments raise a ``ValueError``. A computation
that fails raises ``dgpc.Error``.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ._dgpc import (
    Candidates,
    Certificate,
    Concatenation,
    Correlation,
    Error,
    Fit,
    Kernel,
    Learned,
    LocalityRegion,
    Posterior,
    Prior,
    Propagated,
    RangeMean,
    Selection,
    Shard,
    ShardedFit,
    Shift,
    Sites,
    Summary,
    Term,
    busiest_region,
    effective_sample_size,
    evidence,
    fit,
    gibbs,
    greedy_by_variance,
    greedy_judged,
    learn,
    log_evidence,
    region_around,
)
from ._elementwise import polya_gamma, polya_gamma_moments, success_probability

if TYPE_CHECKING:
    from . import ray as ray
    from . import sharded as sharded
    from ._classifier import GaussianProcessClassifier

__version__ = "0.1.0"

__all__ = [
    "Candidates",
    "Certificate",
    "Concatenation",
    "Correlation",
    "Error",
    "Fit",
    "GaussianProcessClassifier",
    "Kernel",
    "Learned",
    "LocalityRegion",
    "Posterior",
    "Prior",
    "Propagated",
    "RangeMean",
    "Selection",
    "Shard",
    "ShardedFit",
    "Shift",
    "Sites",
    "Summary",
    "Term",
    "busiest_region",
    "effective_sample_size",
    "evidence",
    "fit",
    "gibbs",
    "greedy_by_variance",
    "greedy_judged",
    "learn",
    "log_evidence",
    "polya_gamma",
    "polya_gamma_moments",
    "region_around",
    "success_probability",
]


def __getattr__(name: str) -> Any:
    """Imports the estimator and the submodules when they are first used, because scikit-learn and Ray are optional."""
    if name in ("ray", "sharded"):
        return importlib.import_module(f"dgpc.{name}")
    if name != "GaussianProcessClassifier":
        raise AttributeError(f"module 'dgpc' has no attribute {name!r}")
    try:
        import sklearn  # noqa: F401
    except ModuleNotFoundError as error:
        message = "dgpc.GaussianProcessClassifier needs scikit-learn 1.6 or later: pip install 'dgpc[sklearn]'"
        raise ImportError(message) from error
    from ._classifier import GaussianProcessClassifier

    return GaussianProcessClassifier
