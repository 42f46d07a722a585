"""The documents between the stages, one msgspec type each.

Every document names its ``schema``, carries the frames (path as given, size, SHA-256), all that
the later stages need, and its ``history``; no times, threads or output folders, so that the same
input and seed give the same bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec
import numpy as np

from mssegment.records import (
    Camera,
    Corners,
    Floats,
    Frame,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Segmentation,
    Tracks,
)


@dataclass(frozen=True)
class HistoryEntry:
    """One stage that worked on the document, with the settings that change its result."""

    stage: str
    version: str
    settings: dict[str, Any]
    notes: tuple[str, ...] = ()


class Document(msgspec.Struct, kw_only=True, frozen=True, tag_field="schema"):
    """What all documents share."""

    kind: ClassVar[str]
    """The stage's noun: corners, tracks, hypotheses, segmentation."""
    made_by: ClassVar[str]
    """The command that writes this document."""

    frames: list[Frame]
    camera: Camera | None = None
    history: list[HistoryEntry] = []


class CornersDocument(Document, frozen=True, tag="mssegment/corners/1"):
    """What ``detect`` writes: the corners of each frame."""

    kind: ClassVar[str] = "corners"
    made_by: ClassVar[str] = "detect"

    corners: list[Corners]

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        if len(self.corners) != len(self.frames):
            raise ValueError(f"{len(self.corners)} lists of corners for {len(self.frames)} frames")
        for i, corners in enumerate(self.corners):
            _check_shape(corners.points, (None, 2), f"corners[{i}].points")
            count = (len(corners.points),)
            _check_shape(corners.responses, count, f"corners[{i}].responses")
            _check_shape(corners.scales, count, f"corners[{i}].scales")
            if not np.isfinite(corners.points).all():
                raise ValueError(f"corners[{i}].points holds null, a corner needs both numbers")


class TracksDocument(Document, frozen=True, tag="mssegment/tracks/1"):
    """What ``match`` and ``import`` write: tracks, and their true labels where they are known."""

    kind: ClassVar[str] = "tracks"
    made_by: ClassVar[str] = "match"

    tracks: Tracks

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        _check_tracks(self.tracks, len(self.frames))


class HypothesesDocument(Document, frozen=True, tag="mssegment/hypotheses/1"):
    """What ``hypothesize`` writes: sets of points on manifolds, made from the tracks.

    ``status`` [P] is 0 for a track that is to be segmented, else the label it keeps (-1
    background, -2 not judged).
    """

    kind: ClassVar[str] = "hypotheses"
    made_by: ClassVar[str] = "hypothesize"

    tracks: Tracks
    status: Integers
    sets: list[HypothesisSet]

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        _check_tracks(self.tracks, len(self.frames))
        _check_status(self.status, self.tracks)
        _check_sets(self.sets, self.tracks, len(self.frames))


class SegmentationDocument(Document, frozen=True, tag="mssegment/segmentation/1"):
    """What ``cluster`` writes: modes, motions, and one label per track.

    ``labels`` [P]: 1..m motions, 0 outlier, -1 background, -2 not judged.
    """

    kind: ClassVar[str] = "segmentation"
    made_by: ClassVar[str] = "cluster"

    labels: Integers
    motions: tuple[Motion, ...]
    modes: tuple[Mode, ...]
    bandwidths: tuple[float, ...]
    notes: tuple[str, ...]
    residuals: Floats
    assignments: tuple[Integers, ...]
    tracks: Tracks
    sets: list[HypothesisSet]

    @property
    def segmentation(self) -> Segmentation:
        """The same as one record."""
        return Segmentation(
            labels=self.labels,
            modes=self.modes,
            motions=self.motions,
            bandwidths=self.bandwidths,
            residuals=self.residuals,
            assignments=self.assignments,
            notes=self.notes,
        )

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        _check_tracks(self.tracks, len(self.frames))
        _check_sets(self.sets, self.tracks, len(self.frames))
        count = len(self.tracks.points)
        _check_shape(self.labels, (count,), "labels")
        if len(self.labels) and (self.labels.max() > len(self.motions) or self.labels.min() < -2):
            raise ValueError(f"labels go from -2 to {len(self.motions)}, the number of motions")
        if len(self.motions):
            _check_shape(self.residuals, (len(self.motions), count), "residuals")
        for i, motion in enumerate(self.motions):
            _check_indices(motion.inliers, count, f"motions[{i}].inliers", "tracks")


DOCUMENTS: dict[str, type[Document]] = {
    "mssegment/corners/1": CornersDocument,
    "mssegment/tracks/1": TracksDocument,
    "mssegment/hypotheses/1": HypothesesDocument,
    "mssegment/segmentation/1": SegmentationDocument,
}


def _check_shape(array: Floats | Integers, expected: tuple[int | None, ...], name: str) -> None:
    """Raises ValueError where the shape differs; None stands for any length."""
    fits = array.ndim == len(expected) and all(
        want in (None, have) for want, have in zip(expected, array.shape, strict=True)
    )
    if not fits:
        shape = " x ".join("n" if n is None else str(n) for n in expected)
        found = " x ".join(str(n) for n in array.shape)
        raise ValueError(f"{name} is {found}, {shape} was expected")


def _check_indices(indices: Integers, count: int, name: str, things: str) -> None:
    if indices.size and (indices.min() < 0 or indices.max() >= count):
        raise ValueError(
            f"{name} goes from {indices.min()} to {indices.max()}, but there are {count} {things}"
        )


def _check_tracks(tracks: Tracks, frames: int) -> None:
    _check_shape(tracks.points, (None, frames, 2), "tracks.points")
    count = len(tracks.points)
    half_seen = np.isfinite(tracks.points).any(axis=-1) != np.isfinite(tracks.points).all(axis=-1)
    if half_seen.any():
        track, frame = np.argwhere(half_seen)[0]
        raise ValueError(f"tracks.points[{track}][{frame}] has one number and one null")
    if tracks.affines is not None:
        _check_shape(tracks.affines, (count, 2, 2), "tracks.affines")
    if tracks.labels is not None:
        _check_shape(tracks.labels, (count,), "tracks.labels")


def _check_status(status: Integers, tracks: Tracks) -> None:
    _check_shape(status, (len(tracks.points),), "status")
    if status.size and (status.max() > 0 or status.min() < -2):
        raise ValueError("status holds 0 (to be segmented), -1 (background) or -2 (not judged)")


def _check_sets(sets: list[HypothesisSet], tracks: Tracks, frames: int) -> None:
    for i, chosen in enumerate(sets):
        name = f"sets[{i}]"
        if len(chosen.points) != len(chosen.subsets):
            raise ValueError(
                f"{name} has {len(chosen.points)} points of {len(chosen.subsets)} subsets"
            )
        _check_indices(chosen.subsets, len(tracks.points), f"{name}.subsets", "tracks")
        _check_indices(np.array(chosen.frames, dtype=np.int64), frames, f"{name}.frames", "frames")
        if not np.isfinite(chosen.points).all():
            raise ValueError(f"{name}.points holds null, every hypothesis needs all its numbers")
