"""The motions as a video or an animated picture: every frame, with trails behind the inliers.

Written with OpenCV alone: MP4 with the first codec that it has, GIF and WebP from 4.11 on.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from mssegment.errors import UsageError
from mssegment.imaging.pictures import quiet
from mssegment.progress import track
from mssegment.records import Floats, Integers
from mssegment.rendering import style
from mssegment.rendering.layout import FrameView, add_legend, number_badges, view_of
from mssegment.rendering.pictures import motion_entries
from mssegment.rendering.raster import paint
from mssegment.rendering.report import Picture, Report
from mssegment.rendering.scene import Item, Lines, Markers

FORMATS = ("mp4", "gif", "webp")
CODECS = ("avc1", "vp09", "mp4v")
"""By preference: H.264 plays everywhere, but OpenCV's wheels only have VP9 and MPEG-4."""
TRAIL_FRAMES = 12
"""Frames that a trail covers."""
TRAIL_OPACITIES = ((0, 0.85), (4, 0.5), (8, 0.25))
"""Age in frames from which on a trail has each opacity."""


def render_video(report: Report, file_format: str = "mp4", rate: float | None = None) -> bytes:
    """Write a video of all frames.

    Parameters
    ----------
    report : Report
        The segmentation.
    file_format : str
        One of ``FORMATS``.
    rate : float, optional
        Frames per second: by default 10, for at most 12 frames 2.

    Returns
    -------
    bytes
        The content of the file. An MP4 of at most 12 frames repeats them four times.

    Raises
    ------
    UsageError
        For another format, one that this OpenCV cannot write, or without frames.
    """
    if file_format not in FORMATS:
        raise UsageError(f"video format {file_format!r}: expected {', '.join(FORMATS)}")
    if not report.frames:
        raise UsageError("video: the report has no frames, expected one or more")
    count = len(report.frames)
    rate = rate or (10.0 if count > 12 else 2.0)
    order = list(range(count)) * (1 if count > 12 else 4)
    with tempfile.TemporaryDirectory(prefix="mssegment-") as folder:
        path = Path(folder) / f"motions.{file_format}"
        if file_format == "mp4":
            _write_mp4(report, order, rate, path)
        else:
            _write_animation(report, rate, path)
        return path.read_bytes()


def video_frames(report: Report) -> Iterator[Picture]:
    """Yield the finished frames, all of one size with even sides."""
    for index in track(range(len(report.frames)), "frames of the video"):
        view = view_of(report, index)
        scene = view.scene()
        scene.add(trail_items(report, view))
        scene.add(number_badges(report, view))
        add_legend(scene, view, motion_entries(report))
        picture = paint(scene)
        height, width = picture.shape[:2]  # codecs store colour per 2 x 2 pixels
        yield picture[: height - height % 2, : width - width % 2]


def trail_items(report: Report, view: FrameView) -> list[Item]:
    """Markers of the tracks in one frame, and trails behind the inliers."""
    size = view.sizes
    points = view.to_picture(report.tracks.points[:, view.index])
    visible = np.asarray(np.isfinite(points).all(axis=1))
    items: list[Item] = []
    for label in report.quiet_labels:
        marker = report.style(label)
        places = points[visible & (report.labels == label)]
        items.append(Markers(places, marker.shape, size.small, marker.colour))
    for motion in report.objects:
        members = np.flatnonzero(visible & (report.labels == motion.label))
        items += _trails(report, view, members, report.style(motion.label).colour)
    for motion in report.objects:
        marker = report.style(motion.label)
        places = points[visible & (report.labels == motion.label)]
        items.append(Markers(places, marker.shape, size.marker, marker.colour, 0.28 * size.marker))
    return items


def _trails(report: Report, view: FrameView, members: Integers, colour: style.Colour) -> list[Item]:
    """The paths of some tracks over the last frames, in pieces of falling opacity."""
    items: list[Item] = []
    older = (*TRAIL_OPACITIES[1:], (TRAIL_FRAMES, 0.0))
    for (recent, opacity), (old, _) in zip(TRAIL_OPACITIES, older, strict=True):
        first, last = max(0, view.index - old), view.index - recent
        tracks = view.to_picture(report.tracks.points[members, first : last + 1])
        paths = tuple(path for path in map(_visible_part, tracks) if len(path) > 1)
        items.append(Lines(paths, colour, 1.2 * view.sizes.line, (), opacity))
    return items


def _visible_part(track: Floats) -> Floats:
    """The positions [k, 2] of a track [F, 2] where it is visible."""
    return track[np.asarray(np.isfinite(track).all(axis=1))]


def _write_mp4(report: Report, order: list[int], rate: float, path: Path) -> None:
    frames = list(video_frames(report)) if len(order) > len(report.frames) else None
    writer = None
    source = (frames[i] for i in order) if frames else video_frames(report)
    with quiet():
        for picture in source:
            writer = writer or _mp4_writer(path, rate, picture)
            writer.write(picture)
    if writer is not None:
        writer.release()


def _mp4_writer(path: Path, rate: float, picture: Picture) -> cv2.VideoWriter:
    """A writer with the first codec that this OpenCV has."""
    height, width = picture.shape[:2]
    for codec in CODECS:
        code = cv2.VideoWriter.fourcc(codec[0], codec[1], codec[2], codec[3])
        writer = cv2.VideoWriter(str(path), code, rate, (width, height))
        if writer.isOpened():
            return writer
    raise UsageError(
        f"video: OpenCV {cv2.__version__} cannot write MP4, expected an encoder for "
        f"{', '.join(CODECS)}; do without the video, or install another build of OpenCV"
    )


def _write_animation(report: Report, rate: float, path: Path) -> None:
    error = UsageError(
        f"video: OpenCV {cv2.__version__} cannot write {path.suffix[1:]}, expected 4.11 or newer "
        "with this format; use mp4"
    )
    if not hasattr(cv2, "Animation") or not hasattr(cv2, "imwriteanimation"):
        raise error
    frames = list(video_frames(report))
    animation = cv2.Animation()
    animation.frames = frames
    animation.durations = np.full(len(frames), round(1000 / rate)).tolist()
    if not cv2.imwriteanimation(str(path), animation):
        raise error
