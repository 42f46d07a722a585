"""Rigid motions in space, between two sets of matched 3-D points: points of SE(3)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.rotations import rotation
from mssegment.manifolds import SE3
from mssegment.models.base import Flags, drop_unweighted
from mssegment.models.data import DataModel, no_fits
from mssegment.records import Floats, Normalization

MIN_RELATIVE_SPREAD = 1e-12
"""Smallest second moment across the line through the points, relative to that along it; below it
the rotation about the line is not determined."""


class Rigid3D(DataModel):
    """x2 = R x1 + t; an elemental subset is three matches that are not collinear.

    The residual is the distance between x2 and where x1 moves to.

    References
    ----------
    K. S. Arun, T. S. Huang and S. D. Blostein, "Least-squares fitting of two 3-D point sets",
    PAMI 9, 1987.
    """

    name: ClassVar[str] = "rigid3d"
    purpose: ClassVar[str] = "rigid bodies among matched 3-D points"
    leaves_parallax_free: ClassVar[bool] = False
    is_local: ClassVar[bool] = True
    min_frames: ClassVar[int] = 2
    max_frames: ClassVar[int | None] = 2
    coordinates: ClassVar[int | None] = 3

    frames: int = 2

    def __init__(self) -> None:
        self.dimension = 3
        self.manifold = SE3()
        self.subset_size, self.parameters, self.residual_dimension = 3, 6, 3

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points of a random body before and after a random motion."""
        first = rng.uniform(-50.0, 50.0, (count, 3))
        turn = rotation(rng.uniform(-1.0, 1.0, 3))
        return np.stack([first, first @ turn.T + rng.uniform(-80.0, 80.0, 3)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Least squares on three matches [B, 3, 2, 3]."""
        return self.fit(samples, np.ones(samples.shape[:2]))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The rigid motion of least weighted squares, in closed form."""
        if not len(weights):
            return no_fits(self.manifold.point_shape)
        weights, observed = drop_unweighted(weights, observed)
        total = np.maximum(weights.sum(axis=1), 1e-300)
        whole = np.broadcast_to(observed, (len(weights), *observed.shape[-3:]))
        means = np.einsum("bp,bpfd->bfd", weights, whole) / total[:, None, None]
        away = whole - means[:, None]
        first, second = away[:, :, 0], away[:, :, 1]
        cross = np.swapaxes(second, 1, 2) @ (weights[..., None] * first)
        u, s, v = np.linalg.svd(cross)
        turned = np.linalg.det(u @ v) < 0
        u[turned, :, 2] *= -1.0
        points = np.zeros((len(weights), 4, 4))
        points[:, :3, :3] = u @ v
        points[:, :3, 3] = means[:, 1] - (points[:, :3, :3] @ means[:, 0, :, None])[..., 0]
        points[:, 3, 3] = 1.0
        least = MIN_RELATIVE_SPREAD * np.maximum(s[:, 0], 1e-300)
        reach = total * (means**2).sum(axis=2).max(axis=1)
        return points, np.asarray((s[:, 1] > least) & (s[:, 1] > 1e-18 * reach))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distances between the second points and the moved first ones [B, P]."""
        turned = observed[..., 0, :] @ np.swapaxes(points[:, :3, :3], 1, 2)
        miss = turned + points[:, None, :3, 3] - observed[..., 1, :]
        return np.asarray(np.linalg.norm(miss, axis=-1) * normalization.scale)

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """``matrix`` [4, 4], which maps the first points to the second, in the unit of the data."""
        matrix = point.copy()
        first, second = normalization.centres
        turn = point[:3, :3]
        matrix[:3, 3] = normalization.scale * point[:3, 3] + second - turn @ first
        return {"matrix": matrix}
