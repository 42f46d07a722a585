"""Files with several pictures: animated GIF, WebP and PNG, and TIFF stacks."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import islice

import cv2
import numpy as np

from mssegment.errors import DataError
from mssegment.imaging.pictures import StoredPicture, check_depth, quiet, read_bytes

_REDUCED = 254
"""The TIFF tag that marks a reduced copy of another page."""
_MOST_PAGES = 100_000


def is_stack(content: bytes) -> bool:
    """Whether the bytes of a picture file hold more than one picture of a sequence."""
    if content[:4] in (b"II*\0", b"MM\0*"):
        return len(tiff_pages(content)) > 1
    if content.startswith(b"\x89PNG"):
        # the chunk of an animation stands before the first one with pixels
        return 0 < content.find(b"acTL") < max(content.find(b"IDAT"), 0)
    if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
        return b"ANIM" in content[12:64] and content.count(b"ANMF") > 1
    return content.startswith(b"GIF8") and _gif_frames(content) > 1


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
            is_tiff = content[:4] in (b"II*\0", b"MM\0*")
            self._pictures = self._pages(content) if is_tiff else self._animation(content)
        return self._pictures

    def _pages(self, content: bytes) -> list[StoredPicture]:
        try:
            with quiet():
                good, pages = cv2.imdecodemulti(
                    np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED
                )
        except cv2.error:
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
        except cv2.error:
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
    order = "<" if content[:2] == b"II" else ">"
    pages: list[tuple[int, tuple[int, int]]] = []
    try:
        (start,) = struct.unpack_from(order + "I", content, 4)
        for index in range(_MOST_PAGES):
            if not start:
                break
            (count,) = struct.unpack_from(order + "H", content, start)
            tags = {}
            for i in range(count):
                place = start + 2 + 12 * i
                tag, kind = struct.unpack_from(order + "HH", content, place)
                form = "H" if kind == 3 else "I"
                (tags[tag],) = struct.unpack_from(order + form, content, place + 8)
            if not tags.get(_REDUCED, 0) & 1:
                pages.append((index, (tags.get(256, 0), tags.get(257, 0))))
            (start,) = struct.unpack_from(order + "I", content, start + 2 + 12 * count)
    except struct.error:
        pass  # the decoder names what is damaged
    return [index for index, size in pages if size == pages[0][1]] or [0]


def _gif_frames(content: bytes) -> int:
    """The number of pictures in a GIF, at most 2."""
    try:
        flags = content[10]
        place = 13 + (3 << ((flags & 7) + 1) if flags & 0x80 else 0)
        frames = 0
        while frames < 2:
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
