"""Mean shift over any manifold: kernels, bandwidth, the iteration, modes, the estimator."""

from mssegment.meanshift.bandwidth import nearest_neighbour_bandwidth
from mssegment.meanshift.estimator import MeanShift
from mssegment.meanshift.kernels import KERNELS, Kernel, kernel_named
from mssegment.meanshift.reference import mean_shift_to_convergence

__all__ = [
    "KERNELS",
    "Kernel",
    "MeanShift",
    "kernel_named",
    "mean_shift_to_convergence",
    "nearest_neighbour_bandwidth",
]
