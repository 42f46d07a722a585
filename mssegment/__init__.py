"""mssegment: the independently moving things in an image pair or an image sequence.

Motion hypotheses are points on a manifold; mean shift finds the modes of their density; each
dominant mode is a motion and its inliers are its segment (Subbarao & Meer, "Nonlinear Mean Shift
for Clustering over Analytic Manifolds", CVPR 2006).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mssegment.version import __version__

if TYPE_CHECKING:
    from mssegment.api import segment_pictures, segment_tracks
    from mssegment.records import Camera

__all__ = ["Camera", "__version__", "segment_pictures", "segment_tracks"]


def __getattr__(name: str) -> Any:
    """Loads the library when it is asked for: the command line starts without it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from mssegment import api

    return getattr(api, name)
