"""Workers of Ray for `pingmap.sweep`: those of the package `dgpc`.

The extra ``pingmap[ray]`` installs `dgpc` and Ray. `dgpc.ray` describes the processors that workers reserve.

Examples
--------
    >>> import ray  # doctest: +SKIP
    >>> ray.init(num_cpus=2)  # doctest: +SKIP
    >>> with Workers(2) as workers:  # doctest: +SKIP
    ...     table = sweep(simulated_scores, grid(seed=[1, 2]), "sweep-results", map=workers.map)
"""

try:
    from dgpc.ray import Workers
except ImportError as error:
    raise ImportError("pingmap.ray needs the package dgpc and Ray 2.60 or later: pip install 'pingmap[ray]'") from error

__all__ = ["Workers"]
