"""The motions as a video or an animated picture: every frame, with trails behind the inliers.

OpenCV alone writes them: MP4 with the first codec that this OpenCV has, GIF and WebP where it can
write animations (4.11 and newer).
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from mssegment.errors import UsageError
from mssegment.imaging.pictures import quiet
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Floats, Integers
from mssegment.rendering import style
from mssegment.rendering.layout import View, caption, number_badges, view_of
from mssegment.rendering.pictures import caption_motions
from mssegment.rendering.raster import paint
from mssegment.rendering.report import Picture, Report
from mssegment.rendering.scene import Item, Lines, Markers

FORMATS = ("mp4", "gif", "webp")
CODECS = ("avc1", "vp09", "mp4v")
"""H.264 plays everywhere, but the OpenCV from the package index has VP9; MPEG-4 is the last."""
TRAIL = 12
"""Frames that a trail reaches back."""
AGES = ((0, 0.85), (4, 0.5), (8, 0.25))
"""Trails fade: from so many frames back, with this opacity."""


def render_video(report: Report, file_format: str = "mp4", rate: float | None = None) -> bytes:
    """The content of a video of all frames; ``rate`` is in frames a second.

    By default a long sequence runs at 10 frames a second, a few frames at 2 and back and forth.
    Raises UsageError for another format, one that this OpenCV cannot write, or without frames.
    """
    if file_format not in FORMATS:
        raise UsageError(f"no video format {file_format!r}, expected {', '.join(FORMATS)}")
    if not report.frames:
        raise UsageError("there are no frames to make a video of")
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
    """The finished frames one after the other, all of one even size."""
    for index in range(len(report.frames)):
        view = view_of(report, index)
        scene = view.scene(True)
        scene.add(trail_items(report, view))
        scene.add(number_badges(report, view))
        scene.add(caption(view, caption_motions(report)))
        picture = paint(scene)
        height, width = picture.shape[:2]  # codecs store colours for two by two pixels
        yield picture[: height - height % 2, : width - width % 2]


def trail_items(report: Report, view: View) -> list[Item]:
    """Markers of one frame, and where each inlier was in the frames before."""
    size = view.sizes
    here = view.place(report.tracks.points[:, view.index])
    seen = np.asarray(np.isfinite(here).all(axis=1))
    items: list[Item] = []
    for label in (BACKGROUND, NOT_JUDGED, OUTLIER):
        look = style.mark(label)
        places = here[seen & (report.labels == label)]
        items.append(Markers(places, look.shape, size.small, look.colour))
    for motion in report.motions:
        members = np.flatnonzero(seen & (report.labels == motion.label))
        items += _trails(report, view, members, style.mark(motion.label).colour)
    for motion in report.motions:
        look = style.mark(motion.label)
        places = here[seen & (report.labels == motion.label)]
        items.append(Markers(places, look.shape, size.marker, look.colour, 0.28 * size.marker))
    return items


def _trails(report: Report, view: View, members: Integers, colour: style.Colour) -> list[Item]:
    items: list[Item] = []
    for (recent, opacity), (old, _) in zip(AGES, (*AGES[1:], (TRAIL, 0.0)), strict=True):
        first, last = max(0, view.index - old), view.index - recent
        ways = view.place(report.tracks.points[members, first : last + 1])
        paths = tuple(path for path in map(_seen, ways) if len(path) > 1)
        items.append(Lines(paths, colour, 1.2 * view.sizes.line, (), opacity))
    return items


def _seen(way: Floats) -> Floats:
    return way[np.asarray(np.isfinite(way).all(axis=1))]


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
    height, width = picture.shape[:2]
    for codec in CODECS:
        code = cv2.VideoWriter.fourcc(codec[0], codec[1], codec[2], codec[3])
        writer = cv2.VideoWriter(str(path), code, rate, (width, height))
        if writer.isOpened():
            return writer
    raise UsageError("this OpenCV cannot write MP4; ask for gif or webp")


def _write_animation(report: Report, rate: float, path: Path) -> None:
    if not hasattr(cv2, "Animation") or not hasattr(cv2, "imwriteanimation"):
        raise UsageError(f"OpenCV {cv2.__version__} cannot write {path.suffix[1:]}; ask for mp4")
    frames = list(video_frames(report))
    animation = cv2.Animation()
    animation.frames = frames
    animation.durations = np.full(len(frames), round(1000 / rate)).tolist()
    if not cv2.imwriteanimation(str(path), animation):
        raise UsageError(f"this OpenCV cannot write {path.suffix[1:]}; ask for mp4")
