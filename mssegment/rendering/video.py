"""The motions as a video or an animated picture: every frame, with trails behind the inliers.

MP4 is H.264 where PyAV is installed, otherwise the first codec that OpenCV has; GIF and WebP are
written by OpenCV from 4.11 on.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import UsageError
from mssegment.inputs.standard_error import quiet
from mssegment.progress import track
from mssegment.records import Floats, Frame, Integers, Record
from mssegment.rendering import h264, style
from mssegment.rendering.layout import FrameView, add_legend, number_badges, view_of
from mssegment.rendering.pictures import motion_entries
from mssegment.rendering.raster import paint
from mssegment.rendering.report import Picture, Report
from mssegment.rendering.scene import Item, Lines, Markers

FORMATS = ("mp4", "gif", "webp")
CODECS = {"avc1": "H.264", "vp09": "VP9", "mp4v": "MPEG-4"}
"""By preference: H.264 plays everywhere, but OpenCV's wheels only have VP9 and MPEG-4."""
FEW_FRAMES = 12
"""At most as many frames are shown slowly and repeated: at their own rate they would flash by."""
TRAIL_FRAMES = 12
"""Frames that a trail covers."""
TRAIL_OPACITIES = ((0, 0.85), (4, 0.5), (8, 0.25))
"""Age in frames from which on a trail has each opacity."""


class VideoFile(Record, frozen=True):
    """The content of a video file, and what it is, in words."""

    content: bytes
    description: str


def render_video(report: Report, file_format: str = "mp4", rate: float | None = None) -> bytes:
    """Write a video of all frames; the ``content`` of ``make_video``."""
    return make_video(report, file_format, rate).content


def make_video(report: Report, file_format: str = "mp4", rate: float | None = None) -> VideoFile:
    """Write a video of all frames, at their own size and rate.

    Parameters
    ----------
    report : Report
        The segmentation.
    file_format : str
        One of ``FORMATS``.
    rate : float, optional
        Frames per second: by default that of the source, where it has times; otherwise 10. At most
        12 frames are shown at 2 a second.

    Returns
    -------
    VideoFile
        An MP4 of at most 12 frames repeats them four times.

    Raises
    ------
    UsageError
        For another format, one that cannot be written, or without frames.
    """
    if file_format not in FORMATS:
        raise UsageError(f"video format {file_format!r}: expected {', '.join(FORMATS)}")
    if not report.frames:
        raise UsageError("video: the report has no frames, expected one or more")
    count = len(report.frames)
    few = count <= FEW_FRAMES
    chosen = Fraction(rate).limit_denominator(1001) if rate else None
    chosen = chosen or (Fraction(2) if few else source_rate(report.frames) or Fraction(10))
    repeated = 4 if few and file_format == "mp4" else 1
    with tempfile.TemporaryDirectory(prefix="mssegment-") as folder:
        path = Path(folder) / f"motions.{file_format}"
        if file_format == "mp4":
            codec = _write_mp4(report, repeated, chosen, path)
        else:
            codec = file_format.upper()
            _write_animation(report, float(chosen), path)
        height, width = first_size(report)
        return VideoFile(
            path.read_bytes(),
            f"{path.name}: {count * repeated} frames of {width}x{height} pixels (the frames and a "
            f"legend), {float(chosen):.4g} a second, {codec}",
        )


def source_rate(frames: Sequence[Frame]) -> Fraction | None:
    """Frames per second of the source by the times of its frames; None where it has no times."""
    times = [frame.time for frame in frames if frame.time is not None]
    gaps = np.diff(times)
    if len(times) < len(frames) or not len(gaps) or gaps.min() <= 0:
        return None
    # a recorder may have dropped frames, which leaves larger gaps
    usual = gaps[np.abs(gaps - np.median(gaps)) < np.median(gaps) / 2]
    return Fraction(1 / float(usual.mean())).limit_denominator(1001)


def first_size(report: Report) -> tuple[int, int]:
    """Height and width of the frames of the video."""
    height, width = next(_drawn(report, range(1))).shape[:2]
    return height, width


def video_frames(report: Report) -> Iterator[Picture]:
    """Yield the finished frames, all of one size with even sides."""
    return _drawn(report, range(len(report.frames)))


def _drawn(report: Report, indices: Sequence[int]) -> Iterator[Picture]:
    for index in track(indices, "frames of the video"):
        view = view_of(report, index, scale=1.0)
        scene = view.scene()
        scene.add(trail_items(report, view))
        scene.add(number_badges(report, view))
        add_legend(scene, view, motion_entries(report))
        picture = paint(scene)
        height, width = picture.shape[:2]  # codecs store colour per 2 x 2 pixels
        yield np.ascontiguousarray(picture[: height - height % 2, : width - width % 2])


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
        paths = tuple(path for path in _visible_parts(tracks) if len(path) > 1)
        items.append(Lines(paths, colour, 1.2 * view.sizes.line, (), opacity))
    return items


def _visible_parts(tracks: Floats) -> Iterator[Floats]:
    """The positions [k, 2] of each of some tracks [P, F, 2] where it is visible."""
    seen: npt.NDArray[np.bool_] = np.asarray(np.isfinite(tracks).all(axis=2))
    for path, own, whole in zip(tracks, seen, np.asarray(seen.all(axis=1)).tolist(), strict=True):
        yield path if whole else path[own]


def _write_mp4(report: Report, repeated: int, rate: Fraction, path: Path) -> str:
    """Write the frames some times over; what they are encoded as."""
    kept = list(video_frames(report)) if repeated > 1 else None
    return write_stream(iter(kept * repeated) if kept else video_frames(report), rate, path)


def write_stream(frames: Iterator[Picture], rate: Fraction, path: Path) -> str:
    """Write frames of one size with even sides to an MP4; what they are encoded as."""
    encoder = h264.encoder()
    if encoder is not None:
        h264.write_h264(frames, rate, path, encoder)
        return "H.264"
    writer, codec = None, ""
    with quiet():
        for picture in frames:
            if writer is None:
                writer, codec = _mp4_writer(path, float(rate), picture)
            writer.write(picture)
    if writer is not None:
        writer.release()
    return f"{CODECS[codec]} (H.264 with pip install 'mssegment[video]')"


def _mp4_writer(path: Path, rate: float, picture: Picture) -> tuple[cv2.VideoWriter, str]:
    """A writer with the first codec that this OpenCV has, and the codec."""
    height, width = picture.shape[:2]
    for codec in CODECS:
        code = cv2.VideoWriter.fourcc(codec[0], codec[1], codec[2], codec[3])
        writer = cv2.VideoWriter(str(path), code, rate, (width, height))
        if writer.isOpened():
            return writer, codec
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
