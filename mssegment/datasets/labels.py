"""Ground-truth labels of tracks, from label masks or from labelled points."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mssegment.datasets.columns import LABEL, X, Y, first_of, views_of
from mssegment.datasets.containers import InputFile
from mssegment.datasets.tables import read_table
from mssegment.datasets.track_columns import labels_of
from mssegment.errors import DataError
from mssegment.neighbours import nearest
from mssegment.records import IGNORED, LARGEST_COORDINATE, OUTLIER, Floats, Integers

MASK_IGNORE = 255
"""Mask value of pixels that are excluded from the evaluation."""


def labels_from_masks(points: Floats, masks: Mapping[int, npt.NDArray[np.integer]]) -> Integers:
    """True labels of tracks from the label masks of some frames.

    Parameters
    ----------
    points : ndarray [P, F, 2] of float64
        The tracks in pixels, NaN where a point is not visible.
    masks : mapping of int to ndarray [h, w] of integers
        Mask by frame index: 0 no object, n object n, 255 ignore.

    Returns
    -------
    ndarray [P] of int64
        n if all masks that have a label for the track agree on n; 0 (outlier) if they disagree or
        agree on 0; IGNORED if there is none, because in every labelled frame the track is not
        visible or its pixel is 255.

    Raises
    ------
    DataError
        If a mask belongs to no frame of the tracks or is not a single channel of integers.
    """
    lowest = np.full(len(points), np.iinfo(np.int64).max)
    highest = np.full(len(points), -1)
    for frame, mask in masks.items():
        if not 0 <= frame < points.shape[1]:
            raise DataError(
                f"mask of frame {frame + 1}: the tracks have only {points.shape[1]} frames; "
                "name each mask like the frame that it labels"
            )
        if mask.ndim != 2 or not np.issubdtype(mask.dtype, np.integer):
            raise DataError(
                f"mask of frame {frame + 1}: found {mask.dtype} {mask.shape}; expected one "
                "channel of whole numbers (0 no object, n object n, 255 ignore)"
            )
        place = np.round(np.nan_to_num(points[:, frame], nan=-1.0)).astype(int)
        height, width = mask.shape
        inside = ((place >= 0) & (place < (width, height))).all(axis=1)
        votes = np.full(len(points), MASK_IGNORE)
        votes[inside] = mask[place[inside, 1], place[inside, 0]]
        valid = votes != MASK_IGNORE
        lowest[valid] = np.minimum(lowest, votes)[valid]
        highest[valid] = np.maximum(highest, votes)[valid]
    agreed = np.where(lowest == highest, highest, OUTLIER)
    return np.where(highest < 0, IGNORED, agreed).astype(np.int64)


def labels_from_points(
    points: Floats, places: Floats, labels: Integers, radius: float = 3.0
) -> Integers:
    """True labels of tracks from labelled points.

    Parameters
    ----------
    points : ndarray [P, F, 2] of float64
        The tracks in pixels, NaN where a point is not visible.
    places : ndarray [n, 2] or [n, 4] of float64
        Labelled points in pixels: (x, y) in the first frame, or (x1, y1, x2, y2) in the first two.
    labels : ndarray [n] of int64
        Their labels: 0 outlier, n object n.
    radius : float
        Maximum distance in pixels, in each of these frames, between a track and its labelled point.

    Returns
    -------
    ndarray [P] of int64
        The label of the nearest labelled point, or IGNORED if it is farther away than ``radius``.

    Raises
    ------
    DataError
        If the labelled points have two frames but the tracks only one.
    """
    frames = places.shape[1] // 2
    if points.shape[1] < frames:
        raise DataError(
            "the labelled matches have two frames, but the tracks only one; expected x,y,label"
        )
    found = np.full(len(points), IGNORED, dtype=np.int64)
    seen = np.isfinite(points[:, :frames]).all(axis=(1, 2))
    if not len(places) or not seen.any():
        return found
    own = points[seen, :frames].reshape(-1, 2 * frames)
    place = nearest(places, own)[1][:, 0]
    gaps = np.linalg.norm((own - places[place]).reshape(-1, frames, 2), axis=-1)
    found[seen] = np.where((gaps <= radius).all(axis=1), labels[place], IGNORED)
    return found


def read_located_labels(path: Path) -> tuple[Floats, Integers]:
    """Read labelled points from a CSV.

    Parameters
    ----------
    path : Path
        A table with the columns ``x,y,label`` (first frame) or ``x1,y1,x2,y2,label`` (first two
        frames), in pixels.

    Returns
    -------
    places : ndarray [n, 2] or [n, 4] of float64
        The points in pixels.
    labels : ndarray [n] of int64
        Their labels.

    Raises
    ------
    DataError
        If the file cannot be read, a column is missing, or a value is not valid.
    """
    file = InputFile.opened(path)
    table = read_table(file.content, file.name)
    label = first_of(table, LABEL)
    names = [name for view in views_of(table)[:2] for name in view]
    names = names or [name for name in (first_of(table, X), first_of(table, Y)) if name]
    if label is None or len(names) < 2:
        raise DataError(
            f"{path}: found columns {','.join(table)}; expected x,y,label (first frame) or "
            "x1,y1,x2,y2,label"
        )
    places = np.stack([table.numbers(name) for name in names], axis=1)
    labels, _ = labels_of(table, label, file.name)
    if labels is None:
        raise DataError(f"{path}: column '{label}' holds text; expected 0, 1, 2, ...")
    wild = np.abs(places) > LARGEST_COORDINATE
    if wild.any():
        raise DataError(
            f"{path}: a label is at {places[wild][0]:g}; expected pixels, at most "
            f"{LARGEST_COORDINATE:g}"
        )
    seen = np.isfinite(places).all(axis=1)
    return places[seen], labels[seen]
