"""One window of a long sequence: its motions, and one label for every track."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mssegment import pipeline
from mssegment.blas import with_one_thread
from mssegment.configuration import Configuration
from mssegment.documents import HistoryEntry, TracksDocument
from mssegment.errors import DataError
from mssegment.models import Flags
from mssegment.records import (
    BACKGROUND,
    NOT_JUDGED,
    Camera,
    Floats,
    Frame,
    Integers,
    Motion,
    Record,
    Strategy,
    Tracks,
    replace,
)
from mssegment.sequences.adoption import adopted
from mssegment.sequences.membership import left_behind, members, without_strangers
from mssegment.sequences.parts import coherent, join_parts, split_apart, without_borders
from mssegment.sequences.short_tracks import label_short_tracks

LEAST_LENGTH = 3
"""Frames of a window in which a track is visible to be segmented, as in ``matching.klt``."""


class SegmentedWindow(Record, frozen=True):
    """The segmentation of one window.

    Attributes
    ----------
    labels : ndarray [P] of int64
        1..m for a motion, 0 outlier, -1 background, -2 not judged.
    shown : ndarray [P, L] of bool
        The frames in which a track is visible, and moves with its motion if it has one.
    stuck : ndarray [P] of bool
        The tracks that stand still at their end, while their motion goes on.
    motions : tuple of Motion
        The motions, label 1 first; that of an object in several parts is the motion of the largest.
    camera_motion : int or None
        The label of the motion of the static world.
    is_static : bool
        Whether the camera is static.
    strategy : str or None
        How the motions were found; None where nothing moves.
    notes : tuple of str
        What was decided, and what could not be.
    """

    labels: Integers
    shown: Flags
    stuck: Flags
    motions: tuple[Motion, ...] = ()
    camera_motion: int | None = None
    is_static: bool = False
    strategy: Strategy | None = None
    notes: tuple[str, ...] = ()


@with_one_thread
def segment_window(
    points: Floats,
    frames: Sequence[Frame],
    configuration: Configuration,
    *,
    earlier_background: npt.NDArray[np.bool_],
    moved_before: npt.NDArray[np.bool_] | None = None,
    camera: Camera | None = None,
    history: Sequence[HistoryEntry] = (),
) -> SegmentedWindow:
    """Segment the tracks of one window like a clip of its length.

    Parameters
    ----------
    points : ndarray [P, L, 2]
        Tracks in pixels, NaN where a point is not visible.
    frames : sequence of Frame
        The L frames.
    configuration : Configuration
        The settings.
    earlier_background : ndarray [P] of bool
        Tracks that were background in the window before.
    moved_before : ndarray [P] of bool, optional
        Tracks that have moved with a motion in earlier windows.
    camera : Camera, optional
        The camera of the tracks, where the configuration has none.
    history : sequence of HistoryEntry
        How the tracks were made.

    Returns
    -------
    SegmentedWindow
        Without motions, and with a note, where there are too few tracks.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    long_enough = np.flatnonzero(visible.sum(axis=1) >= min(LEAST_LENGTH, points.shape[1]))
    labels = np.full(len(points), NOT_JUDGED, dtype=np.int64)
    document = TracksDocument(
        frames=list(frames),
        camera=camera,
        tracks=Tracks(points=points[long_enough]),
        history=list(history),
    )
    try:
        drawn = pipeline.hypothesize(document, configuration, earlier_background[long_enough])
        found = pipeline.cluster(
            drawn,
            configuration,
            with_modes=False,
            moved_before=None if moved_before is None else moved_before[long_enough],
        )
    except DataError as error:
        nothing = np.zeros(len(points), dtype=bool)
        return SegmentedWindow(labels, visible, nothing, notes=(f"no motions: {error}",))
    labels[long_enough] = found.labels
    notes = [note for entry in found.history[len(history) :] for note in entry.notes]
    is_static = bool((found.labels == BACKGROUND).any())
    objects = _objects(points, visible, labels) if is_static else labels
    judged = label_short_tracks(points, objects)
    shown, stuck = visible, np.zeros(len(points), dtype=bool)
    if is_static:
        shown = members(points, judged)
        stuck = left_behind(judged, visible, shown)
        judged = without_strangers(judged, visible, shown)
        shown = np.where((judged > 0)[:, None], shown, visible)
    return SegmentedWindow(
        labels=judged,
        shown=shown,
        stuck=stuck,
        motions=_motions(found.motions, labels, objects),
        camera_motion=found.camera_motion,
        is_static=is_static,
        strategy=found.strategy if found.motions else None,
        notes=tuple(dict.fromkeys(notes)),
    )


def _objects(points: Floats, visible: Flags, labels: Integers) -> Integers:
    """The objects before a static camera, from groups of tracks that move alike."""
    shown = members(points, labels)
    own = without_strangers(labels, visible, shown)
    pieces = coherent(points, split_apart(points, own, shown), shown)
    whole = without_borders(points, join_parts(points, pieces, shown), shown)
    return adopted(points, whole, shown)


def _motions(motions: Sequence[Motion], labels: Integers, objects: Integers) -> tuple[Motion, ...]:
    """The motion of each object: that of its largest part, with the label of the object."""
    found = []
    for number in range(1, int(objects.max(initial=0)) + 1):
        of_motion = labels[(objects == number) & (labels > 0)]
        largest = int(np.bincount(of_motion).argmax())
        motion = motions[largest - 1]
        found.append(replace(motion, label=number, inliers=np.flatnonzero(objects == number)))
    return tuple(found)
