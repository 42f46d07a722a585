"""The paper's algorithm without acceleration: the reference for the fast one."""

from __future__ import annotations

from mssegment.manifolds import Manifold
from mssegment.meanshift.ascent import ascend
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
    """Where plain mean shift takes every point.

    Steps of (10), double precision, every trajectory to convergence. No longer steps, no
    following, no merging, no removal of saddle points. Meant for comparison: it takes thousands of
    passes over all pairs. Use :class:`mssegment.meanshift.MeanShift` to cluster.

    Parameters
    ----------
    manifold
        The manifold.
    points
        The data points, which are also the starts [n, ...].
    bandwidth
        h, in the manifold's distance.
    kernel
        The kernel profile.
    tolerance
        A trajectory has converged when its shift is no longer than this many bandwidths.
    max_iterations
        The largest number of steps.

    Returns
    -------
    ends
        The ends of the trajectories [n, ...].
    densities
        The kernel density (7) there [n], without the constant c_{k,h}.

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.manifolds import Euclidean
    >>> points = np.array([[0.0], [1.0], [10.0]])
    >>> ends, _ = mean_shift_to_convergence(Euclidean(1), points, bandwidth=1.0)
    >>> ends.round(3).tolist()
    [[0.5], [0.5], [10.0]]
    """
    found = ascend(
        manifold.prepare(points, bandwidth),
        kernel,
        points,
        tolerance=tolerance,
        max_iterations=max_iterations,
        accelerated=False,
    )
    return found.x, found.density
