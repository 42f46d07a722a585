"""Stage 3: hypotheses on the manifold of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from mssegment.blas import with_one_thread
from mssegment.configuration import Configuration
from mssegment.documents import HypothesesDocument, TracksDocument
from mssegment.history import entry_of
from mssegment.pipeline.settings import (
    camera_for,
    frame_size,
    random_stream,
    sampling_of,
    straight,
)
from mssegment.records import OUTLIER, Camera, Floats, Hypotheses

if TYPE_CHECKING:
    from mssegment.preprocessing.background import Background

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
    from mssegment.stage_checks import check_kind

    frames = len(document.frames)
    check_kind(document.of_pictures, sampling_of(configuration, frames)[0].models(frames))
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
        frame_size=frame_size(document.frames),
        remove=configuration.background.remove,
        min_displacement=configuration.background.min_displacement,
        earlier=earlier_background,
    )
    drawn, notes = _drawn(points, background, camera, configuration)
    return HypothesesDocument(
        frames=document.frames,
        camera=camera,
        tracks=document.tracks,
        status=background.status,
        strategy=drawn.strategy,
        partition=drawn.partition,
        log_nfa=drawn.log_nfa,
        sets=list(drawn.sets),
        history=[
            *document.history,
            entry_of("hypothesize", configuration, (*camera_notes, *background.notes, *notes)),
        ],
    )


def _drawn(
    points: Floats, background: Background, camera: Camera | None, configuration: Configuration
) -> tuple[Hypotheses, tuple[str, ...]]:
    """The hypotheses of what moves, and notes where there are none."""
    from mssegment.sampling.strategy import check_sampling, draw
    from mssegment.stage_checks import nothing_moves

    frames = points.shape[1]
    options, strategy = sampling_of(configuration, frames)
    check_sampling(options, strategy, frames)
    moves = background.status == OUTLIER
    if nothing_moves(background.status, options.models(frames)):
        note = (
            f"tracks that move: {int(moves.sum())} of {len(points)}, too few for a motion; there "
            "are no motions to find"
        )
        return Hypotheses(strategy, ()), (note,)
    drawn = draw(
        points,
        strategy,
        options,
        eligible=moves,
        static=background.found,
        camera=camera,
        rng=random_stream("hypothesize", configuration),
    )
    return drawn, () if drawn.sets else (NO_COMMON_MOTION,)


def _hypothesize_data(document: TracksDocument, configuration: Configuration) -> HypothesesDocument:
    """``hypothesize`` for data that is no picture, which has no background and no camera."""
    from mssegment.sampling.strategy import check_sampling, draw

    points = document.tracks.points
    options, strategy = sampling_of(configuration, len(document.frames))
    check_sampling(options, strategy, len(document.frames))
    status = np.zeros(len(points), dtype=np.int64)
    rng = random_stream("hypothesize", configuration)
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
