"""The paper's algorithm as it stands, for all starts at once: the measure of the fast one.

No acceleration, no merging on the way, double precision, every trajectory to convergence. It is
kept to be compared with; use :class:`mssegment.meanshift.MeanShift`.
"""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.meanshift.ascent import shift
from mssegment.meanshift.kernels import Gaussian, Kernel
from mssegment.records import Floats

_GAUSSIAN = Gaussian()


def mean_shift_to_convergence(
    manifold: Manifold,
    points: Floats,
    bandwidth: float,
    kernel: Kernel = _GAUSSIAN,
    tolerance: float = 1e-7,
    max_iterations: int = 3000,
) -> tuple[Floats, Floats]:
    """Where each of ``points`` [n, ...] arrives by (9)-(10), and the density (7) there [n].

    A trajectory ends when its shift is shorter than ``tolerance`` bandwidths.
    """
    prepared = manifold.prepare(points, bandwidth)
    x = np.array(points, dtype=np.float64)
    density = np.zeros(len(x))
    moving = np.arange(len(x))
    for _ in range(max_iterations):
        step, density[moving] = shift(prepared, kernel, x[moving])
        length = manifold.norm(x[moving], step)
        x[moving] = manifold.exp(x[moving], step)
        moving = moving[length > tolerance * bandwidth]
        if not moving.size:
            break
    return x, density
