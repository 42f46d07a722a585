"""mssegment: the independently moving things in an image pair or an image sequence.

Motion hypotheses are points on a manifold; mean shift finds the modes of their density; each
dominant mode is a motion and its inliers are its segment (Subbarao & Meer, "Nonlinear Mean Shift
for Clustering over Analytic Manifolds", CVPR 2006).

Start with :func:`segment_pictures` for images and videos, :func:`segment_tracks` for tracks of your
own, :class:`MultiModel` for lines, planes and other structures in data that is no picture,
:class:`MeanShift` for points on a manifold (``mssegment.manifolds``).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from mssegment.version import __version__ as __version__

if TYPE_CHECKING:
    from mssegment.api import segment_pictures as segment_pictures
    from mssegment.api import segment_tracks as segment_tracks
    from mssegment.errors import ConfigurationError as ConfigurationError
    from mssegment.errors import DataError as DataError
    from mssegment.errors import MssegmentError as MssegmentError
    from mssegment.errors import UsageError as UsageError
    from mssegment.meanshift import MeanShift as MeanShift
    from mssegment.meanshift import fuse as fuse
    from mssegment.multi_model import MultiModel as MultiModel
    from mssegment.records import Camera as Camera
    from mssegment.records import Frame as Frame
    from mssegment.records import Mode as Mode
    from mssegment.records import Motion as Motion
    from mssegment.result import Segmentation as Segmentation

_MODULES = {
    "Camera": "records",
    "ConfigurationError": "errors",
    "DataError": "errors",
    "Frame": "records",
    "MeanShift": "meanshift",
    "Mode": "records",
    "Motion": "records",
    "MssegmentError": "errors",
    "MultiModel": "multi_model",
    "Segmentation": "result",
    "UsageError": "errors",
    "fuse": "meanshift",
    "segment_pictures": "api",
    "segment_tracks": "api",
}
"""Where each public name is defined; nothing is imported before it is asked for."""

__all__ = ["__version__", *_MODULES]


def __getattr__(name: str) -> Any:
    """Import a public name when it is used: the command line starts without most of them."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, also those that are not imported yet."""
    return sorted({*globals(), *__all__})
