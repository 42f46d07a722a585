"""Models of structures in data that is no picture: tables, point clouds, matched 3-D points.

A structure is what a motion is among tracks: a line among points of the plane, a wall in a point
cloud, a rigid motion of 3-D points. Coordinates may have any unit; residuals have the same.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.models.base import Flags, MotionModel
from mssegment.records import Camera, Floats, Normalization


class DataModel(MotionModel):
    """A model of points [P, F, d] that are no pictures, by default with F = 1 and any d.

    ``dimension`` is the number of coordinates d. Subclasses that need a certain d set
    ``coordinates``.
    """

    of_pictures: ClassVar[bool] = False
    leaves_parallax_free: ClassVar[bool] = True
    min_frames: ClassVar[int] = 1
    max_frames: ClassVar[int | None] = 1
    coordinates: ClassVar[int | None] = None
    through_origin: ClassVar[bool] = False
    """Whether structures hold the origin, which must then not be moved."""

    frames: int = 1
    dimension: int

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """Median position as the origin, median distance from it as the unit.

        Outliers, however far, hardly change them.
        """
        del camera
        frames, d = points.shape[1:]
        centres = np.zeros((frames, d))
        if not self.through_origin and len(points):
            centres = np.median(points, axis=0)
        distances = np.sqrt(((points - centres) ** 2).sum(axis=-1))
        scale = float(np.median(distances)) if distances.size else 0.0
        if scale == 0.0:
            scale = float(distances.max(initial=0.0))
        return Normalization(centres, scale if scale > 0.0 else 1.0)


def vectors_of(observed: Floats) -> Floats:
    """The single view of points [..., 1, d], as vectors [..., d]."""
    return observed[..., 0, :]


def no_fits(shape: tuple[int, ...]) -> tuple[Floats, Flags]:
    """The result of a fit to no motions."""
    return np.zeros((0, *shape)), np.zeros(0, dtype=bool)
