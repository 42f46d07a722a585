"""The Python interface: images or tracks in, motions out, without files in between."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from mssegment import pipeline
from mssegment.configuration import Configuration, Setting, from_mapping, limits_of, resolve
from mssegment.datasets.base import check_points, size_that_holds
from mssegment.documents import TracksDocument
from mssegment.errors import UsageError
from mssegment.inputs import limits
from mssegment.records import Camera, Floats, Frame, Tracks
from mssegment.result import Segmentation

if TYPE_CHECKING:
    from mssegment.imaging.frames import FrameSource

Picture = str | os.PathLike[str] | npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
"""A file, a folder, a glob pattern, a video; or an array, see :func:`segment_pictures`."""
Channels = Literal["rgb", "bgr"]
"""The order of the channels of arrays: ``bgr`` is that of ``cv2.imread``."""
Settings = Mapping[str, Any]
"""Values by dotted key, as in ``{"hypothesize.model": "homography", "segment.motions": 2}``."""


def segment_pictures(
    pictures: Picture | Sequence[Picture],
    settings: Settings | None = None,
    *,
    camera: Camera | None = None,
    channels: Channels = "rgb",
    threads: int = 1,
) -> Segmentation:
    """Find the motions between two images, or in the frames of a sequence.

    Parameters
    ----------
    pictures
        Files, folders, glob patterns or videos; or arrays of one size, uint8 or uint16,
        [height, width] or [height, width, 3].
    settings
        Values by key, as in ``config.yaml``; environment variables are ignored.
    channels
        The order of the channels of arrays: ``"rgb"`` (Pillow, imageio, matplotlib) or ``"bgr"``
        (OpenCV). It matters for the colours of pictures and masks, hardly for the motions.
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
    if any(isinstance(picture, np.ndarray) for picture in given):
        configuration = _configuration(settings, camera)
        source = _source_of(given, channels)
        return _found(configuration, None, source, threads)
    names = [os.fspath(p) for p in given if not isinstance(p, np.ndarray)]
    images = [Setting("input.images", names, "pictures")]
    configuration = _configuration(settings, camera, images)
    return _found(configuration, None, None, threads)


def segment_tracks(
    points: npt.ArrayLike,
    settings: Settings | None = None,
    *,
    frame_size: tuple[int, int] | None = None,
    camera: Camera | None = None,
    ids: Sequence[object] | None = None,
    pictures: Picture | Sequence[Picture] | None = None,
    channels: Channels = "rgb",
    threads: int = 1,
) -> Segmentation:
    """Find the motions of tracks from a tracker of your own.

    Parameters
    ----------
    points
        [P, F, 2] in pixels: P tracks in F frames, NaN or masked where a track is not visible.
    settings, camera, channels, threads
        As for :func:`segment_pictures`.
    frame_size
        Width and height of the frames in pixels; by default the smallest that hold all points.
    ids
        Your own names of the P tracks, for tables.
    pictures
        The frames that the tracks are from, as for :func:`segment_pictures`, to draw on and for
        masks; the motions do not depend on them.

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
    places = _places(points)
    names = None if ids is None else tuple(str(name) for name in ids)
    if names is not None and len(names) != len(places):
        raise UsageError(f"ids: found {len(names)} for {len(places)} tracks; expected one for each")
    width, height = (int(side) for side in frame_size or size_that_holds(places))
    if width < 1 or height < 1:
        raise UsageError(f"frame_size: found {width}x{height}; expected width and height in pixels")
    frames = [Frame("", width, height, index=index) for index in range(places.shape[1])]
    tracks = TracksDocument(frames=frames, tracks=Tracks(places, ids=names))
    source = None
    if pictures is not None:
        source = _source_of(_listed(pictures), channels)
        if len(source.frames) != len(frames):
            raise UsageError(
                f"pictures: found {len(source.frames)} for {len(frames)} frames of the tracks; "
                "expected one for each"
            )
        tracks = pipeline.put_on_pictures(tracks, source)
    configuration = _configuration(settings, camera)
    return _found(configuration, tracks, source, threads)


def _found(
    configuration: Configuration,
    tracks: TracksDocument | None,
    source: FrameSource | None,
    threads: int,
) -> Segmentation:
    with limits.using(limits_of(configuration)):
        outcome = pipeline.run(configuration, tracks, source, threads=threads)
    fields = {name: getattr(outcome, name) for name in pipeline.Outcome.__struct_fields__}
    return Segmentation(**fields, configuration=configuration)


def _places(points: npt.ArrayLike) -> Floats:
    """Tracks [P, F, 2] as numbers, masked positions as NaN; raises UsageError for another shape."""
    try:
        places = np.ma.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise UsageError(
            "points: not an array of numbers; expected [tracks, frames, 2], NaN where a track is "
            "not visible"
        ) from None
    shape = places.shape
    if len(shape) != 3 or shape[2] != 2:
        raise UsageError(f"points: shape is {shape}; expected [tracks, frames, 2]{_hint(shape)}")
    hidden = np.ma.getmaskarray(places).any(axis=2, keepdims=True)
    filled = np.where(hidden, np.nan, np.ma.getdata(places))
    if _frames_come_first(filled):
        raise UsageError(
            f"points: shape is {shape}, which would be {shape[0]} tracks over {shape[1]} frames, "
            "but neighbours along the first axis are nearer: expected [tracks, frames, 2]; pass "
            "numpy.swapaxes(points, 0, 1)"
        )
    check_points(filled, "points")
    return filled


def _hint(shape: tuple[int, ...]) -> str:
    """What an array of another shape may be."""
    if len(shape) == 3 and 2 in shape[:2]:
        axis = shape.index(2)
        return f"; if axis {axis} is x and y, pass numpy.moveaxis(points, {axis}, 2)"
    if len(shape) == 2 and shape[1] == 4:
        return "; matches x1, y1, x2, y2 are points.reshape(-1, 2, 2)"
    return ""


def _frames_come_first(places: Floats) -> bool:
    """Whether tracks [P, F, 2] are probably [F, P, 2].

    There are fewer "tracks" than "frames", and neighbours along the first axis are nearer to each
    other than along the second: a point moves less than points lie apart.
    """
    if not 1 < len(places) < places.shape[1]:
        return False
    steps = [np.linalg.norm(np.diff(places, axis=axis), axis=-1) for axis in (0, 1)]
    seen = [np.ravel(step)[np.isfinite(np.ravel(step))] for step in steps]
    return all(len(step) for step in seen) and bool(np.median(seen[0]) < np.median(seen[1]))


def _configuration(
    settings: Settings | None, camera: Camera | None, more: Sequence[Setting] = ()
) -> Configuration:
    given = from_mapping(settings or {}, "settings")
    if camera is not None:
        names = ("fx", "fy", "cx", "cy", "distortion", "distortion_model")
        given += from_mapping({f"camera.{name}": getattr(camera, name) for name in names}, "camera")
    return resolve([*given, *more])


def _source_of(given: Sequence[Picture], channels: Channels) -> FrameSource:
    """The frames of files, or of arrays; raises UsageError for both, or for what is no picture."""
    from mssegment.imaging.frames import frames_in_memory, open_frames

    if channels not in ("rgb", "bgr"):
        raise UsageError(f"channels: found {channels!r}; expected 'rgb' or 'bgr'")
    arrays = [picture for picture in given if isinstance(picture, np.ndarray)]
    if not arrays:
        return open_frames([os.fspath(p) for p in given if not isinstance(p, np.ndarray)])
    if len(arrays) < len(given):
        raise UsageError("pictures: found files and arrays; expected one kind")
    if len(arrays) < 2:
        raise UsageError(f"pictures: found {len(arrays)} image; expected two or more")
    frames = [_frame(index, array) for index, array in enumerate(arrays)]
    step = -1 if channels == "rgb" else 1
    pixels = [a if a.ndim == 2 else np.ascontiguousarray(a[..., ::step]) for a in arrays]
    return frames_in_memory(frames, pixels)


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
