"""Write H.264, which plays everywhere, with PyAV (the extra ``mssegment[video]``)."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any

from mssegment.rendering.report import Picture

QUALITY = "20"
"""Constant rate factor of x264: 23 is its default, 18 is said to show no loss."""
_MUXING = {"movflags": "faststart", "fflags": "+bitexact"}
CODECS = ("libx264", "libopenh264", "h264_videotoolbox")


def encoder() -> str | None:
    """The name of an H.264 encoder; None if PyAV is not installed or has none."""
    try:
        import av
    except ImportError:
        return None
    for name in CODECS:
        try:
            return str(av.codec.Codec(name, "w").name)
        except (av.error.FFmpegError, ValueError):
            continue
    return None


def write_h264(frames: Iterable[Picture], rate: Fraction, path: Path, codec: str) -> int:
    """Write frames of one size with even sides to an MP4; returns their number.

    Parameters
    ----------
    frames : iterable of uint8 array [height, width, 3]
        In BGR order.
    rate : Fraction
        Frames per second.
    path : Path
        The file.
    codec : str
        What ``encoder`` returns.
    """
    import av

    count = 0
    container: Any
    with av.open(str(path), "w", options=_MUXING) as container:
        stream = None
        for picture in frames:
            if stream is None:
                stream = container.add_stream(codec, rate=rate)
                stream.height, stream.width = picture.shape[:2]
                stream.pix_fmt = "yuv420p"  # what every player reads
                stream.codec_context.thread_count = 1  # the same bytes on every machine
                stream.options = {"crf": QUALITY, "preset": "superfast"}
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24")
            container.mux(stream.encode(frame))
            count += 1
        if stream is not None:
            container.mux(stream.encode())
    return count
