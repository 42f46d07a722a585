"""All stages in memory, one after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mssegment.configuration import Configuration
from mssegment.documents import (
    CornersDocument,
    Document,
    HypothesesDocument,
    SegmentationDocument,
    TracksDocument,
)
from mssegment.pipeline.hypotheses import hypothesize
from mssegment.pipeline.inputs import open_input
from mssegment.pipeline.matches import detect, match
from mssegment.pipeline.motions import cluster
from mssegment.pipeline.settings import camera_for, check_settings
from mssegment.records import Floats, Integers, Motion, Record
from mssegment.resources import Timings

if TYPE_CHECKING:
    from mssegment.imaging.frames import FrameSource


class Outcome(Record, frozen=True):
    """The outcome of a whole run: labels and motions, and the documents of all stages.

    Attributes
    ----------
    source
        The frames (``imaging.frames.FrameSource``), None where tracks were given.
    corners
        None where tracks were given.
    tracks, hypotheses, segmentation
        The documents of the stages.
    timings
        Seconds and peak memory of the stages.
    """

    source: Any
    corners: CornersDocument | None
    tracks: TracksDocument
    hypotheses: HypothesesDocument
    segmentation: SegmentationDocument
    timings: Timings

    @property
    def points(self) -> Floats:
        """The tracks [P, F, 2] in pixels, NaN where a point is not visible."""
        return self.tracks.tracks.points

    @property
    def labels(self) -> Integers:
        """One label per track [P]: 1, 2, ... motion, 0 outlier, -1 background, -2 not judged."""
        return self.segmentation.labels

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The motions, label 1 first."""
        return tuple(self.segmentation.motions)


def run(
    configuration: Configuration,
    tracks: TracksDocument | None = None,
    source: FrameSource | None = None,
    threads: int = 1,
    on_stage: Callable[[str, Document | None, Timings], None] = lambda name, document, timings: (
        None
    ),
) -> Outcome:
    """Run all stages in memory.

    Parameters
    ----------
    configuration : Configuration
        The settings.
    tracks : TracksDocument, optional
        Tracks to segment; by default they are detected in images.
    source : FrameSource, optional
        The frames; by default those of ``input.images``.
    threads : int
        Number of threads of mean shift.
    on_stage : callable
        Called with (name, None, timings) before a stage and (name, document, timings) after it.

    Returns
    -------
    Outcome

    Raises
    ------
    DataError, ConfigurationError, UsageError
        Like the stages.
    """
    timings = Timings()
    corners: CornersDocument | None = None

    def timed(name: str, stage: Callable[[], Any]) -> Any:
        on_stage(name, None, timings)
        with timings.stage(name):
            document = stage()
        on_stage(name, document, timings)
        return document

    if tracks is None:
        with timings.stage("read"):
            source = source or open_input(configuration)
        opened = source
        check_settings(configuration, len(source), threads)
        camera_for(list(source.frames), configuration)  # before the work starts
        corners = timed("detect", lambda: detect(configuration, opened))
        found = corners
        tracks = timed("match", lambda: match(found, configuration, opened))
    else:
        check_settings(configuration, len(tracks.frames), threads)
    given = tracks
    hypotheses = timed("hypothesize", lambda: hypothesize(given, configuration))
    segmentation = timed("cluster", lambda: cluster(hypotheses, configuration, threads))
    return Outcome(source, corners, tracks, hypotheses, segmentation, timings)
