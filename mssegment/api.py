"""The way in from Python: pictures or tracks go in, motions come out, no file in between."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment import pipeline
from mssegment.configuration import Configuration, Setting, from_mapping, resolve
from mssegment.datasets.base import check_points, size_that_holds
from mssegment.documents import TracksDocument
from mssegment.errors import UsageError
from mssegment.pipeline import Result
from mssegment.records import Camera, Frame, Tracks

Picture = str | os.PathLike[str] | npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
"""A file, a folder, a glob, a video; or an array [height, width], or with red first [h, w, 3]."""
Settings = Mapping[str, Any]
"""Values by dotted key, as in ``{"hypothesize.model": "homography", "segment.motions": 2}``."""


def segment_pictures(
    pictures: Picture | Sequence[Picture],
    settings: Settings | None = None,
    *,
    camera: Camera | None = None,
    threads: int = 1,
) -> Result:
    """Finds the motions between the ``pictures``, two views or the frames of a sequence.

    They are files, folders, globs or videos, or else arrays of one size. ``settings`` are those of
    the configuration; the environment is not looked at. ``camera`` is what ``translation`` needs.

    The result has the matches ``points`` [P, F, 2] in pixels, ``labels`` [P] (1, 2, ... motions, 0
    outliers, -1 background, -2 not judged) and ``motions``, beside the documents of all stages.
    Raises ConfigurationError for a wrong setting, UsageError for arrays that are no pictures,
    DataError for files that are none, or that show too little.
    """
    given = _listed(pictures)
    arrays = [picture for picture in given if isinstance(picture, np.ndarray)]
    if not arrays:
        names = [os.fspath(p) for p in given if not isinstance(p, np.ndarray)]
        images = [Setting("input.images", names, "pictures")]
        return pipeline.run(_configuration(settings, camera, images), threads=threads)
    if len(arrays) < len(given):
        raise UsageError("pictures: files and arrays together; give either")
    if len(arrays) < 2:
        raise UsageError(f"pictures: {len(arrays)} of them, two or more were expected")
    from mssegment.imaging.frames import frames_in_memory

    frames = [_frame(index, array) for index, array in enumerate(arrays)]
    pixels = [a if a.ndim == 2 else np.ascontiguousarray(a[..., ::-1]) for a in arrays]
    source = frames_in_memory(frames, pixels)
    return pipeline.run(_configuration(settings, camera), source=source, threads=threads)


def segment_tracks(
    points: npt.ArrayLike,
    settings: Settings | None = None,
    *,
    frame_size: tuple[int, int] | None = None,
    camera: Camera | None = None,
    threads: int = 1,
) -> Result:
    """Finds the motions among tracks of your own, ``points`` [P, F, 2] in pixels.

    A track is NaN where it is not seen. ``frame_size`` is (width, height), by default the smallest
    that holds every point. Else as ``segment_pictures``.
    """
    places = np.asarray(points, dtype=np.float64)
    if places.ndim != 3 or places.shape[2] != 2:
        raise UsageError(f"points: shape {places.shape}, [tracks, frames, 2] was expected")
    check_points(places, "points")
    width, height = frame_size or size_that_holds(places)
    frames = [Frame("", width, height, index=index) for index in range(places.shape[1])]
    tracks = TracksDocument(frames=frames, tracks=Tracks(places))
    return pipeline.run(_configuration(settings, camera), tracks, threads=threads)


def _configuration(
    settings: Settings | None, camera: Camera | None, more: Sequence[Setting] = ()
) -> Configuration:
    given = from_mapping(settings or {}, "settings")
    if camera is not None:
        for name in ("fx", "fy", "cx", "cy", "distortion"):
            given.append(Setting(f"camera.{name}", getattr(camera, name), "camera"))
    return resolve([*given, *more])


def _listed(pictures: Picture | Sequence[Picture]) -> list[Picture]:
    if isinstance(pictures, str | os.PathLike | np.ndarray):
        return list(pictures) if isinstance(pictures, np.ndarray) else [pictures]
    return list(pictures)


def _frame(index: int, picture: npt.NDArray[Any]) -> Frame:
    shape, kind = picture.shape, picture.dtype
    colours = shape[2:] in ((), (3,))
    if len(shape) not in (2, 3) or not colours or 0 in shape or kind not in (np.uint8, np.uint16):
        raise UsageError(
            f"pictures[{index}]: {kind} of shape {shape}, uint8 or uint16 of "
            "[height, width] or [height, width, 3] was expected"
        )
    return Frame(f"pictures[{index}]", shape[1], shape[0])
