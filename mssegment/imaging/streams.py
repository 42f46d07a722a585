"""A long clip as a stream: every frame is decoded once, in a thread of its own."""

from __future__ import annotations

import contextvars
import hashlib
import queue
import threading
from collections.abc import Collection, Generator, Iterator, Sequence
from itertools import islice
from typing import TypeVar

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.imaging import pictures
from mssegment.imaging.frames import is_moving, is_video
from mssegment.imaging.pictures import StoredPicture
from mssegment.imaging.sources import expand
from mssegment.imaging.video_readers import VideoFrame, announced_frames, read
from mssegment.imaging.videos import Video
from mssegment.records import Frame, Record

T = TypeVar("T")
QUEUED_FRAMES = 8
"""Frames that are decoded ahead: enough to keep both threads busy."""


class Clip(Record, frozen=True):
    """One video, or a list of pictures, to be read as a stream.

    Attributes
    ----------
    paths : tuple of str
        The video, or the pictures.
    is_video : bool
        Which of both.
    start, stop, step : int
        The frames of a video; those of pictures are chosen already.
    sha256 : str
        That of the video, or of those of all pictures.
    """

    paths: tuple[str, ...]
    is_video: bool
    start: int
    stop: int | None
    step: int
    sha256: str

    def frames(self, first: int = 0) -> Iterator[tuple[Frame, StoredPicture]]:
        """The records and pictures from frame ``first`` on.

        Raises DataError if a picture cannot be read, or has another size than the first.
        """
        size = None
        for frame, picture in self._video(first) if self.is_video else self._pictures(first):
            size = size or (frame.width, frame.height)
            if (frame.width, frame.height) != size:
                raise DataError(
                    f"{frame.path}: {frame.width}x{frame.height} pixels, but the frames before "
                    f"have {size[0]}x{size[1]}; use pictures of one size"
                )
            yield frame, picture

    def pictures(self, wanted: Collection[int] | None = None) -> Iterator[StoredPicture | None]:
        """The picture of each frame, all or only those ``wanted``; None for the others.

        Raises DataError as ``frames`` does.
        """
        for index, (_, picture) in enumerate(self.frames()):
            yield picture if wanted is None or index in wanted else None

    def _video(self, first: int) -> Iterator[tuple[Frame, StoredPicture]]:
        path, start = self.paths[0], self.start + first * self.step
        for index, seconds, picture in Video(path).select(start, self.stop, self.step):
            height, width = picture.shape[:2]
            time = None if seconds is None else round(seconds, 6)
            yield Frame(path, width, height, self.sha256, index, time), picture

    def _pictures(self, first: int) -> Iterator[tuple[Frame, StoredPicture]]:
        for path in self.paths[first:]:
            content = pictures.read_bytes(path)
            picture = pictures.decode(path, content)
            height, width = picture.shape[:2]
            yield Frame(path, width, height, hashlib.sha256(content).hexdigest()), picture


def long_clip(
    inputs: Sequence[str], start: int, stop: int | None, step: int, longer_than: int
) -> Clip | None:
    """The clip, if the inputs are one video, or pictures, with more than so many frames.

    Parameters
    ----------
    inputs : sequence of str
        Paths and patterns, as in ``sources.expand``.
    start, stop, step
        As in ``frames.open_frames``.
    longer_than : int
        A number of frames.

    Returns
    -------
    Clip or None
        None also for several videos, and for files of which all pictures are decoded together.
    """
    if not inputs or (stop is not None and stop <= start):
        return None  # open_frames says what is wrong
    paths = [path for given in inputs for path in expand(given)[0]]
    moving = [is_moving(path) for path in paths]
    if not any(moving):
        chosen = paths[start:stop:step]
        if len(chosen) <= longer_than:
            return None
        digest = hashlib.sha256("".join(map(pictures.sha256, chosen)).encode()).hexdigest()
        return Clip(tuple(chosen), False, 0, None, 1, digest)
    if len(paths) > 1 or not is_video(paths[0]):
        return None
    if _frames_at_least(paths[0], start, stop, step, longer_than + 1):
        return Clip((paths[0],), True, start, stop, step, pictures.sha256(paths[0]))
    return None


def _frames_at_least(path: str, start: int, stop: int | None, step: int, least: int) -> bool:
    """Whether a video has so many frames: by what it announces, if that is many more."""
    if stop is not None and len(range(start, stop, step)) < least:
        return False
    if stop is None and announced_frames(path) > 2 * (start + least * step):
        return True
    seen = sum(
        isinstance(frame, VideoFrame) for frame in islice(read(path, start, stop, step), least)
    )
    return seen == least


def grey_bytes(picture: StoredPicture, white: float) -> npt.NDArray[np.uint8]:
    """The picture in grey, 8 bits."""
    if picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3:
        colour = np.asarray(picture, np.uint8)
        return np.asarray(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY), np.uint8)
    return np.rint(pictures.to_grey(picture, white)).clip(0, 255).astype(np.uint8)


def in_background(items: Iterator[T]) -> Generator[T]:
    """The items, produced by a thread that is some of them ahead.

    An exception in the thread is raised here. The thread ends when the iterator is closed.
    """
    passed: queue.Queue[T | _End] = queue.Queue(QUEUED_FRAMES)
    stopped = threading.Event()

    def put(item: T | _End) -> bool:
        while not stopped.is_set():
            try:
                passed.put(item, timeout=0.1)
                return True
            except queue.Full:
                continue
        return False

    def produce() -> None:
        try:
            for item in items:
                if not put(item):
                    break
            else:
                put(_End(None))
        except BaseException as error:
            put(_End(error))
        finally:
            close = getattr(items, "close", None)
            if close is not None:
                close()

    context = contextvars.copy_context()  # the limits of what is read
    thread = threading.Thread(target=context.run, args=(produce,), name="reader", daemon=True)
    thread.start()
    try:
        while True:
            item = passed.get()
            if isinstance(item, _End):
                if item.error is not None:
                    raise item.error
                return
            yield item
    finally:
        stopped.set()
        thread.join()


class _End(Record, frozen=True):
    """The end of a stream, or the error that ended it."""

    error: BaseException | None
