"""Find and open the frames: pictures, folders, globs, videos, or the frames of a document."""

from __future__ import annotations

import functools
import glob
import hashlib
import math
import os
import re
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import overload

import cv2
import numpy as np

from mssegment.errors import DataError, UsageError
from mssegment.imaging import pictures
from mssegment.imaging.pictures import Colour, Grey, Pixels
from mssegment.imaging.videos import Video
from mssegment.records import Frame, Record

CACHE_BYTES = 256 * 2**20
"""Decoded pictures are kept up to this many bytes; beyond it they are decoded again."""


KEPT_GREYS = 4


class _Decoded:
    """The pictures decoded last, up to ``most`` bytes."""

    def __init__(self, most: float = CACHE_BYTES) -> None:
        self._pictures: OrderedDict[Frame, Pixels] = OrderedDict()
        self._bytes = 0
        self._most = most

    def get(self, frame: Frame) -> Pixels | None:
        if frame in self._pictures:
            self._pictures.move_to_end(frame)
        return self._pictures.get(frame)

    def keep(self, frame: Frame, picture: Pixels) -> None:
        self._bytes += picture.nbytes - (p.nbytes if (p := self.get(frame)) is not None else 0)
        self._pictures[frame] = picture
        while len(self._pictures) > 1 and self._bytes > self._most:
            self._bytes -= self._pictures.popitem(last=False)[1].nbytes


class FrameSource:
    """An ordered set of frames of one size, whose pictures are decoded when asked for.

    ``frames`` are the records that go into a document. ``grey(i)`` is the picture that corners
    and matchers work on, ``colour(i)`` the one to draw on.
    """

    def __init__(self, frames: Sequence[Frame], decoded: _Decoded | None = None) -> None:
        self.frames = tuple(frames)
        self._videos: dict[str, Video] = {}
        self._decoded = decoded if decoded is not None else _Decoded()
        self._white: float | None = None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of every frame, pixels."""
        return self.frames[0].width, self.frames[0].height

    def grey(self, index: int) -> Grey:
        """Frame ``index`` as float32 [height, width], 0 to 255."""
        picture = self.pixels(index)
        return pictures.to_grey(picture, self._white_level(picture))

    def greys(self) -> Sequence[Grey]:
        """Every frame, grey, each made when it is asked for: a long video need not fit memory."""
        return _Greys(self, range(len(self)))

    def colour(self, index: int) -> Colour:
        """Frame ``index`` as uint8 [height, width, 3], red first."""
        picture = self.pixels(index)
        return pictures.to_colour(picture, self._white_level(picture))

    def pixels(self, index: int) -> Pixels:
        """Frame ``index`` as it is stored; ``DataError`` where its file changed or vanished."""
        frame = self.frames[index]
        picture = self._decoded.get(frame)
        if picture is None:
            picture = self._decode(frame)
            self._decoded.keep(frame, picture)
        return picture

    def _white_level(self, picture: Pixels) -> float:
        """One level for all 16-bit frames: a level for each would make the light flicker."""
        if picture.dtype == np.uint8:
            return 255.0
        if self._white is None:
            deep = (self.pixels(index) for index in range(len(self)))
            self._white = pictures.white_level(next(p for p in deep if p.dtype != np.uint8))
        return self._white

    def _decode(self, frame: Frame) -> Pixels:
        if frame.index is not None:
            if frame.path not in self._videos:
                _check_sha256(frame, pictures.sha256(frame.path))
                self._videos[frame.path] = Video(frame.path)
            picture = self._videos[frame.path].read(frame.index)
        else:
            content = pictures.read_bytes(frame.path)
            _check_sha256(frame, hashlib.sha256(content).hexdigest())
            picture = pictures.decode(frame.path, content)
        height, width = picture.shape[:2]
        if (width, height) != (frame.width, frame.height):
            raise DataError(
                f"{frame.path}: {width}x{height} pixels, but the document says "
                f"{frame.width}x{frame.height}; run `mssegment detect` again"
            )
        return picture


class _Greys(Sequence[Grey]):
    """The grey pictures of some frames; the last few asked for are kept."""

    def __init__(self, source: FrameSource, indices: range) -> None:
        self._indices = indices
        self._grey = functools.lru_cache(maxsize=KEPT_GREYS)(source.grey)

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, index: int) -> Grey: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Grey]: ...
    def __getitem__(self, index: int | slice) -> Grey | Sequence[Grey]:
        if isinstance(index, slice):
            return [self._grey(i) for i in self._indices[index]]
        return self._grey(self._indices[index])


def _check_sha256(frame: Frame, found: str) -> None:
    if frame.sha256 and frame.sha256 != found:
        raise DataError(
            f"{frame.path}: SHA-256 {found[:12]}..., but the document was made from "
            f"{frame.sha256[:12]}...; put the same file there, or run `mssegment detect` again"
        )


class _Range(Record, frozen=True):
    """Which frames of a video, or of the list of pictures, are wanted."""

    start: int
    stop: int | None
    step: int

    @classmethod
    def checked(cls, start: int | None, stop: int | None, step: int | None) -> _Range:
        first, by = start or 0, 1 if step is None else step
        if first < 0:
            raise UsageError(f"start is {first}, expected a frame number from 0")
        if by < 1:
            raise UsageError(f"step is {by}, expected 1 or more")
        if stop is not None and stop <= first:
            raise UsageError(f"stop is {stop}, expected a number above start ({first})")
        return cls(first, stop, by)

    def __str__(self) -> str:
        stop = "end" if self.stop is None else self.stop
        return f"start {self.start}, stop {stop}, step {self.step}"


def open_frames(
    inputs: Sequence[str],
    start: int | None = None,
    stop: int | None = None,
    step: int | None = None,
    *,
    at_least: int = 2,
) -> FrameSource:
    """Open pictures, folders of pictures, globs and video files as one sequence of frames.

    ``start`` (from 0), ``stop`` (exclusive) and ``step`` choose frame numbers of each video, and
    positions in the list of all pictures, which folders and globs bring in natural order
    (frame-2 before frame-10). Every picture is decoded once, so that a broken one is named here.

    Raises ``DataError`` where a file is missing, empty, cut short or no picture, where sizes
    differ, where the range holds nothing, or for fewer than ``at_least`` frames.
    """
    chosen = _Range.checked(start, stop, step)
    if not inputs:
        raise UsageError("no pictures given; expected files, a folder, a glob or a video")
    paths = [path for given in inputs for path in _expand(given)]
    are_videos = {path: not _is_picture(path) for path in dict.fromkeys(paths)}
    stills = [path for path in paths if not are_videos[path]]
    wanted = set(range(len(stills))[chosen.start : chosen.stop : chosen.step])
    decoded = _Decoded()
    frames: list[Frame] = []
    still = 0
    for path in paths:
        if are_videos[path]:
            frames.extend(_open_video(path, chosen, decoded))
        else:
            if still in wanted:
                frames.append(_open_picture(path, decoded))
            still += 1
    _check_sizes(frames)
    if len(frames) < at_least:
        raise DataError(
            f"{', '.join(inputs)}: {len(frames)} frame{'s' * (len(frames) != 1)} ({chosen}), "
            f"expected at least {at_least}; name more pictures or widen the range"
        )
    return FrameSource(frames, decoded)


def reopen_frames(frames: Sequence[Frame], folder: str | None = None) -> FrameSource:
    """Open the frames that a document names, checked against their SHA-256 when decoded.

    A relative path is looked for as given, then in ``folder`` (that of the document). Raises
    ``DataError`` at once where a file is missing.
    """
    found: list[Frame] = []
    for frame in frames:
        path = frame.path
        if not os.path.exists(path) and folder and os.path.exists(os.path.join(folder, path)):
            path = os.path.join(folder, path)
        if not os.path.exists(path):
            raise DataError(
                f"{frame.path}: the document was made from this file and it is not here; "
                "run from the folder where it was made, or copy the pictures there"
            )
        found.append(Frame(path, frame.width, frame.height, frame.sha256, frame.index))
    return FrameSource(found)


def frames_in_memory(frames: Sequence[Frame], pixels: Sequence[Pixels]) -> FrameSource:
    """Pictures that are decoded already (blue first, as OpenCV has them) under their ``frames``.

    Raises ``DataError`` where their sizes differ.
    """
    _check_sizes(frames)
    decoded = _Decoded(math.inf)  # what has no file cannot be decoded again
    for frame, picture in zip(frames, pixels, strict=True):
        decoded.keep(frame, picture)
    return FrameSource(frames, decoded)


def _expand(given: str) -> list[str]:
    """The files that one argument stands for."""
    if os.path.isdir(given):
        inside = [
            os.path.join(given, name)
            for name in os.listdir(given)
            if Path(name).suffix.lower() in pictures.PICTURE_SUFFIXES and not name.startswith(".")
        ]
        if not inside:
            raise DataError(f"{given}: no pictures in this folder (PNG, JPEG, TIFF, BMP, ...)")
        return sorted(inside, key=_natural)
    if not os.path.exists(given) and glob.has_magic(given):
        matching = [path for path in glob.glob(given, recursive=True) if os.path.isfile(path)]
        if not matching:
            raise DataError(f"{given}: no file matches this pattern")
        return sorted(matching, key=_natural)
    return [given]


def _natural(path: str) -> list[tuple[int, int, str]]:
    """Sort key under which numbers inside names count as numbers."""
    parts = re.split(r"(\d+)", path)
    return [(1, int(p), p) if p.isdecimal() else (0, 0, p) for p in parts]


def _is_picture(path: str) -> bool:
    """Whether to decode a file as a picture; anything else is tried as a video."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(512)
    except OSError:
        return True  # reading it will say what is wrong
    if not head or pictures.looks_like_picture(path, head):
        return True
    if _is_text(head):  # FFmpeg would play it as a film of letters
        raise DataError(
            f"{path}: a text file, expected a picture or a video "
            "(PNG, JPEG, TIFF, BMP, PGM, WebP; MP4, AVI, ...)"
        )
    with pictures.quiet():
        return bool(cv2.haveImageReader(path))


def _is_text(head: bytes) -> bool:
    """Whether the first bytes are letters, digits and spaces throughout."""
    return all(32 <= byte < 127 or byte in b"\t\n\r\f" for byte in head)


def _open_picture(path: str, decoded: _Decoded) -> Frame:
    content = pictures.read_bytes(path)
    picture = pictures.decode(path, content)
    height, width = picture.shape[:2]
    frame = Frame(path, width, height, hashlib.sha256(content).hexdigest())
    decoded.keep(frame, picture)
    return frame


def _open_video(path: str, chosen: _Range, decoded: _Decoded) -> list[Frame]:
    digest = pictures.sha256(path)
    frames = []
    for index, picture in Video(path).select(chosen.start, chosen.stop, chosen.step):
        height, width = picture.shape[:2]
        frames.append(Frame(path, width, height, digest, index))
        decoded.keep(frames[-1], picture)
    if not frames:
        raise DataError(f"{path}: the video has no frame in the range ({chosen}); widen it")
    return frames


def _check_sizes(frames: Sequence[Frame]) -> None:
    for frame in frames[1:]:
        if (frame.width, frame.height) != (frames[0].width, frames[0].height):
            raise DataError(
                f"frames differ in size: {frames[0].path} has {frames[0].width}x"
                f"{frames[0].height} pixels, {frame.path} has {frame.width}x{frame.height}; "
                "use pictures of one size"
            )
