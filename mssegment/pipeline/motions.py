"""Stage 4: modes, motions and labels."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.blas import with_one_thread
from mssegment.configuration import Configuration
from mssegment.documents import HypothesesDocument, SegmentationDocument
from mssegment.history import entry_of
from mssegment.pipeline.settings import (
    random_stream,
    sampling_of,
    segment_options_of,
    straight,
)
from mssegment.records import OUTLIER, ClusterResult, replace


@with_one_thread
def cluster(
    document: HypothesesDocument,
    configuration: Configuration,
    threads: int = 1,
    with_modes: bool = True,
    moved_before: npt.NDArray[np.bool_] | None = None,
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
    moved_before : ndarray [P] of bool, optional
        Tracks that moved with a motion in the frames before, where this is a window of a sequence:
        consensus does not test whether a motion that goes on is one.

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

    names = sampling_of(configuration, len(document.frames))[0].models(len(document.frames))
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
        options=segment_options_of(configuration, threads),
        rng=random_stream("cluster", configuration),
        with_modes=with_modes,
        moved_before=moved_before,
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
