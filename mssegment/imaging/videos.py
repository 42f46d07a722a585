"""Numbered frames of a video file, read forwards: seeking is not exact."""

from __future__ import annotations

from collections.abc import Iterator

from mssegment.errors import DataError
from mssegment.imaging.pictures import StoredPicture
from mssegment.imaging.video_faults import fault_of
from mssegment.imaging.video_readers import End, VideoFrame, has_pyav, read


class Video:
    """The frames of one video file by number, from 0.

    Parameters
    ----------
    path : str
        The file; it is opened on first use.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._frames: Iterator[VideoFrame | End] = iter(())
        self._next = 0
        self._opened = False
        self.notes: tuple[str, ...] = ()

    def read(self, index: int) -> StoredPicture:
        """Frame ``index`` as uint8 [height, width, 3] in BGR order.

        Raises DataError if the file cannot be opened or has fewer frames.
        """
        if not self._opened or index < self._next:
            self.close()
            self._frames = read(self.path, index, None, 1)
            self._opened, self._next = True, index
        for frame in self._frames:
            if isinstance(frame, End):
                self._next = frame.decoded
                break
            self._next = frame.index + 1
            if frame.index == index:
                return frame.picture
        decoded = self._next
        self._opened = False
        raise DataError(
            f"{self.path}: frame {index} cannot be read, only {decoded} frames can be "
            "decoded; choose frames within that range"
        )

    def select(
        self, start: int, stop: int | None, step: int
    ) -> Iterator[tuple[int, float | None, StoredPicture]]:
        """Yield number, seconds and picture of every ``step``-th frame from ``start`` on.

        Frames are counted by decoding, since the count in a file is often wrong; ``notes`` says
        where fewer frames could be decoded than the file announces.
        """
        for frame in read(self.path, start, stop, step):
            if isinstance(frame, VideoFrame):
                yield frame.index, frame.seconds, frame.picture
            elif not frame.decoded:
                raise DataError(f"{self.path}: {fault_of(self.path, 'no frame', has_pyav())}")
            elif frame.decoded < frame.announced - 1:
                self.notes = (
                    f"{self.path}: {frame.announced} frames are announced, but only "
                    f"{frame.decoded} can be decoded: the file is cut short or damaged",
                )

    def close(self) -> None:
        """Stop decoding."""
        close = getattr(self._frames, "close", None)
        if close is not None:
            close()
        self._frames, self._opened = iter(()), False
