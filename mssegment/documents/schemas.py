"""The documents between the stages, one msgspec type each.

Every document names its ``schema``, carries the frames (path as given, size, SHA-256), all that
the later stages need, and its ``history``; no times, threads or output folders, so that the same
input and seed give the same bytes.
"""

from __future__ import annotations

from typing import Any, ClassVar

import msgspec
import numpy as np

from mssegment.documents.checks import (
    check_camera,
    check_frames,
    check_modes,
    check_motions,
    check_reach,
    check_sets,
    check_shape,
    check_status,
    check_tracks,
)
from mssegment.records import (
    Camera,
    Corners,
    Floats,
    Frame,
    Hypotheses,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Partition,
    Record,
    Segmentation,
    Strategy,
    Tracks,
)


class HistoryEntry(Record, frozen=True):
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

    def __post_init__(self) -> None:
        """Raises ValueError for frames without a size, or a camera that is none."""
        check_frames(self.frames)
        if self.camera is not None:
            check_camera(self.camera)


class CornersDocument(Document, frozen=True, tag="mssegment/corners/1"):
    """What ``detect`` writes: the corners of each frame."""

    kind: ClassVar[str] = "corners"
    made_by: ClassVar[str] = "detect"

    corners: list[Corners]

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        super().__post_init__()
        if len(self.corners) != len(self.frames):
            raise ValueError(f"{len(self.corners)} lists of corners for {len(self.frames)} frames")
        for i, corners in enumerate(self.corners):
            check_shape(corners.points, (None, 2), f"corners[{i}].points")
            count = (len(corners.points),)
            check_shape(corners.responses, count, f"corners[{i}].responses")
            check_shape(corners.scales, count, f"corners[{i}].scales")
            if not np.isfinite(corners.points).all():
                raise ValueError(f"corners[{i}].points holds null, a corner needs both numbers")
            check_reach(corners.points, f"corners[{i}].points")
            if not (np.isfinite(corners.responses).all() and (corners.scales > 0).all()):
                raise ValueError(f"corners[{i}] has a response that is null, or a scale below 0")


class TracksDocument(Document, frozen=True, tag="mssegment/tracks/1"):
    """What ``match`` and ``import`` write: tracks, and their true labels where they are known."""

    kind: ClassVar[str] = "tracks"
    made_by: ClassVar[str] = "match"

    tracks: Tracks

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        super().__post_init__()
        check_tracks(self.tracks, len(self.frames))


class HypothesesDocument(Document, frozen=True, tag="mssegment/hypotheses/2"):
    """What ``hypothesize`` writes: sets of points on manifolds, made from the tracks.

    ``status`` [P] is 0 for a track that is to be segmented, else the label it keeps (-1
    background, -2 not judged). ``strategy`` and ``partition`` say how ``cluster`` turns the
    hypotheses into motions; see :class:`mssegment.records.Hypotheses`.
    """

    kind: ClassVar[str] = "hypotheses"
    made_by: ClassVar[str] = "hypothesize"

    tracks: Tracks
    status: Integers
    strategy: Strategy
    sets: list[HypothesisSet]
    partition: Partition | None = None

    @property
    def hypotheses(self) -> Hypotheses:
        """Strategy and sets as one record."""
        return Hypotheses(self.strategy, tuple(self.sets), self.partition)

    def __post_init__(self) -> None:
        """Raises ValueError where the arrays do not fit the frames or one another."""
        super().__post_init__()
        check_tracks(self.tracks, len(self.frames))
        check_status(self.status, self.tracks)
        check_sets(self.sets, self.tracks, len(self.frames))
        if self.sets and (self.strategy == "consensus") != (self.partition is not None):
            raise ValueError(f"strategy is {self.strategy}, but partition is {self.partition}")


class SegmentationDocument(Document, frozen=True, tag="mssegment/segmentation/2"):
    """What ``cluster`` writes: modes, motions, and one label per track.

    ``labels`` [P]: 1..m motions, 0 outlier, -1 background, -2 not judged.
    """

    kind: ClassVar[str] = "segmentation"
    made_by: ClassVar[str] = "cluster"

    strategy: Strategy
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
        super().__post_init__()
        check_tracks(self.tracks, len(self.frames))
        check_sets(self.sets, self.tracks, len(self.frames))
        count = len(self.tracks.points)
        check_shape(self.labels, (count,), "labels")
        if len(self.labels) and (self.labels.max() > len(self.motions) or self.labels.min() < -2):
            raise ValueError(f"labels go from -2 to {len(self.motions)}, the number of motions")
        if len(self.motions):
            check_shape(self.residuals, (len(self.motions), count), "residuals")
        check_motions(self.motions, count, len(self.sets))
        check_modes(self.modes, len(self.motions), len(self.sets))
        for i, (own, chosen) in enumerate(zip(self.assignments, self.sets, strict=False)):
            check_shape(own, (len(chosen.points),), f"assignments[{i}]")


DOCUMENTS: dict[str, type[Document]] = {
    "mssegment/corners/1": CornersDocument,
    "mssegment/tracks/1": TracksDocument,
    "mssegment/hypotheses/2": HypothesesDocument,
    "mssegment/segmentation/2": SegmentationDocument,
}
