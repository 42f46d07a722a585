"""The label of every pixel of a frame, from evidence, nearness, colours and edges."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.masks.cut import LabelMap, colour_costs, expand, guided_filter
from mssegment.masks.evidence import (
    Costs,
    Picture,
    Scene,
    nearness_costs,
    photometric_costs,
    track_distances,
)
from mssegment.neighbours import nearest
from mssegment.progress import track
from mssegment.records import BACKGROUND, Floats, Frame, Integers

UNKNOWN = 255
"""Value of pixels whose motion is not known."""
WORLD = 0
"""Value of the static world."""
LONG_SIDE = 427
"""Pixels along the longer side at which pixels are labelled; the borders are then refined."""
RADIUS = 6
"""Radius in pixels of the guided filter of the costs."""
NOISE = 1e-3
"""Variance of grey values (0 to 1) below which the guided filter takes an area as flat."""
ROUNDS = 2
"""How often the colours of the labels are learnt anew."""
WORLD_FAR = 0.5
"""Nats that the static world gains far from the tracks of all objects, and loses on them: it is
everywhere, also where it is plain and has no tracks."""
UNKNOWN_FAR = 2.0
"""The same for pixels whose motion is not known, where no track shows the static world."""
SPACING_SHARE = 0.9
"""Quantile of the distances of neighbouring tracks that counts as their spacing."""


def label_pixels(
    points: Floats,
    labels: Integers,
    frames: Sequence[Frame],
    pictures: Callable[[int], Picture | None],
    camera_motion: int | None = None,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Label every pixel of every frame with its motion.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        The tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        Their labels.
    frames : sequence of Frame
        The F frames.
    pictures : callable
        Gives the picture of a frame by its index, uint8 [height, width, 3] in BGR order.
    camera_motion : int, optional
        The label of the static world under a moving camera.

    Yields
    ------
    ndarray [height, width] of uint8
        For each frame 0 for the static world, the label of a motion, or ``UNKNOWN``: everything
        but the motions, if no track shows the static world.

    Raises
    ------
    DataError
        If a picture is not available.
    """
    sizes = np.array([(frame.width, frame.height) for frame in frames])
    scale = min(1.0, LONG_SIDE / int(sizes.max()))
    reduced = np.maximum(1, np.round(sizes * scale)).astype(np.int64)
    world = camera_motion
    if world is None and (labels == BACKGROUND).any():
        world = BACKGROUND
    motions = [int(label) for label in np.unique(labels[labels > 0]) if label != world]
    scene = Scene(
        pictures=[
            _resized(_picture(pictures, index, frames[index]), size)
            for index, size in enumerate(reduced)
        ],
        points=(points + 0.5) * (reduced / sizes) - 0.5,
        labels=labels,
        shown=tuple(motions) if world is None else (world, *motions),
        world=world,
    )
    values = np.array([UNKNOWN if world is None else WORLD, *motions], dtype=np.uint8)
    for index in track(range(len(frames)), "masks"):
        labelled = values[_label_frame(scene, index)]
        # the pictures of a long video at full size do not fit into the memory
        yield _enlarged(labelled, _picture(pictures, index, frames[index]), values)


def _picture(pictures: Callable[[int], Picture | None], index: int, frame: Frame) -> Picture:
    picture = pictures(index)
    if picture is None:
        name = frame.path or f"frame {index + 1}"
        raise DataError(f"{name}: masks need the picture of every frame; it is not available")
    return np.ascontiguousarray(picture)


def _resized(picture: Picture, size: Integers) -> Picture:
    width, height = (int(side) for side in size)
    if picture.shape[1::-1] == (width, height):
        return picture
    smaller = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(smaller, dtype=np.uint8)


def _label_frame(scene: Scene, frame: int) -> LabelMap:
    """Labels at the reduced size: 0 world or unknown, 1.. the motions in order."""
    picture = scene.pictures[frame]
    if set(scene.shown) <= {scene.world}:
        return np.zeros(picture.shape[:2], dtype=np.int64)
    guide = _grey(picture)
    distances = track_distances(scene, frame)
    first = 0 if scene.world is None else 1
    costs = photometric_costs(scene, frame)
    remote = _remoteness(scene, frame, distances[first:])
    if first:
        costs[0] -= WORLD_FAR * remote
        costs[1:] += nearness_costs(distances[1:])
    else:
        costs += nearness_costs(distances)
    costs = np.array([guided_filter(guide, cost, RADIUS, NOISE) for cost in costs])
    if not first:
        costs = np.concatenate([(costs.min(axis=0) - UNKNOWN_FAR * remote)[None], costs])
    tracks = [
        scene.pixels(scene.places(label, frame)[:, 0], frame) for label in scene.shown[first:]
    ]
    labels = with_tracks(costs.argmin(axis=0), tracks)
    # first the colours around the tracks, then those of what was found
    known = np.where((labels > 0) == (remote < 0), labels, -1)
    for _ in range(ROUNDS):
        coloured = costs + colour_costs(picture, known, len(costs))
        before, labels = labels, with_tracks(expand(coloured, labels, picture), tracks)
        if (labels == before).all():
            break
        known = labels
    return labels


def _remoteness(scene: Scene, frame: int, distances: Costs) -> Costs:
    """How much farther than usual the tracks of all objects are, from -1 to 1, for each pixel.

    -1 on a track, 0 half the spacing of the tracks away, 1 from the whole spacing on.
    """
    if not len(distances):
        width, height = scene.size(frame)
        return np.ones((height, width), dtype=np.float32)
    objects = scene.shown[len(scene.shown) - len(distances) :]
    spacings = [_spacing(scene.places(label, frame)[:, 0]) for label in objects]
    relative = (distances / np.array(spacings)[:, None, None]).min(axis=0)
    return np.asarray(2.0 * np.minimum(relative, 1.0) - 1.0, dtype=np.float32)


def _spacing(places: Floats) -> float:
    """Distance in pixels to the third neighbour, of most tracks."""
    if len(places) < 2:
        return 1.0
    distance, _ = nearest(places, places, min(4, len(places)))
    return max(1.0, float(np.quantile(distance[:, -1], SPACING_SHARE)))


def with_tracks(labels: LabelMap, tracks: Sequence[Integers]) -> LabelMap:
    """Keep the regions in which a motion has tracks, and fill the holes in which no other has any.

    Parameters
    ----------
    labels : ndarray [h, w]
        0, or 1.. for the motions.
    tracks : sequence of ndarray [n, 2]
        The pixels (x, y) of the tracks of motions 1, 2, ...
    """
    kept = np.zeros_like(labels)
    for label, pixels in enumerate(tracks, start=1):
        kept[_regions_with(labels == label, pixels)] = label
    for label in range(1, len(tracks) + 1):
        own = np.asarray(kept == label)
        outside = _touching_the_rim(~own)
        holes = ~own & ~outside & (kept == 0)
        kept[holes] = label
    return kept


def _regions_with(region: npt.NDArray[np.bool_], pixels: Integers) -> npt.NDArray[np.bool_]:
    """The connected parts of a region that contain one of the pixels or touch it."""
    _, parts = cv2.connectedComponents(region.astype(np.uint8))
    x, y = pixels.T
    near = cv2.dilate(parts.astype(np.float32), np.ones((3, 3), dtype=np.uint8)).astype(np.int64)
    used = np.union1d(parts[y, x], near[y, x])
    return np.asarray(np.isin(parts, used[used > 0]))


def _touching_the_rim(region: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """The connected parts of a region that reach the rim of the picture."""
    _, parts = cv2.connectedComponents(region.astype(np.uint8))
    rim = np.unique(np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]]))
    return np.asarray(np.isin(parts, rim[rim > 0]))


def _enlarged(
    labels: npt.NDArray[np.uint8], picture: Picture, values: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    """Labels at the size of the picture, with borders that follow its edges."""
    height, width = picture.shape[:2]
    if labels.shape == (height, width):
        return labels
    radius = max(1, round(width / labels.shape[1]))
    guide = _grey(picture)
    best = np.full((height, width), -np.inf, dtype=np.float32)
    found = np.full((height, width), values[0], dtype=np.uint8)
    for value in values:
        share = cv2.resize((labels == value).astype(np.float32), (width, height))
        share = guided_filter(guide, np.asarray(share), radius, NOISE)
        better = share > best
        best, found = np.where(better, share, best), np.where(better, value, found)
    return found


def _grey(picture: Picture) -> npt.NDArray[np.float32]:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.float32) / 255.0
