"""Mean shift over any manifold: kernels, bandwidth, the iteration, modes, the estimator.

:class:`MeanShift` clusters points; :func:`ascend` is the iteration itself.
"""

from mssegment.meanshift.ascent import ascend, shift
from mssegment.meanshift.bandwidth import auto_bandwidth, nearest_neighbour_bandwidth
from mssegment.meanshift.clusters import Clusters, find_clusters, thread_pool
from mssegment.meanshift.estimator import ConvergenceWarning, MeanShift
from mssegment.meanshift.kernels import Kernel, kernel_named
from mssegment.meanshift.reference import mean_shift_to_convergence
from mssegment.meanshift.search import ModeSearch
from mssegment.registry import KERNELS

__all__ = [
    "KERNELS",
    "Clusters",
    "ConvergenceWarning",
    "Kernel",
    "MeanShift",
    "ModeSearch",
    "ascend",
    "auto_bandwidth",
    "find_clusters",
    "kernel_named",
    "mean_shift_to_convergence",
    "nearest_neighbour_bandwidth",
    "shift",
    "thread_pool",
]
