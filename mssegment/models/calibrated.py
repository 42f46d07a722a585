"""What the models of two calibrated views share."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.projective import homogeneous
from mssegment.models.base import EXAMPLE_CAMERA, MotionModel
from mssegment.records import LARGEST_COORDINATE, Camera, Floats, Normalization


class CalibratedModel(MotionModel):
    """A rigid motion before a calibrated camera, of which only the direction can be seen.

    The principal point is the origin and the focal length the unit. A motion and its negative have
    the same epipolar lines; the points of a body move along them to one side.
    """

    needs_camera: ClassVar[bool] = True
    leaves_parallax_free: ClassVar[bool] = True

    def example_space(
        self, rng: np.random.Generator, count: int, right: float, bottom: float
    ) -> Floats:
        """Points in space [count, 3] at depths of 3 to 5.

        ``EXAMPLE_CAMERA`` sees them between (50, 50) and (right, bottom).
        """
        x = rng.uniform([50.0, 50.0], [right, bottom], (count, 2))
        rays = homogeneous((x - _MIDDLE) / _FOCAL)
        return np.asarray(rays * rng.uniform(3.0, 5.0, (count, 1)))

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """Normalized image coordinates: principal point at the origin, focal length 1.

        Raises
        ------
        ValueError
            Without a camera.
        """
        if camera is None:
            raise ValueError(f"{self.name} needs a camera")
        centres = np.tile([camera.cx, camera.cy], (points.shape[1], 1))
        return Normalization(centres, camera.fx, camera.fy / camera.fx)

    def observe(self, points: Floats, normalization: Normalization) -> Floats:
        """Normalized image coordinates [P, 2, 2]."""
        return np.asarray((points - normalization.centres) / focal_lengths(normalization))

    def orientations(self, points: Floats) -> Floats:
        """A motion and its negative: a mode has no sign."""
        return np.concatenate([points, -points])

    def log_free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """Along its epipolar line a match may move as far as the longest match does."""
        shift = (observed[:, 1] - observed[:, 0]) * normalization.scale
        return float(np.log(max(np.linalg.norm(shift, axis=1).max(initial=0.0), 1.0)))


_FOCAL = np.array([EXAMPLE_CAMERA.fx, EXAMPLE_CAMERA.fy])
_MIDDLE = np.array([EXAMPLE_CAMERA.cx, EXAMPLE_CAMERA.cy])


def seen_by_example(*spaces: Floats) -> Floats:
    """The points in space [P, 3] of each view as ``EXAMPLE_CAMERA`` sees them, [P, F, 2]."""
    return np.stack([s[:, :2] / s[:, 2:] * _FOCAL + _MIDDLE for s in spaces], axis=1)


def focal_lengths(normalization: Normalization) -> Floats:
    """fx and fy in pixels."""
    return normalization.scale * np.array([1.0, normalization.aspect])


def epipole_in_pixels(direction: Floats, normalization: Normalization) -> Floats:
    """The vanishing point [2] of a direction [3] in the first view; NaN if it is very far away."""
    with np.errstate(divide="ignore", invalid="ignore"):
        place = focal_lengths(normalization) * direction[:2] / direction[2]
    epipole = normalization.centres[0] + place
    near = (np.abs(epipole) <= LARGEST_COORDINATE).all()
    return np.asarray(epipole) if near else np.full(2, np.nan)
