"""Mean shift over any manifold: kernels, bandwidth, the iteration, modes, the estimator.

:class:`MeanShift` clusters points; :func:`ascend` is the iteration itself.
"""

from mssegment.meanshift.ascent import ascend, shift
from mssegment.meanshift.bandwidth import nearest_neighbour_bandwidth
from mssegment.meanshift.estimator import MeanShift
from mssegment.meanshift.kernels import Kernel, kernel_named
from mssegment.meanshift.reference import mean_shift_to_convergence
from mssegment.registry import KERNELS

__all__ = [
    "KERNELS",
    "Kernel",
    "MeanShift",
    "ascend",
    "kernel_named",
    "mean_shift_to_convergence",
    "nearest_neighbour_bandwidth",
    "shift",
]
