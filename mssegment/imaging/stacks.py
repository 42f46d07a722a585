"""Files with several pictures: animated GIF, WebP and PNG, and TIFF stacks."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

import cv2
import numpy as np

from mssegment.errors import DataError
from mssegment.imaging.headers import check_size, check_stack, tiff_tags
from mssegment.imaging.pictures import StoredPicture, check_depth, check_memory, read_bytes
from mssegment.inputs.standard_error import quiet

_REDUCED = 254
"""The TIFF tag that marks a reduced copy of another page."""


def is_stack(content: bytes) -> bool:
    """Whether the bytes of a picture file hold more than one picture of a sequence."""
    return count_pictures(content) > 1


def count_pictures(content: bytes) -> int:
    """The number of pictures of a sequence in a picture file, at least as many as it holds."""
    if content[:4] in (b"II*\0", b"MM\0*"):
        return len(tiff_pages(content))
    if content.startswith(b"\x89PNG"):
        # the chunk of an animation stands before the first one with pixels
        is_animated = 0 < content.find(b"acTL") < max(content.find(b"IDAT"), 0)
        return max(content.count(b"fcTL"), 2) if is_animated else 1
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return content.count(b"ANMF") if b"ANIM" in content[12:64] else 1
    return _gif_frames(content) if content.startswith(b"GIF8") else 1


class Stack:
    """The pictures of one file by number, from 0.

    Parameters
    ----------
    path : str
        The file; it is decoded on first use.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.notes: tuple[str, ...] = ()
        self._pictures: list[StoredPicture] | None = None
        self._seconds: list[float] = []

    def read(self, index: int) -> StoredPicture:
        """Picture ``index``; raises DataError if there are fewer."""
        pictures = self._decoded()
        if index >= len(pictures):
            raise DataError(
                f"{self.path}: picture {index} cannot be read, the file has {len(pictures)}"
            )
        return pictures[index]

    def select(
        self, start: int, stop: int | None, step: int
    ) -> Iterator[tuple[int, float | None, StoredPicture]]:
        """Yield number, seconds (None in a TIFF) and picture, as ``Video.select`` does."""
        pictures = self._decoded()
        for index in islice(range(len(pictures)), start, stop, step):
            seconds = self._seconds[index] if self._seconds else None
            yield index, seconds, pictures[index]

    def close(self) -> None:
        """Forget the decoded pictures."""
        self._pictures = None

    def _decoded(self) -> list[StoredPicture]:
        if self._pictures is None:
            content = read_bytes(self.path)
            check_size(self.path, content)
            check_stack(self.path, content, count_pictures(content))
            is_tiff = content[:4] in (b"II*\0", b"MM\0*")
            self._pictures = self._pages(content) if is_tiff else self._animation(content)
        return self._pictures

    def _pages(self, content: bytes) -> list[StoredPicture]:
        try:
            with quiet():
                good, pages = cv2.imdecodemulti(
                    np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED
                )
        except (cv2.error, MemoryError) as failure:
            check_memory(failure, self.path)
            good, pages = False, ()
        wanted = tiff_pages(content)
        if not good or len(pages) <= wanted[-1]:
            raise DataError(f"{self.path}: a damaged TIFF stack; copy or export it again")
        return [check_depth(np.asarray(pages[i]), self.path) for i in wanted]

    def _animation(self, content: bytes) -> list[StoredPicture]:
        if not hasattr(cv2, "imdecodeanimation"):
            raise DataError(
                f"{self.path}: an animated picture, which OpenCV reads from version 4.11 on; "
                "upgrade opencv-python-headless, or convert it to MP4 or PNG files"
            )
        try:
            with quiet():
                good, found = cv2.imdecodeanimation(np.frombuffer(content, np.uint8))
        except (cv2.error, MemoryError) as failure:
            check_memory(failure, self.path)
            good = False
        if not good or not found.frames:
            raise DataError(f"{self.path}: a damaged animation; copy or export it again")
        ends = np.cumsum(np.asarray(found.durations, dtype=np.float64).ravel()) / 1000
        self._seconds = [0.0, *ends[:-1].tolist()]
        return [_without_alpha(np.asarray(frame)) for frame in found.frames]


def _without_alpha(picture: StoredPicture) -> StoredPicture:
    """Drop a channel of transparency that says nothing, as in most animations."""
    if picture.ndim == 3 and picture.shape[2] == 4 and (picture[..., 3] == 255).all():
        return np.ascontiguousarray(picture[..., :3])
    return picture


def tiff_pages(content: bytes) -> list[int]:
    """The indices of the pages of a TIFF that are no reduced copies of others, of one size.

    Pages of another size than the first (overviews, thumbnails) are no frames of its sequence.
    """
    pages = [
        (index, (tags.get(256, 0), tags.get(257, 0)))
        for index, tags in enumerate(tiff_tags(content))
        if not tags.get(_REDUCED, 0) & 1
    ]
    return [index for index, size in pages if size == pages[0][1]] or [0]


def _gif_frames(content: bytes) -> int:
    """The number of pictures in a GIF."""
    frames = 0
    try:
        flags = content[10]
        place = 13 + (3 << ((flags & 7) + 1) if flags & 0x80 else 0)
        while True:
            block = content[place]
            if block == 0x2C:
                frames += 1
                flags = content[place + 9]
                place += 10 + (3 << ((flags & 7) + 1) if flags & 0x80 else 0) + 1
            elif block == 0x21:
                place += 2
            else:
                break
            while content[place]:
                place += content[place] + 1
            place += 1
    except IndexError:
        pass  # cut short: the decoder says so
    return frames
