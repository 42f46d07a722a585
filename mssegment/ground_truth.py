"""Ground-truth labels in files, converted to one true label per track.

A table holds labelled points. Mask images and the shapes of labelling tools are read by
``annotations``, which also finds the frame of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mssegment.datasets import labels_from_masks, labels_from_points, read_located_labels
from mssegment.errors import DataError
from mssegment.inputs.files import is_pipe
from mssegment.neighbours import nearest
from mssegment.records import IGNORED, Floats, Frame, Integers, Record, Tracks

_TABLES = (".csv", ".tsv", ".txt")


class Truth(Record, frozen=True):
    """What label files say about the tracks of a scene.

    Attributes
    ----------
    labels : ndarray [P] of int64
        1..n for a motion, 0 outlier or no object, ``IGNORED`` where there is no label.
    masks : dict of int to ndarray [h, w]
        The masks by the index of their frame; empty for labelled points.
    note : str
        How much of the labels belongs to a track.
    notes : tuple of str
        What was assumed in reading them.
    """

    labels: Integers
    masks: dict[int, Integers]
    note: str
    notes: tuple[str, ...] = ()


def true_labels(
    paths: Sequence[str], tracks: Tracks, frames: Sequence[Frame], radius: float
) -> Integers:
    """Read the true label of every track: the ``labels`` of ``read_truth``."""
    return read_truth(paths, tracks, frames, radius).labels


def read_truth(
    paths: Sequence[str], tracks: Tracks, frames: Sequence[Frame], radius: float
) -> Truth:
    """Read the true label of every track, and the masks it is from.

    Parameters
    ----------
    paths : sequence of str
        One table of labelled points; or mask images, their folder, or files of labelling tools.
    tracks : Tracks
        The tracks [P, F, 2] in pixels.
    frames : sequence of Frame
        The frames of the tracks.
    radius : float
        Maximum distance in pixels from a labelled point to its track.

    Returns
    -------
    Truth

    Raises
    ------
    DataError
        If a file cannot be read, a mask belongs to no frame or has another shape, or no track gets
        a label.
    """
    tables = _tables(paths)
    notes: tuple[str, ...] = ()
    masks: dict[int, Integers] = {}
    if tables:
        places, labels = read_located_labels(Path(tables[0]))
        found = labels_from_points(tracks.points, places, labels, radius)
        note = _coverage(tracks.points, places, radius)
        hint = f"none lies within {radius:g} px of a track; do they belong to the same images?"
    else:
        masks, notes = _read_masks(paths, frames)
        found = labels_from_masks(tracks.points, masks)
        judged = int((found != IGNORED).sum())
        note = f"{judged} of {len(found)} tracks have a label in the {_count(len(masks), 'mask')}"
        hint = "every visible point lies outside the masks or where they are 255 (ignore)"
    if len(found) and (found == IGNORED).all():
        raise DataError(f"{', '.join(paths)}: the labels match no track: {hint}")
    return Truth(found, masks, note, notes)


def _coverage(points: Floats, places: Floats, radius: float) -> str:
    """How many labelled points [n, 2 or 4] lie near a track."""
    frames = places.shape[1] // 2
    seen = points[:, :frames]
    seen = seen[np.isfinite(seen).all(axis=(1, 2))].reshape(-1, 2 * frames)
    near = 0
    if len(seen):
        closest = seen[nearest(seen, places)[1][:, 0]]
        gaps = np.linalg.norm((places - closest).reshape(-1, frames, 2), axis=-1)
        near = int((gaps <= radius).all(axis=1).sum())
    return f"{near} of {_count(len(places), 'labelled point')} lie within {radius:g} px of a track"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def check_labels(paths: Sequence[str]) -> None:
    """Check before the first stage that label files can be read; raises DataError if not.

    Whether the labels match the tracks can only be checked once there are tracks.
    """
    for path in _tables(paths):
        read_located_labels(Path(path))
    if not _tables(paths):
        from mssegment.annotations import read_annotations

        read_annotations(paths)


def _tables(paths: Sequence[str]) -> list[str]:
    """The tables among some files of labels; raises DataError if there are other files too."""
    tables = [path for path in paths if Path(path).suffix.lower() in _TABLES]
    if tables and not any(is_pipe(path) for path in tables):
        from mssegment.annotations import holds_shapes

        tables = [path for path in tables if not holds_shapes(path)]
    if tables and len(paths) > 1:
        raise DataError(
            f"{', '.join(paths)}: expected either one table of labels or mask images, not both"
        )
    return tables


def _read_masks(
    paths: Sequence[str], frames: Sequence[Frame]
) -> tuple[dict[int, Integers], tuple[str, ...]]:
    """The mask of each labelled frame, at the size of the frame, and notes."""
    from mssegment.annotations import frames_of, read_annotations, scaled

    found = read_annotations(paths, frames)
    places, notes = frames_of(found.frames, frames, paths)
    masks: dict[int, Integers] = {}
    resized = []
    for place, labelled in places.items():
        masks[place], was_scaled = scaled(labelled, frames[place])
        if was_scaled:
            resized.append(labelled)
    if resized:
        height, width = resized[0].mask.shape
        frame = frames[0]
        notes += (
            f"{_count(len(resized), 'mask')} of {width}x{height} pixels scaled to "
            f"{frame.width}x{frame.height} by the nearest pixel",
        )
    return masks, (*found.notes, *notes)
