"""Numbered frames of a video file, read forwards: seeking is not exact in OpenCV."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import cv2
import numpy as np

from mssegment.errors import DataError
from mssegment.imaging.pictures import StoredPicture, quiet


class Video:
    """The frames of one video file by number, from 0.

    Parameters
    ----------
    path : str
        The file; it is opened on first use.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self._capture: cv2.VideoCapture | None = None
        self._next = 0

    def read(self, index: int) -> StoredPicture:
        """Frame ``index`` as uint8 [height, width, 3] in BGR order.

        Raises DataError if the file cannot be opened or has fewer frames.
        """
        if self._capture is None or index < self._next:
            self._open()
        with quiet():
            while self._next < index and self._grab():
                pass
            picture = self._retrieve() if self._next == index and self._grab() else None
        if picture is None:
            raise DataError(
                f"{self.path}: frame {index} cannot be read, only {self._next} frames can be "
                "decoded; choose frames within that range"
            )
        return picture

    def select(
        self, start: int, stop: int | None, step: int
    ) -> Iterator[tuple[int, StoredPicture]]:
        """Yield number and picture of every ``step``-th frame from ``start`` to before ``stop``.

        Frames are counted by decoding, since the frame count in a file is often wrong.
        """
        self._open()
        for index in itertools.count():
            if stop is not None and index >= stop:
                return
            wanted = index >= start and (index - start) % step == 0
            with quiet():
                if not self._grab():
                    return
                picture = self._retrieve() if wanted else None
            if picture is not None:
                yield index, picture

    def close(self) -> None:
        """Close the file."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def _open(self) -> None:
        self.close()
        with quiet():
            capture = cv2.VideoCapture(self.path)
            opened = capture.isOpened()
        if not opened:
            raise DataError(
                f"{self.path}: neither a picture nor a video that OpenCV can read; convert it "
                "(PNG, JPEG, MP4 and AVI work everywhere)"
            )
        self._capture, self._next = capture, 0

    def _grab(self) -> bool:
        assert self._capture is not None
        if not self._capture.grab():
            return False
        self._next += 1
        return True

    def _retrieve(self) -> StoredPicture | None:
        assert self._capture is not None
        good, picture = self._capture.retrieve()
        return np.asarray(picture) if good and picture is not None else None
