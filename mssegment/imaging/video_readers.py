"""Two ways to decode a video: PyAV where it is installed, otherwise OpenCV in a child process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mssegment.errors import DataError
from mssegment.imaging import opencv_decoder
from mssegment.imaging.pictures import StoredPicture
from mssegment.inputs import limits
from mssegment.records import Record

EXTRA = "pip install 'mssegment[video]'"


class VideoFrame(Record, frozen=True):
    """A decoded frame: its number from 0, the time when it is shown, in seconds, and its pixels."""

    index: int
    seconds: float | None
    picture: StoredPicture


class End(Record, frozen=True):
    """The end of a video, and the number of frames that it announces; 0 if it does not say."""

    decoded: int
    announced: int


def has_pyav() -> bool:
    """Whether PyAV is installed."""
    import importlib.util

    return importlib.util.find_spec("av") is not None


def announced_frames(path: str) -> int:
    """The number of frames that a video announces, not always rightly; 0 if it is not known."""
    if not has_pyav():
        return 0
    import av

    try:
        with av.open(path, options={"protocol_whitelist": "file"}) as container:
            streams = container.streams.video
            return int(streams[0].frames or 0) if streams else 0
    except (av.error.FFmpegError, ValueError):
        return 0  # reading the file says what is wrong


def read(path: str, start: int, stop: int | None, step: int) -> Iterator[VideoFrame | End]:
    """Decode every ``step``-th frame from ``start`` to before ``stop``; at last the ``End``.

    Raises DataError, saying why, if the file cannot be opened or its decoder dies.
    """
    if has_pyav():
        return _read_by_pyav(path, start, stop, step)
    return _read_by_child(path, start, stop, step)


def _read_by_pyav(path: str, start: int, stop: int | None, step: int) -> Iterator[VideoFrame | End]:
    import av

    largest = limits.limit("picture_pixels")
    # PyAV's log stays off, as it is by default: its callbacks can wait for ever for the threads of
    # the decoder
    try:
        container = av.open(path, options=opencv_decoder.OPTIONS)
    except (av.error.FFmpegError, ValueError, OSError, MemoryError, OverflowError) as error:
        raise DataError(
            f"{path}: {_reason(path, str(getattr(error, 'strerror', error)))}"
        ) from None
    # of a reader that is left open, modules are gone when the interpreter ends
    failures = (av.error.FFmpegError, ValueError, OSError)
    with container:
        if not container.streams.video:
            raise DataError(f"{path}: {_reason(path, 'no video stream')}")
        stream = container.streams.video[0]
        if stream.codec_context is None:
            raise DataError(f"{path}: {_reason(path, 'no decoder for its codec')}")
        stream.thread_type = "AUTO"
        _check_size(path, stream.width or 0, stream.height or 0)
        stream.codec_context.options = {"max_pixels": str(largest)}
        announced, index, first = int(stream.frames or 0), 0, None
        try:
            for frame in container.decode(stream):
                if frame.is_corrupt:
                    break  # what follows builds on what is missing
                if stop is not None and index >= stop:
                    announced = 0
                    break
                first = frame.time if first is None else first
                _check_size(path, frame.width, frame.height)
                if index >= start and (index - start) % step == 0:
                    yield VideoFrame(index, _since(frame.time, first), _upright(frame))
                index += 1
        except MemoryError:
            raise DataError(
                f"{path}: there is not enough memory to decode frame {index}; use a smaller video"
            ) from None
        except failures as error:
            if index == 0:
                reason = str(getattr(error, "strerror", error))
                raise DataError(f"{path}: {_reason(path, reason)}") from None
        yield End(index, announced)


def _check_size(path: str, width: int, height: int) -> None:
    """Raises DataError for frames larger than ``limits.picture_pixels``."""
    limits.check("picture_pixels", width * height, f"{path}: frames of {width}x{height}")


def _since(time: float | None, first: float | None) -> float | None:
    return None if time is None else time - (first or 0.0)


def _upright(frame: Any) -> StoredPicture:
    """The frame as BGR, turned as its file says, which players and OpenCV do too."""
    picture = frame.to_ndarray(format="bgr24")
    turns = round(getattr(frame, "rotation", 0) / 90) % 4
    return np.ascontiguousarray(np.rot90(picture, turns)) if turns else picture


def _read_by_child(
    path: str, start: int, stop: int | None, step: int
) -> Iterator[VideoFrame | End]:
    command = [sys.executable, opencv_decoder.__file__, str(Path(path).absolute())]
    command += [str(start), str(-1 if stop is None else stop), str(step)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert child.stdout is not None
    first: float | None = None
    last = -1
    try:
        while True:
            header = child.stdout.read(opencv_decoder.HEADER.size)
            if len(header) < opencv_decoder.HEADER.size:
                break
            index, seconds, height, width = opencv_decoder.HEADER.unpack(header)
            if index == opencv_decoder.END:
                yield End(width, height)
                return
            _check_size(path, width, height)
            content = child.stdout.read(height * width * 3)
            if len(content) < height * width * 3:
                break
            first = seconds if first is None else first
            last = index
            yield VideoFrame(
                index,
                seconds - first if start == 0 else seconds,
                np.frombuffer(content, np.uint8).reshape(height, width, 3),
            )
    finally:
        child.stdout.close()
        if child.poll() is None:
            child.kill()
        status = child.wait()
    if status == opencv_decoder.NOT_OPENED:
        raise DataError(f"{path}: {_reason(path, '')}")
    where = f"after frame {last}" if last >= 0 else "at the first frame"
    raise DataError(
        f"{path}: OpenCV's decoder died {where} ({_cause(status)}); {EXTRA} reads it "
        "with another decoder, or convert it (MP4 with H.264)"
    )


def _cause(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    import signal

    return signal.Signals(-status).name


def _reason(path: str, said: str) -> str:
    """Why a file is no readable video, in words, from its content and what the decoder said."""
    from mssegment.imaging.video_faults import fault_of

    return fault_of(path, said, has_pyav())
