"""Stages 1 and 2: corners, and the tracks that matching makes of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from mssegment.blas import with_one_thread
from mssegment.configuration import Configuration
from mssegment.documents import CornersDocument, TracksDocument
from mssegment.history import entry_of
from mssegment.pipeline.settings import unless_auto

if TYPE_CHECKING:
    from mssegment.imaging.frames import FrameSource


@with_one_thread
def detect(configuration: Configuration, source: FrameSource) -> CornersDocument:
    """Stage 1: detect corners in every frame."""
    from mssegment.imaging.corners import QUALITY, detect_all

    settings = configuration.detect
    corners = detect_all(
        source.greys(),
        source.frames,
        levels=unless_auto(settings.levels),
        limit=unless_auto(settings.max_corners),
        distance=unless_auto(settings.min_distance),
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
