"""The stages, each from one document to the next, and ``run``, all of them in memory.

A stage reads the document of the previous one and the configuration. Nothing here depends on the
command line or prints. Every stage that uses random numbers has its own stream, so that ``run`` and
a chain of single commands have the same result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import numpy.typing as npt

from mssegment.blas import with_one_thread
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
from mssegment.documents.checks import check_camera
from mssegment.errors import ConfigurationError
from mssegment.history import entry_of
from mssegment.records import (
    OUTLIER,
    Camera,
    ClusterResult,
    Floats,
    Frame,
    Hypotheses,
    Integers,
    Motion,
    Record,
    Strategy,
    replace,
)
from mssegment.resources import Timings

if TYPE_CHECKING:
    from mssegment.imaging.frames import FrameSource
    from mssegment.sampling.options import SamplingOptions
    from mssegment.segmentation.options import SegmentOptions

NO_COMMON_MOTION = (
    "no hypothesis is supported by further tracks: the matches have no common motion; check the "
    "matches, or choose another model"
)
"""Note of ``hypothesize`` on tracks that are all mismatches, or do not fit the model."""
NO_STRUCTURE = (
    "no structure: no hypothesis has more inliers than chance explains; check the data, or choose "
    "another model"
)
"""Note of ``hypothesize`` on data in which nothing stands out."""
_STREAMS = {"match": 1, "hypothesize": 2, "cluster": 3}


def _random(stage: str, configuration: Configuration) -> np.random.Generator:
    return np.random.default_rng([configuration.seed, _STREAMS[stage]])


def open_input(configuration: Configuration) -> FrameSource:
    """Open the frames of ``input.*``; raises DataError like ``imaging.frames.open_frames``."""
    from mssegment.imaging.frames import open_frames

    read = configuration.input
    return open_frames(read.images, read.start, read.stop, read.step)


def import_tracks(path: str) -> TracksDocument:
    """Read tracks that another program wrote.

    Parameters
    ----------
    path : str
        A file of a format in ``datasets``, or ``-`` for standard input.

    Returns
    -------
    TracksDocument

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    from mssegment.datasets import read, read_content

    found = read_content(read_bytes(path), "standard input") if path == STANDARD else read(path)
    return TracksDocument(
        frames=list(found.frames),
        camera=found.camera,
        tracks=replace(found.tracks, ids=found.ids),
        history=[entry_of("import", notes=found.notes)],
    )


def import_points(path: str) -> TracksDocument:
    """Read data that is no picture: a table, a point cloud, matched 3-D points.

    Parameters
    ----------
    path : str
        A table, a NumPy file, PLY, PCD or XYZ; or ``-`` for standard input.

    Returns
    -------
    TracksDocument
        With frames that have no size.

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    from mssegment.datasets.containers import InputFile
    from mssegment.datasets.points import read_points

    file = (
        InputFile("standard input", read_bytes(path))
        if path == STANDARD
        else InputFile.opened(path)
    )
    found = read_points(file)
    return TracksDocument(
        frames=list(found.frames),
        tracks=replace(found.tracks, ids=found.ids),
        history=[entry_of("import", notes=found.notes)],
    )


def put_on_pictures(document: TracksDocument, source: FrameSource) -> TracksDocument:
    """The document with the pictures that its tracks were made from as its frames.

    Raises DataError if a frame has no picture, or most positions lie outside the pictures.
    """
    from mssegment.imaging.backdrop import check_inside, pictures_of_frames

    frames = pictures_of_frames(document.frames, source.frames)
    notes = check_inside(document.tracks.points, frames)
    history = list(document.history)
    if notes:
        last = history[-1]
        history[-1] = msgspec.structs.replace(last, notes=(*last.notes, *notes))
    return msgspec.structs.replace(document, frames=frames, history=history)


@with_one_thread
def detect(configuration: Configuration, source: FrameSource) -> CornersDocument:
    """Stage 1: detect corners in every frame."""
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
        frames=list(source.frames),
        corners=corners,
        history=[entry_of("detect", configuration, source.notes)],
    )


@with_one_thread
def match(
    document: CornersDocument, configuration: Configuration, source: FrameSource | None = None
) -> TracksDocument:
    """Stage 2: match corners to tracks.

    Parameters
    ----------
    document : CornersDocument
        The corners.
    configuration : Configuration
        The settings.
    source : FrameSource, optional
        The frames; by default they are opened again.

    Returns
    -------
    TracksDocument

    Raises
    ------
    ConfigurationError
        If a setting does not apply to the matcher.
    DataError
        If the frames cannot be read.
    """
    from mssegment.imaging.frames import reopen_frames
    from mssegment.imaging.matching import match as match_corners

    settings = msgspec.structs.asdict(configuration.match)
    method = settings.pop("method")
    options = {name: value for name, value in settings.items() if value != "auto"}
    source = source or reopen_frames(document.frames)
    tracks = match_corners(source.greys(), document.corners, method, **options)
    return TracksDocument(
        frames=document.frames,
        camera=document.camera,
        tracks=tracks,
        history=[*document.history, entry_of("match", configuration)],
    )


@with_one_thread
def hypothesize(
    document: TracksDocument,
    configuration: Configuration,
    earlier_background: npt.NDArray[np.bool_] | None = None,
) -> HypothesesDocument:
    """Stage 3: remove the background, and sample hypotheses on the manifold of the model.

    Parameters
    ----------
    document : TracksDocument
        The tracks.
    configuration : Configuration
        The settings.
    earlier_background : ndarray [P] of bool, optional
        Tracks that were background in the frames before, where this is a window of a sequence.

    Returns
    -------
    HypothesesDocument

    Raises
    ------
    DataError
        If no hypothesis can be computed from the tracks.
    ConfigurationError
        If a setting is not used by the strategy or the model.
    """
    from mssegment.preprocessing.background import find_background
    from mssegment.sampling.strategy import check_sampling, draw
    from mssegment.stage_checks import check_kind, nothing_moves

    frames = len(document.frames)
    check_kind(document.of_pictures, _sampling(configuration, frames)[0].models(frames))
    if not document.of_pictures:
        return _hypothesize_data(document, configuration)
    camera, camera_notes = camera_for(
        document.frames,
        configuration,
        document.camera,
        are_pictures=any(entry.stage == "detect" for entry in document.history),
    )
    points = straight(document.tracks.points, camera)
    background = find_background(
        points,
        frame_size=_size(document.frames),
        remove=configuration.background.remove,
        min_displacement=configuration.background.min_displacement,
        earlier=earlier_background,
    )
    notes, frames = (*camera_notes, *background.notes), points.shape[1]
    options, strategy = _sampling(configuration, frames)
    check_sampling(options, strategy, frames)
    if nothing_moves(background.status, options.models(frames)):
        drawn = Hypotheses(strategy, ())
        moving = int((background.status == OUTLIER).sum())
        notes = (
            *notes,
            f"tracks that move: {moving} of {len(points)}, too few for a motion; there are no "
            "motions to find",
        )
    else:
        drawn = draw(
            points,
            strategy,
            options,
            eligible=background.status == OUTLIER,
            static=background.found,
            camera=camera,
            rng=_random("hypothesize", configuration),
        )
        if not drawn.sets:
            notes = (*notes, NO_COMMON_MOTION)
    return HypothesesDocument(
        frames=document.frames,
        camera=camera,
        tracks=document.tracks,
        status=background.status,
        strategy=drawn.strategy,
        partition=drawn.partition,
        log_nfa=drawn.log_nfa,
        sets=list(drawn.sets),
        history=[*document.history, entry_of("hypothesize", configuration, notes)],
    )


def _hypothesize_data(document: TracksDocument, configuration: Configuration) -> HypothesesDocument:
    """``hypothesize`` for data that is no picture, which has no background and no camera."""
    from mssegment.sampling.strategy import check_sampling, draw

    points = document.tracks.points
    options, strategy = _sampling(configuration, len(document.frames))
    check_sampling(options, strategy, len(document.frames))
    status = np.zeros(len(points), dtype=np.int64)
    rng = _random("hypothesize", configuration)
    drawn = draw(points, strategy, options, eligible=status == OUTLIER, static=False, rng=rng)
    return HypothesesDocument(
        frames=document.frames,
        tracks=document.tracks,
        status=status,
        strategy=strategy,
        sets=list(drawn.sets),
        history=[
            *document.history,
            entry_of("hypothesize", configuration, () if drawn.sets else (NO_STRUCTURE,)),
        ],
    )


@with_one_thread
def cluster(
    document: HypothesesDocument,
    configuration: Configuration,
    threads: int = 1,
    with_modes: bool = True,
) -> SegmentationDocument:
    """Stage 4: find modes, motions and labels, with the strategy of the document.

    Parameters
    ----------
    document : HypothesesDocument
        The tracks and their hypotheses.
    configuration : Configuration
        The settings.
    threads : int
        Number of threads of mean shift.
    with_modes : bool
        Whether consensus looks for the mode of each motion, on which its labels do not depend.

    Returns
    -------
    SegmentationDocument

    Raises
    ------
    DataError
        If the hypotheses do not fit the tracks.
    ConfigurationError, UsageError
        If a setting contradicts the strategy, or is not used by it.
    """
    from mssegment.segmentation import cluster as segment
    from mssegment.stage_checks import (
        check_method,
        check_selection,
        check_sets,
        no_motion,
        nothing_moves,
    )

    names = _sampling(configuration, len(document.frames))[0].models(len(document.frames))
    check_method(configuration.cluster.method, document.strategy)
    if not document.of_pictures:
        check_selection(configuration.segment.selection)
    moving = not document.of_pictures or not nothing_moves(document.status, names)
    if not document.sets or not moving:
        return _segmentation(document, no_motion(document.status), configuration)
    if not (document.status == OUTLIER).any():
        note = "no track is left to segment: all are background or not judged (status)"
        found = replace(no_motion(document.status), notes=(note,))
        return _segmentation(document, found, configuration)
    check_sets(document.sets)
    found = segment(
        straight(document.tracks.points, document.camera),
        document.hypotheses,
        status=document.status,
        options=_segment_options(configuration, threads),
        rng=_random("cluster", configuration),
        with_modes=with_modes,
    )
    return _segmentation(document, _with_camera(found, document, configuration), configuration)


def _with_camera(
    found: ClusterResult, document: HypothesesDocument, configuration: Configuration
) -> ClusterResult:
    """The result with the motion of the static world named, and a note that says so."""
    settings = configuration.segment
    # where each plane is a motion of its own, the static world has many
    if not document.of_pictures or not settings.camera_motion or settings.granularity == "surface":
        return found
    from mssegment.segmentation.camera_motion import find_camera_motion

    label = find_camera_motion(document.tracks.points, found.labels, document.frames)
    if label is None:
        return found
    note = f"motion {label} is that of the static world, seen by the moving camera"
    return replace(found, camera_motion=label, notes=(*found.notes, note))


def camera_for(
    frames: list[Frame],
    configuration: Configuration,
    earlier: Camera | None = None,
    *,
    are_pictures: bool = True,
) -> tuple[Camera | None, tuple[str, ...]]:
    """The camera of the configuration, checked against the frames, and notes on it.

    Parameters
    ----------
    frames : list of Frame
        The frames.
    configuration : Configuration
        Its camera has precedence.
    earlier : Camera, optional
        The camera of an earlier stage or of an imported file.
    are_pictures : bool
        Whether the size of the frames is that of pictures, and not only what holds the tracks.

    Returns
    -------
    camera : Camera or None
    notes : tuple of str

    Raises
    ------
    ConfigurationError
        If the camera file cannot be read, or the camera cannot be that of the frames.
    """
    from mssegment.models import MODELS

    camera = camera_of(configuration.camera)
    if camera is None:
        return earlier, ()
    try:
        check_camera(camera)
    except ValueError as error:
        raise ConfigurationError(str(error)) from None
    notes: tuple[str, ...] = ()
    if frames and are_pictures:
        from mssegment.cameras import fitted

        camera, notes = fitted(camera, *_size(frames))
    names = _sampling(configuration, len(frames))[0].models(len(frames), calibrated=True)
    if not any(camera.distortion) and not any(MODELS[name].needs_camera for name in names):
        own = " and ".join(dict.fromkeys(names))
        needing = " or ".join(name for name, model in MODELS.items() if model.needs_camera)
        notes += (f"the camera is not used: {own} needs none; model {needing} does",)
    return camera, notes


def check_settings(configuration: Configuration, frames: int, threads: int = 1) -> None:
    """Raise an error for a setting that the strategy for this number of frames does not use."""
    from mssegment.sampling.strategy import check_sampling
    from mssegment.segmentation.options import check_options

    options, strategy = _sampling(configuration, frames)
    check_sampling(options, strategy, frames)
    check_options(_segment_options(configuration, threads), strategy)


def _sampling(configuration: Configuration, frames: int) -> tuple[SamplingOptions, Strategy]:
    """Sampling options, and the strategy, for tracks over this number of frames."""
    from mssegment.sampling.options import SamplingOptions
    from mssegment.sampling.strategy import choose_strategy

    settings = configuration.hypothesize
    options = SamplingOptions(
        settings.model,
        settings.rank,
        settings.count,
        settings.sampling,
        configuration.camera.derotate,
    )
    method, selection = configuration.cluster.method, configuration.segment.selection
    return options, choose_strategy(method, selection, options.models(frames), frames)


def _segment_options(configuration: Configuration, threads: int) -> SegmentOptions:
    """The options of ``cluster`` from the configuration."""
    from mssegment.segmentation.options import SegmentOptions

    shift, settings = configuration.cluster, configuration.segment
    return SegmentOptions(
        bandwidth=shift.bandwidth,
        kernel=shift.kernel,
        selection=settings.selection,
        motions=_given(settings.motions),
        min_motions=settings.min_motions,
        granularity=settings.granularity,
        threads=threads,
    )


def _segmentation(
    document: HypothesesDocument, found: ClusterResult, configuration: Configuration
) -> SegmentationDocument:
    return SegmentationDocument(
        frames=document.frames,
        camera=document.camera,
        strategy=document.strategy,
        labels=found.labels,
        motions=found.motions,
        modes=found.modes,
        bandwidths=found.bandwidths,
        notes=found.notes,
        residuals=found.residuals,
        assignments=found.assignments,
        camera_motion=found.camera_motion,
        tracks=document.tracks,
        sets=document.sets,
        history=[*document.history, entry_of("cluster", configuration, found.notes)],
    )


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


def straight(points: Floats, camera: Camera | None) -> Floats:
    """Remove lens distortion from points, if the camera has any."""
    if camera is None or not camera.distortion:
        return points
    from mssegment.imaging.camera import undistort_points

    return undistort_points(points, camera)


def _given(value: Any) -> Any:
    return None if value == "auto" else value


def _size(frames: list[Frame]) -> tuple[int, int]:
    return (frames[0].width, frames[0].height) if frames else (0, 0)
