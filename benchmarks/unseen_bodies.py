"""Rigid bodies of 3-D points: their shapes, and how cameras see them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats

Flags = npt.NDArray[np.bool_]

STEEPEST = 60.0
"""Largest tilt of a plane or sheet against the picture, degrees."""


@dataclass(frozen=True)
class Body:
    """Points [n, 3] of a rigid body and its projections [F, 3, 4].

    A projection takes the body's own coordinates to homogeneous pixels of one frame; an affine
    camera has the last row (0, 0, 0, 1). ``turning`` is the rotation that the camera sees from the
    first to the last frame, in degrees.
    """

    points: Floats
    projections: Floats
    turning: float = 0.0

    def homogeneous(self, points: Floats) -> Floats:
        """Homogeneous pixels [n, F, 3] of points [n, 3] of this body."""
        return np.asarray(
            np.einsum("fij,nj->nfi", self.projections[..., :3], points) + self.projections[..., 3]
        )

    def project(self, points: Floats) -> Floats:
        """Pixels [n, F, 2] of points [n, 3] of this body."""
        seen = self.homogeneous(points)
        return np.asarray(seen[..., :2] / seen[..., 2:])

    @property
    def tracks(self) -> Floats:
        """The tracks [n, F, 2] of the body's points, without noise."""
        return self.project(self.points)

    @property
    def perspective(self) -> float:
        """Range of depths in the first frame over their mean; 0 under an affine camera."""
        depths = self.homogeneous(self.points)[:, 0, 2]
        return float(np.ptp(depths) / depths.mean())


def rotation(axis_angle: Floats) -> Floats:
    """The rotation [3, 3] about a vector [3] whose length is the angle (Rodrigues)."""
    angle = float(np.linalg.norm(axis_angle))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = axis_angle / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)


def angle_of(turn: Floats) -> float:
    """The angle of a rotation [3, 3], degrees."""
    return float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0))))


def box(rng: np.random.Generator, count: int, view: Floats) -> Floats:
    """Points on the faces of a random box that look at the camera along ``view``."""
    sides = rng.uniform(0.5, 1.0, 3)
    sides *= 1.2 / np.linalg.norm(sides)
    axis = rng.normal(size=3)
    turn = rotation(axis / np.linalg.norm(axis) * rng.uniform(0, np.pi))
    normals = np.concatenate([turn.T, -turn.T])
    facing = -(normals @ view)
    visible = np.flatnonzero(facing > 0.05)
    area = facing[visible] * (sides.prod() / sides)[visible % 3]
    face = rng.choice(visible, count, p=area / area.sum())
    own = rng.uniform(-1, 1, (count, 3)) * sides
    own[np.arange(count), face % 3] = 0.0
    return np.asarray(own @ turn.T + normals[face] * sides[face % 3][:, None])


def ball(rng: np.random.Generator, count: int, view: Floats) -> Floats:
    """Points on the half of a sphere that looks at the camera."""
    points = rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points[points @ view > 0] *= -1
    return np.asarray(points)


def plane(rng: np.random.Generator, count: int, view: Floats) -> Floats:
    """Points on a tilted rectangle."""
    del view
    flat = rng.uniform(-1, 1, (count, 2)) * rng.uniform(0.5, 1.0, 2)
    return np.asarray(np.column_stack([flat, np.zeros(count)]) @ _tilt(rng).T)


def sheet(rng: np.random.Generator, count: int, view: Floats) -> Floats:
    """Points on a tilted sheet with waves."""
    del view
    flat = rng.uniform(-1, 1, (count, 2))
    wave, phase = rng.uniform(0.5, 2.0, 2), rng.uniform(0, 2 * np.pi, 2)
    height = rng.uniform(0.1, 0.4) * np.sin(wave * flat + phase).sum(axis=1)
    return np.asarray(np.column_stack([flat, height - height.mean()]) @ _tilt(rng).T)


SHAPES: dict[str, Callable[[np.random.Generator, int, Floats], Floats]] = {
    "box": box,
    "ball": ball,
    "plane": plane,
    "sheet": sheet,
}
"""Shapes of about unit radius about the origin: points [count, 3] from a line of sight [3]."""


def relief(rng: np.random.Generator, place: Floats) -> Floats:
    """Depth, 0 near to 1 far, of each place [n, 2] of a picture of unit size.

    It is one of three kinds: layers, a smooth relief, or a cloud without any order.
    """
    kind = rng.choice(["layers", "smooth", "cloud"])
    if kind == "cloud":
        return rng.uniform(0, 1, len(place))
    angle, wave = rng.uniform(0, 2 * np.pi, 3), rng.uniform(0.5, 2.0, 3)
    across = place[:, :1] * np.cos(angle) + place[:, 1:] * np.sin(angle)
    height = np.sin(2 * np.pi * wave * across + rng.uniform(0, 2 * np.pi, 3)).sum(axis=1)
    height = (height - height.min()) / max(float(np.ptp(height)), 1e-9)
    return np.asarray(np.floor(height * 2.999) / 2 if kind == "layers" else height)


def _tilt(rng: np.random.Generator) -> Floats:
    """A random rotation in the picture, then a tilt out of it."""
    angle, tilt = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(0, STEEPEST))
    roll = rotation(np.array([0, 0, rng.uniform(0, 2 * np.pi)]))
    return np.asarray(rotation(tilt * np.array([np.cos(angle), np.sin(angle), 0.0])) @ roll)
