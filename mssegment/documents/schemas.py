"""The documents that the stages exchange, one msgspec type each.

Every document has its ``schema``, the frames (path as given, size, SHA-256), everything that the
later stages need, and its ``history``. It has no times, thread counts or output folders, so that
the same input and seed give the same bytes.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import msgspec
import numpy as np

from mssegment.documents.checks import (
    are_pictures,
    check_assignments,
    check_camera,
    check_frames,
    check_inside,
    check_modes,
    check_motions,
    check_sets,
    check_shape,
    check_status,
    check_tracks,
)
from mssegment.records import (
    Camera,
    ClusterResult,
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
    Strategy,
    Tracks,
)


class HistoryEntry(Record, frozen=True):
    """One stage of the processing: its version, the settings that affect it, and its notes.

    Attributes
    ----------
    stage : str
        The command.
    version : str
        The version of the program.
    settings : dict
        The settings that change the result of the stage, by key.
    notes : tuple of str
        What was decided, and what could not be.
    """

    stage: str
    version: str
    settings: dict[str, Any]
    notes: tuple[str, ...] = ()


class Document(msgspec.Struct, kw_only=True, frozen=True, tag_field="schema"):
    """The fields that all documents have in common.

    Attributes
    ----------
    frames : list of Frame
        The images, or the frames of a video; data that is no picture has frames without a size.
    camera : Camera or None
        The calibration, where it is known.
    history : list of HistoryEntry
        The stages that made the document, the first one first.
    """

    kind: ClassVar[str]
    """The name of the document: corners, tracks, hypotheses or segmentation."""
    made_by: ClassVar[str]
    """The command that writes this document."""

    frames: list[Frame]
    camera: Camera | None = None
    history: list[HistoryEntry] = []

    @property
    def of_pictures(self) -> bool:
        """Whether the positions are pixels of pictures, and not data of another kind."""
        return are_pictures(self.frames)

    def __post_init__(self) -> None:
        """Raises ValueError for frames without a valid size, or an impossible camera."""
        check_frames(self.frames)
        if self.camera is not None:
            check_camera(self.camera)


class CornersDocument(Document, frozen=True, tag="mssegment/corners/1"):
    """The document that ``detect`` writes: the corners of each frame.

    Attributes
    ----------
    corners : list of Corners
        One entry per frame.
    """

    kind: ClassVar[str] = "corners"
    made_by: ClassVar[str] = "detect"

    corners: list[Corners]

    def __post_init__(self) -> None:
        """Raises ValueError if the arrays do not match the frames or each other."""
        super().__post_init__()
        if len(self.corners) != len(self.frames):
            raise ValueError(
                f"corners has {len(self.corners)} entries for {len(self.frames)} frames; expected "
                "one per frame"
            )
        for i, corners in enumerate(self.corners):
            check_shape(corners.points, (None, 2), f"corners[{i}].points")
            count = (len(corners.points),)
            check_shape(corners.responses, count, f"corners[{i}].responses")
            check_shape(corners.scales, count, f"corners[{i}].scales")
            if not np.isfinite(corners.points).all():
                raise ValueError(f"corners[{i}].points holds null; expected [x, y] in pixels")
            check_inside(corners.points, self.frames[i], f"corners[{i}].points")
            if not np.isfinite(corners.responses).all():
                raise ValueError(f"corners[{i}].responses holds null; expected numbers")
            if not (corners.scales > 0).all():
                raise ValueError(f"corners[{i}].scales must be above 0, without null")


class TracksDocument(Document, frozen=True, tag="mssegment/tracks/1"):
    """The document that ``match`` and ``import`` write: tracks, with true labels if known.

    Attributes
    ----------
    tracks : Tracks
        The tracks [P, F, 2].
    """

    kind: ClassVar[str] = "tracks"
    made_by: ClassVar[str] = "match"

    tracks: Tracks

    def __post_init__(self) -> None:
        """Raises ValueError if the arrays do not match the frames or each other."""
        super().__post_init__()
        check_tracks(self.tracks, self.frames)


class HypothesesDocument(Document, frozen=True, tag="mssegment/hypotheses/2"):
    """The document that ``hypothesize`` writes: sets of hypotheses, points on manifolds.

    Attributes
    ----------
    tracks : Tracks
        The tracks [P, F, 2].
    status : ndarray [P] of int64
        0 for a track that is to be segmented, -1 background, -2 not judged.
    strategy : {"modes", "mixture", "consensus"}
        How ``cluster`` turns the hypotheses into motions.
    sets : list of HypothesisSet
        The hypotheses.
    partition : str or None
        How consensus groups the tracks; None for the other strategies.
    log_nfa : ndarray [P] of float64, or None
        Logarithm of the expected number of false alarms of each track; from 0 on it is an outlier.
    """

    kind: ClassVar[str] = "hypotheses"
    made_by: ClassVar[str] = "hypothesize"

    tracks: Tracks
    status: Integers
    strategy: Strategy
    sets: list[HypothesisSet]
    partition: Partition | None = None
    log_nfa: Floats | None = None

    @property
    def hypotheses(self) -> Hypotheses:
        """Strategy and sets as one record."""
        return Hypotheses(self.strategy, tuple(self.sets), self.partition, self.log_nfa)

    def __post_init__(self) -> None:
        """Raises ValueError if the arrays do not match the frames or each other."""
        super().__post_init__()
        check_tracks(self.tracks, self.frames)
        check_status(self.status, self.tracks)
        check_sets(self.sets, self.tracks, self.frames)
        if self.sets and (self.strategy == "consensus") != (self.partition is not None):
            raise ValueError(f"strategy is {self.strategy}, but partition is {self.partition}")
        if self.log_nfa is not None:
            check_shape(self.log_nfa, (len(self.tracks.points),), "log_nfa")


class SegmentationDocument(Document, frozen=True, tag="mssegment/segmentation/2"):
    """The document that ``cluster`` writes: modes, motions, and one label per track.

    Attributes
    ----------
    strategy : {"modes", "mixture", "consensus"}
        How the motions were found.
    labels : ndarray [P] of int64
        1..m for a motion, 0 outlier, -1 background, -2 not judged.
    motions : tuple of Motion
        The motions, label 1 first.
    modes : tuple of Mode
        The modes of the hypotheses, strongest first.
    bandwidths : tuple of float
        The bandwidth of each set, in the distance of its manifold.
    notes : tuple of str
        Notes of this stage for the user.
    residuals : ndarray [m, P] of float64
        Residual of each track from each motion, in pixels; NaN where there is none.
    assignments : tuple of ndarray of int64
        For each set, the index of the mode that each hypothesis converges to; -1 for none.
    tracks : Tracks
        The tracks [P, F, 2].
    sets : list of HypothesisSet
        The sets of hypotheses.
    camera_motion : int or None
        The label of the motion of the static world under a moving camera; None if it is not known.
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
    camera_motion: int | None = None

    @property
    def segmentation(self) -> ClusterResult:
        """The segmentation as one record."""
        return ClusterResult(
            labels=self.labels,
            modes=self.modes,
            motions=self.motions,
            bandwidths=self.bandwidths,
            residuals=self.residuals,
            assignments=self.assignments,
            notes=self.notes,
            camera_motion=self.camera_motion,
        )

    def __post_init__(self) -> None:
        """Raises ValueError if the arrays do not match the frames or each other."""
        super().__post_init__()
        check_tracks(self.tracks, self.frames)
        check_sets(self.sets, self.tracks, self.frames)
        count = len(self.tracks.points)
        check_shape(self.labels, (count,), "labels")
        if len(self.labels) and (self.labels.max() > len(self.motions) or self.labels.min() < -2):
            raise ValueError(
                f"labels range from {self.labels.min()} to {self.labels.max()}; expected -2 to "
                f"{len(self.motions)}, the number of motions"
            )
        if len(self.motions):
            check_shape(self.residuals, (len(self.motions), count), "residuals")
        check_motions(self.motions, count, self.sets)
        check_modes(self.modes, len(self.motions), self.sets)
        check_assignments(self.assignments, len(self.modes), self.sets)
        for i, bandwidth in enumerate(self.bandwidths):
            if not 0 <= bandwidth < math.inf:
                raise ValueError(f"bandwidths[{i}] is {bandwidth:g}; expected at least 0")
        if self.camera_motion is not None and not 1 <= self.camera_motion <= len(self.motions):
            raise ValueError(
                f"camera_motion is {self.camera_motion}; expected null, or 1 to "
                f"{len(self.motions)}, the number of motions"
            )


DOCUMENTS: dict[str, type[Document]] = {
    "mssegment/corners/1": CornersDocument,
    "mssegment/tracks/1": TracksDocument,
    "mssegment/hypotheses/2": HypothesesDocument,
    "mssegment/segmentation/2": SegmentationDocument,
}
