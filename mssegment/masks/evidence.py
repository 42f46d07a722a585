"""How well each motion explains each pixel: the photometric residual of its field.

The residual of a pixel that follows a motion is distributed as a Student t of 3 degrees of freedom,
whose scale is measured at the tracks; that of any other pixel is uniform over the grey values. A
cost is the negative logarithm of the density, relative to the peak of the former.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.masks.fields import Field, motion_field
from mssegment.records import Floats, Integers, Record

Costs = npt.NDArray[np.float32]
"""[labels, height, width], in nats per pixel."""
Picture = npt.NDArray[np.uint8]

GAPS = (1, 2, 4)
"""Frames between those that are compared: slow motions differ over the longer gaps only."""
BLUR = 1.0
"""Standard deviation in pixels of the blur before pictures are compared."""
T_PEAK = 0.3675
"""Density of a Student t distribution of 3 degrees of freedom and scale 1 at 0."""
GREY_VALUES = 256.0
OCCLUDED_SHARE = 0.75
"""Cost of a pixel of the static world that nothing explains, relative to that of an object's, where
there are frames on one side only: the world is what is covered and uncovered. Between frames on
both sides it is seen in one of them, and unexplained is rather what bends, such as legs."""
NEAREST_TRACK = 0.3
"""Weight of the logarithm of the distance to the nearest track of a motion."""
TRACK_RADIUS = 3.0
"""Pixels; the nearest track counts as at least this far away."""
FARTHEST = 3.0
"""Largest logarithm of the ratio of two distances."""


class Scene(Record, frozen=True):
    """What the masks are computed from.

    Attributes
    ----------
    pictures : sequence of ndarray [height, width, 3] of uint8
        The frames.
    points : ndarray [P, F, 2]
        The tracks, in pixels of these pictures.
    labels : ndarray [P] of int64
        Their labels.
    shown : tuple of int
        The labels of the motions that may be seen, the static world first if it is one of them.
    world : int or None
        The label of the static world.
    """

    pictures: Sequence[Picture]
    points: Floats
    labels: Integers
    shown: tuple[int, ...]
    world: int | None

    def size(self, frame: int) -> tuple[int, int]:
        """Width and height of a frame in pixels."""
        height, width = self.pictures[frame].shape[:2]
        return width, height

    def places(self, label: int, *frames: int) -> Floats:
        """The positions [n, len(frames), 2] of the tracks of a motion that all frames show."""
        own = self.points[self.labels == label][:, frames]
        return np.asarray(own[np.isfinite(own).all(axis=(1, 2))])

    def pixels(self, places: Floats, frame: int) -> Integers:
        """The pixels (x, y) [n, 2] of positions [n, 2] in a frame, without those outside it."""
        rounded = np.round(places).astype(np.int64)
        return rounded[((rounded >= 0) & (rounded < self.size(frame))).all(axis=1)]


def photometric_costs(scene: Scene, frame: int) -> Costs:
    """The cost of each motion at each pixel, compared with the frames before and after.

    Of the frames before and those after, the side that explains a pixel better counts: what one
    side covers, the other shows.
    """
    count = len(scene.pictures)
    sides = [
        [frame + step * gap for gap in GAPS if 0 <= frame + step * gap < count] for step in (-1, 1)
    ]
    share = 1.0 if all(sides) else OCCLUDED_SHARE
    costs = [
        np.mean([_pair_costs(scene, frame, other, share) for other in others], axis=0)
        for others in sides
        if others
    ]
    return np.asarray(np.min(costs, axis=0), dtype=np.float32)


def _pair_costs(scene: Scene, frame: int, other: int, share: float) -> Costs:
    """The costs from the comparison of two frames; ``share`` as ``OCCLUDED_SHARE``."""
    here, there = (_blurred(scene.pictures[index]) for index in (frame, other))
    squares: dict[int, npt.NDArray[np.float32]] = {}
    noise = []
    for label in scene.shown:
        tracks = scene.places(label, frame, other)
        field = motion_field(tracks[:, 0], tracks[:, 1], *scene.size(frame))
        if field is None:
            continue
        squares[label] = _residual_squares(here, there, field)
        x, y = scene.pixels(tracks[:, 0], frame).T
        noise.append(np.nanmedian(squares[label][y, x]))
    # grey values are whole numbers
    variance = max(float(np.median(noise)), 1.0) if noise else 1.0
    return _costs(scene, frame, squares, variance, share)


def _costs(
    scene: Scene,
    frame: int,
    squares: Mapping[int, npt.NDArray[np.float32]],
    variance: float,
    share: float,
) -> Costs:
    unexplained = np.log(T_PEAK * GREY_VALUES / np.sqrt(variance))
    width, height = scene.size(frame)
    costs = np.full((len(scene.shown), height, width), unexplained, dtype=np.float32)
    for index, label in enumerate(scene.shown):
        limit = unexplained * (share if label == scene.world else 1.0)
        if label not in squares:
            continue
        cost = 2.0 * np.log1p(squares[label] / (3.0 * variance))
        # outside the other picture there is no evidence
        costs[index] = np.where(np.isnan(cost), 0.5 * limit, np.minimum(cost, limit))
    return costs


def _blurred(picture: Picture) -> npt.NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(picture.astype(np.float32), (0, 0), BLUR))


def _residual_squares(
    here: npt.NDArray[np.float32], there: npt.NDArray[np.float32], field: Field
) -> npt.NDArray[np.float32]:
    """Mean squared difference of the channels; NaN where the field leaves the picture."""
    outside = (np.nan, np.nan, np.nan)
    warped = cv2.remap(
        there,
        field[..., 0],
        field[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=outside,
    )
    return np.asarray(((here - warped) ** 2).mean(axis=2), dtype=np.float32)


def track_distances(scene: Scene, frame: int) -> Costs:
    """The distance of each pixel from the nearest track of each motion, in pixels."""
    width, height = scene.size(frame)
    distances = []
    for label in scene.shown:
        free = np.full((height, width), 255, dtype=np.uint8)
        x, y = scene.pixels(scene.places(label, frame)[:, 0], frame).T
        free[y, x] = 0
        distances.append(
            cv2.distanceTransform(free, cv2.DIST_L2, 5)
            if len(x)
            else np.full((height, width), float(width + height), dtype=np.float32)
        )
    return np.asarray(distances, dtype=np.float32)


def nearness_costs(distances: Costs) -> Costs:
    """The logarithm of the distance to a motion, relative to that of the nearest motion.

    It decides where pictures do not: a plain area belongs to the motion whose tracks surround it.
    """
    far = distances + TRACK_RADIUS
    return np.asarray(NEAREST_TRACK * np.minimum(np.log(far / far.min(axis=0)), FARTHEST))
