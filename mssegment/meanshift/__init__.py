"""Mean shift over any manifold: kernels, bandwidth, the iteration, modes, the estimator.

:class:`MeanShift` clusters points; :func:`ascend` is the iteration itself.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from mssegment.meanshift.ascent import ascend, shift
from mssegment.meanshift.bandwidth import auto_bandwidth, nearest_neighbour_bandwidth
from mssegment.meanshift.clusters import Clusters, find_clusters, thread_pool
from mssegment.meanshift.kernels import Kernel, kernel_named
from mssegment.meanshift.reference import mean_shift_to_convergence
from mssegment.meanshift.search import ModeSearch
from mssegment.registry import KERNELS

if TYPE_CHECKING:
    from mssegment.meanshift.estimator import ConvergenceWarning as ConvergenceWarning
    from mssegment.meanshift.estimator import MeanShift as MeanShift
    from mssegment.meanshift.fusion import FusedMode as FusedMode
    from mssegment.meanshift.fusion import Fusion as Fusion
    from mssegment.meanshift.fusion import fuse as fuse

_LATER = {
    "ConvergenceWarning": "estimator",
    "FusedMode": "fusion",
    "Fusion": "fusion",
    "MeanShift": "estimator",
    "fuse": "fusion",
}
"""What is loaded when it is asked for: the stages for pictures need none of it."""


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_LATER[name]}"), name)
    globals()[name] = value
    return value


__all__ = [
    "KERNELS",
    "Clusters",
    "ConvergenceWarning",
    "FusedMode",
    "Fusion",
    "Kernel",
    "MeanShift",
    "ModeSearch",
    "ascend",
    "auto_bandwidth",
    "find_clusters",
    "fuse",
    "kernel_named",
    "mean_shift_to_convergence",
    "nearest_neighbour_bandwidth",
    "shift",
    "thread_pool",
]
