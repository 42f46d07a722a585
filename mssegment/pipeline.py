"""The stages, each from one document to the next, and ``run``, all of them in memory.

A stage takes the document before it and the configuration; nothing here knows of the command
line or prints. Every stage that draws random numbers has a stream of its own, so that ``run`` and
a chain of single commands give the same result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from mssegment.configuration import Configuration, camera_of
from mssegment.documents import (
    STANDARD,
    CornersDocument,
    Document,
    HypothesesDocument,
    SegmentationDocument,
    TracksDocument,
    read_bytes,
)
from mssegment.errors import ConfigurationError
from mssegment.history import entry_of
from mssegment.records import (
    Camera,
    Floats,
    Frame,
    HypothesisSet,
    Integers,
    Motion,
    Record,
    Segmentation,
)
from mssegment.resources import Timings, keep_freed_memory

if TYPE_CHECKING:
    from mssegment.imaging.frames import FrameSource
    from mssegment.preprocessing.background import Background

NOTHING_SHARED = (
    "no hypothesis is confirmed by further tracks: the matches share no motion; check the matches, "
    "or choose another model"
)
"""What hypothesize says of tracks that are only mismatches, or not of the model asked for."""
_STREAMS = {"match": 1, "hypothesize": 2, "cluster": 3}


keep_freed_memory()


def _random(stage: str, configuration: Configuration) -> np.random.Generator:
    return np.random.default_rng([configuration.seed, _STREAMS[stage]])


def open_input(configuration: Configuration) -> FrameSource:
    """The frames that ``input.*`` names; raises DataError as ``imaging.frames.open_frames``."""
    from mssegment.imaging.frames import open_frames

    read = configuration.input
    return open_frames(read.images, read.start, read.stop, read.step)


def import_tracks(path: str) -> TracksDocument:
    """Tracks that another program wrote (``datasets``), ``-``: a CSV; raises DataError."""
    from mssegment.datasets import read, read_content

    found = read_content(read_bytes(path), "standard input") if path == STANDARD else read(path)
    return TracksDocument(
        frames=list(found.frames),
        camera=found.camera,
        tracks=found.tracks,
        history=[entry_of("import")],
    )


def detect(configuration: Configuration, source: FrameSource) -> CornersDocument:
    """Stage 1: the corners of every frame."""
    from mssegment.imaging.corners import QUALITY, detect_all

    settings = configuration.detect
    corners = detect_all(
        source.greys(),
        source.frames,
        levels=_given(settings.levels),
        limit=_given(settings.max_corners),
        distance=_given(settings.min_distance),
        quality=QUALITY if settings.quality == "auto" else settings.quality,
    )
    return CornersDocument(
        frames=list(source.frames), corners=corners, history=[entry_of("detect", configuration)]
    )


def match(
    document: CornersDocument, configuration: Configuration, source: FrameSource | None = None
) -> TracksDocument:
    """Stage 2: corners become tracks. Without ``source`` the pictures are opened again."""
    from mssegment.imaging.frames import reopen_frames
    from mssegment.imaging.matching import default_matcher
    from mssegment.imaging.matching import match as match_corners

    settings = configuration.match
    source = source or reopen_frames(document.frames)
    method = default_matcher(len(source)) if settings.method == "auto" else settings.method
    options: dict[str, Any] = {}
    if settings.min_length != "auto":
        if method != "flow":
            raise ConfigurationError(
                f"match.min_length is for match.method flow, the method here is {method}; "
                "leave it at auto"
            )
        options["min_length"] = settings.min_length
    tracks = match_corners(source.greys(), document.corners, method, **options)
    return TracksDocument(
        frames=document.frames,
        camera=document.camera,
        tracks=tracks,
        history=[*document.history, entry_of("match", configuration)],
    )


def hypothesize(document: TracksDocument, configuration: Configuration) -> HypothesesDocument:
    """Stage 3: background, elemental subsets, and hypotheses on the manifold of the model."""
    from mssegment.preprocessing.background import find_background
    from mssegment.stage_checks import nothing_moves

    camera = camera_of(configuration.camera) or document.camera
    points = straight(document.tracks.points, camera)
    background = find_background(
        points,
        frame_size=_size(document.frames),
        remove=configuration.background.remove,
        min_displacement=configuration.background.min_displacement,
    )
    notes = background.notes
    if nothing_moves(background.status, _model(configuration, points.shape[1])):
        sets: list[HypothesisSet] = []
        notes = (*notes, "nothing else moves: there is no motion to look for")
    else:
        sets = _draw_sets(points, camera, background, configuration)
        if not sets:
            notes = (*notes, NOTHING_SHARED)
    return HypothesesDocument(
        frames=document.frames,
        camera=camera,
        tracks=document.tracks,
        status=background.status,
        sets=sets,
        history=[*document.history, entry_of("hypothesize", configuration, notes)],
    )


def _draw_sets(
    points: Floats, camera: Camera | None, background: Background, configuration: Configuration
) -> list[HypothesisSet]:
    """The sets of hypotheses that the model, the number of frames and the method ask for."""
    from mssegment.sampling.strategy import AUTO_FRAMES, uses_consensus

    settings, frames = configuration.hypothesize, points.shape[1]
    eligible = background.status == 0
    rng = _random("hypothesize", configuration)
    model = _model(configuration, frames)
    if uses_consensus(configuration.cluster.method, model, frames):
        from mssegment.sampling.frame_pairs import draw_consensus_sets

        return draw_consensus_sets(
            points, rng, eligible=eligible, static=background.found, rank=settings.rank
        )
    if model == "factorization" and frames >= AUTO_FRAMES:
        from mssegment.sampling.pooled_ranks import draw_pooled_sets

        return draw_pooled_sets(
            points,
            count=settings.count,
            sampling=settings.sampling,
            eligible=eligible,
            rank=settings.rank,
            rng=rng,
        )
    from mssegment.sampling.elemental_subsets import hypothesize as draw

    derotate = configuration.camera.derotate
    if derotate == "auto" and background.found:
        derotate = False  # a camera that stands still does not turn
    return draw(
        points,
        model=model,
        camera=camera,
        count=settings.count,
        sampling=settings.sampling,
        eligible=eligible,
        rank=3 if settings.rank == "auto" else settings.rank,
        derotate=derotate,
        rng=rng,
    )


def cluster(
    document: HypothesesDocument, configuration: Configuration, threads: int = 1
) -> SegmentationDocument:
    """Stage 4: modes, motions, labels."""
    from mssegment.segmentation import cluster as segment
    from mssegment.stage_checks import check_sets, no_motion, nothing_moves

    model = _model(configuration, len(document.frames))
    if not document.sets or nothing_moves(document.status, model):
        return _segmentation(document, no_motion(document.status), configuration)
    check_sets(document.sets)
    found = segment(
        straight(document.tracks.points, document.camera),
        document.sets,
        status=document.status,
        bandwidth=configuration.cluster.bandwidth,
        kernel=configuration.cluster.kernel,
        method=configuration.cluster.method,
        selection=configuration.segment.selection,
        motions=configuration.segment.motions,
        min_motions=configuration.segment.min_motions,
        granularity=configuration.segment.granularity,
        rng=_random("cluster", configuration),
        threads=threads,
    )
    return _segmentation(document, found, configuration)


def _segmentation(
    document: HypothesesDocument, found: Segmentation, configuration: Configuration
) -> SegmentationDocument:
    return SegmentationDocument(
        frames=document.frames,
        camera=document.camera,
        labels=found.labels,
        motions=found.motions,
        modes=found.modes,
        bandwidths=found.bandwidths,
        notes=found.notes,
        residuals=found.residuals,
        assignments=found.assignments,
        tracks=document.tracks,
        sets=document.sets,
        history=[*document.history, entry_of("cluster", configuration, found.notes)],
    )


class Result(Record, frozen=True):
    """All documents of one run; ``corners`` is None where tracks were given."""

    source: FrameSource | None
    corners: CornersDocument | None
    tracks: TracksDocument
    hypotheses: HypothesesDocument
    segmentation: SegmentationDocument
    timings: Timings

    @property
    def points(self) -> Floats:
        """The tracks [P, F, 2], pixels, NaN where not seen."""
        return self.tracks.tracks.points

    @property
    def labels(self) -> Integers:
        """The label of each track [P]: a motion 1, 2, ..., or one of those in ``records``."""
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
) -> Result:
    """All stages in memory, from ``tracks``, from pictures in ``source``, or ``input.images``.

    ``on_stage(name, None, ...)`` is called before a stage, ``on_stage(name, document, ...)`` after
    it. Raises DataError as the stages do.
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
        corners = timed("detect", lambda: detect(configuration, opened))
        found = corners
        tracks = timed("match", lambda: match(found, configuration, opened))
    given = tracks
    hypotheses = timed("hypothesize", lambda: hypothesize(given, configuration))
    segmentation = timed("cluster", lambda: cluster(hypotheses, configuration, threads))
    return Result(source, corners, tracks, hypotheses, segmentation, timings)


def straight(points: Floats, camera: Camera | None) -> Floats:
    """The points without lens distortion, which comes before anything else."""
    if camera is None or not camera.distortion:
        return points
    from mssegment.imaging.camera import undistort_points

    return undistort_points(points, camera)


def _model(configuration: Configuration, frames: int) -> str:
    """The model: ``auto`` is a choice among planar motions for two frames, else factorization."""
    model = configuration.hypothesize.model
    return "factorization" if model == "auto" and frames > 2 else model


def _given(value: Any) -> Any:
    return None if value == "auto" else value


def _size(frames: list[Frame]) -> tuple[int, int]:
    return (frames[0].width, frames[0].height) if frames else (0, 0)
