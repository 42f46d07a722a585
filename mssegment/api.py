"""The Python interface: images or tracks in, motions out, without files in between."""

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
from mssegment.pipeline import Segmentation
from mssegment.records import Camera, Frame, Tracks

Picture = str | os.PathLike[str] | npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
"""A file, a folder, a glob pattern, a video; or an array, see :func:`segment_pictures`."""
Settings = Mapping[str, Any]
"""Values by dotted key, as in ``{"hypothesize.model": "homography", "segment.motions": 2}``."""


def segment_pictures(
    pictures: Picture | Sequence[Picture],
    settings: Settings | None = None,
    *,
    camera: Camera | None = None,
    threads: int = 1,
) -> Segmentation:
    """Find the motions between two images, or in the frames of a sequence.

    Parameters
    ----------
    pictures
        Files, folders, glob patterns or videos; or arrays of one size, uint8 or uint16,
        [height, width] or, red first, [height, width, 3].
    settings
        Values by key, as in ``config.yaml``; environment variables are ignored.
    camera
        The calibration, for models that need one.
    threads
        Of mean shift; the result does not depend on them.

    Returns
    -------
    Segmentation
        With the matches ``points`` [P, F, 2] in pixels, one of ``labels`` [P] for each (1, 2, ...
        motions, 0 outliers, -1 background, -2 not judged), the ``motions``, and the documents of
        all stages.

    Raises
    ------
    ConfigurationError
        For a wrong setting.
    UsageError
        For arrays that are not images.
    DataError
        For files that are not images, or images without enough matches.

    Examples
    --------
    >>> import numpy as np
    >>> texture = np.random.default_rng(0).integers(0, 255, (120, 160), dtype=np.uint8)
    >>> found = segment_pictures([texture, texture])
    >>> len(found.motions), set(found.labels.tolist())
    (0, {-1})
    """
    given = _listed(pictures)
    arrays = [picture for picture in given if isinstance(picture, np.ndarray)]
    if not arrays:
        names = [os.fspath(p) for p in given if not isinstance(p, np.ndarray)]
        images = [Setting("input.images", names, "pictures")]
        return pipeline.run(_configuration(settings, camera, images), threads=threads)
    if len(arrays) < len(given):
        raise UsageError("pictures: found files and arrays; expected one kind")
    if len(arrays) < 2:
        raise UsageError(f"pictures: found {len(arrays)} image; expected two or more")
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
) -> Segmentation:
    """Find the motions of tracks from a tracker of your own.

    Parameters
    ----------
    points
        [P, F, 2] in pixels, NaN where a track is not visible.
    settings, camera, threads
        As for :func:`segment_pictures`.
    frame_size
        Width and height of the frames in pixels; by default the smallest that hold all points.

    Returns
    -------
    Segmentation
        As for :func:`segment_pictures`.

    Raises
    ------
    ConfigurationError
        For a wrong setting.
    UsageError
        For an array of another shape.
    DataError
        For tracks that cannot be segmented, such as too few.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> first = rng.uniform(0, 480, (80, 2))
    >>> second = np.where(np.arange(80)[:, None] < 40, first + [12, 3], 1.1 * first - [20, 40])
    >>> found = segment_tracks(np.stack([first, second], axis=1), {"hypothesize.model": "affine"})
    >>> [len(motion.inliers) for motion in found.motions]
    [40, 40]
    """
    places = np.asarray(points, dtype=np.float64)
    if places.ndim != 3 or places.shape[2] != 2:
        raise UsageError(f"points: shape is {places.shape}; expected [tracks, frames, 2]")
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
        for name in ("fx", "fy", "cx", "cy", "distortion", "distortion_model"):
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
            f"pictures[{index}]: {kind} of shape {shape}; expected uint8 or uint16 of shape "
            "[height, width] or [height, width, 3]"
        )
    return Frame(f"pictures[{index}]", shape[1], shape[0])
