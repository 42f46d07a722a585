"""The stages, each from one document to the next, and ``run``, all of them in memory.

A stage reads the document of the previous one and the configuration. Nothing here depends on the
command line or prints. Every stage that uses random numbers has its own stream, so that ``run`` and
a chain of single commands have the same result.
"""

from mssegment.pipeline.hypotheses import NO_COMMON_MOTION, NO_STRUCTURE, hypothesize
from mssegment.pipeline.inputs import (
    document_of,
    import_points,
    import_tracks,
    in_pixels,
    open_input,
    put_on_pictures,
    read_tracks,
    sizes_of,
)
from mssegment.pipeline.matches import detect, match
from mssegment.pipeline.motions import cluster
from mssegment.pipeline.settings import camera_for, check_settings, straight
from mssegment.pipeline.whole import Outcome, run

__all__ = [
    "NO_COMMON_MOTION",
    "NO_STRUCTURE",
    "Outcome",
    "camera_for",
    "check_settings",
    "cluster",
    "detect",
    "document_of",
    "hypothesize",
    "import_points",
    "import_tracks",
    "in_pixels",
    "match",
    "open_input",
    "put_on_pictures",
    "read_tracks",
    "run",
    "sizes_of",
    "straight",
]
