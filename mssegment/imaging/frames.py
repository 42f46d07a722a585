"""Find and open frames: pictures, folders, globs, videos, or the frames of a document."""

from __future__ import annotations

import functools
import hashlib
import math
import os
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, overload

import cv2
import numpy as np

from mssegment.errors import DataError, UsageError
from mssegment.imaging import pictures
from mssegment.imaging.pictures import GreyPicture, RgbPicture, StoredPicture
from mssegment.imaging.sources import expand
from mssegment.imaging.stacks import Stack, is_stack
from mssegment.inputs.standard_error import quiet
from mssegment.progress import track
from mssegment.records import Frame, Record, replace

if TYPE_CHECKING:
    from mssegment.imaging.videos import Video

CACHE_BYTES = 256 * 2**20
"""Decoded pictures are kept up to this many bytes; others are decoded again."""
CACHED_GREYS = 4
"""Grey pictures that are kept, of a sequence that is read frame by frame."""


class _PictureCache:
    """The most recently used decoded pictures, up to ``limit`` bytes."""

    def __init__(self, limit: float = CACHE_BYTES) -> None:
        self._pictures: OrderedDict[Frame, StoredPicture] = OrderedDict()
        self._bytes = 0
        self._limit = limit

    def get(self, frame: Frame) -> StoredPicture | None:
        if frame in self._pictures:
            self._pictures.move_to_end(frame)
        return self._pictures.get(frame)

    def keep(self, frame: Frame, picture: StoredPicture) -> None:
        self._bytes += picture.nbytes - (p.nbytes if (p := self.get(frame)) is not None else 0)
        self._pictures[frame] = picture
        while len(self._pictures) > 1 and self._bytes > self._limit:
            self._bytes -= self._pictures.popitem(last=False)[1].nbytes


class FrameSource:
    """A sequence of frames of one size, or two views, decoded on demand.

    ``grey(i)`` is the picture for corners and matchers, ``colour(i)`` the one to draw on.

    Parameters
    ----------
    frames : sequence of Frame
        The records of the frames, as they go into a document.
    decoded : optional
        Pictures that are decoded already.
    notes : tuple of str
        What was assumed or left out, for the user.
    """

    def __init__(
        self,
        frames: Sequence[Frame],
        decoded: _PictureCache | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        self.frames = tuple(frames)
        self.notes = notes
        self._moving: dict[str, Video | Stack] = {}
        self._decoded = decoded if decoded is not None else _PictureCache()
        self._white: float | None = None

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the first frame, pixels."""
        return self.frames[0].width, self.frames[0].height

    def grey(self, index: int) -> GreyPicture:
        """Frame ``index`` as float32 [height, width], 0 to 255."""
        picture = self.pixels(index)
        return pictures.to_grey(picture, self._white_level(picture))

    def greys(self) -> Sequence[GreyPicture]:
        """All frames in grey, decoded on demand: a long video need not fit into memory."""
        return _Greys(self, range(len(self)))

    def colour(self, index: int) -> RgbPicture:
        """Frame ``index`` as uint8 [height, width, 3] in RGB order."""
        picture = self.pixels(index)
        return pictures.to_rgb(picture, self._white_level(picture))

    def pixels(self, index: int) -> StoredPicture:
        """Frame ``index`` as stored; raises DataError if its file has changed or is missing."""
        frame = self.frames[index]
        picture = self._decoded.get(frame)
        if picture is None:
            picture = self._decode(frame)
            self._decoded.keep(frame, picture)
        return picture

    def _white_level(self, picture: StoredPicture) -> float:
        """One level for all 16-bit frames: a level for each would make the brightness flicker."""
        if picture.dtype == np.uint8:
            return 255.0
        if self._white is None:
            deep = (self.pixels(index) for index in range(len(self)))
            self._white = pictures.white_level(next(p for p in deep if p.dtype != np.uint8))
        return self._white

    def _decode(self, frame: Frame) -> StoredPicture:
        if frame.index is not None:
            if frame.path not in self._moving:
                _check_sha256(frame, pictures.sha256(frame.path))
                self._moving[frame.path] = _moving(frame.path)
            picture = self._moving[frame.path].read(frame.index)
        else:
            content = pictures.read_bytes(frame.path)
            _check_sha256(frame, hashlib.sha256(content).hexdigest())
            picture = pictures.decode(frame.path, content)
        height, width = picture.shape[:2]
        if (width, height) != (frame.width, frame.height):
            raise DataError(
                f"{frame.path}: {width}x{height} pixels, expected {frame.width}x{frame.height} as "
                "in the document; run `mssegment detect` again"
            )
        return picture


class _Greys(Sequence[GreyPicture]):
    """The grey pictures of some frames; the most recently used are cached."""

    def __init__(self, source: FrameSource, indices: range) -> None:
        self._indices = indices
        self._grey = functools.lru_cache(maxsize=CACHED_GREYS)(source.grey)

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, index: int) -> GreyPicture: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[GreyPicture]: ...
    def __getitem__(self, index: int | slice) -> GreyPicture | Sequence[GreyPicture]:
        if isinstance(index, slice):
            return [self._grey(i) for i in self._indices[index]]
        return self._grey(self._indices[index])


def _check_sha256(frame: Frame, found: str) -> None:
    if frame.sha256 and frame.sha256 != found:
        raise DataError(
            f"{frame.path}: SHA-256 {found[:12]}..., expected {frame.sha256[:12]}... as in the "
            "document; restore the original file, or run `mssegment detect` again"
        )


class _Range(Record, frozen=True):
    """Selected frames of a video, or of the list of pictures."""

    start: int
    stop: int | None
    step: int

    @classmethod
    def checked(cls, start: int | None, stop: int | None, step: int | None) -> _Range:
        first, by = start or 0, 1 if step is None else step
        if first < 0:
            raise UsageError(f"start is {first}, expected 0 or more")
        if by < 1:
            raise UsageError(f"step is {by}, expected 1 or more")
        if stop is not None and stop <= first:
            raise UsageError(f"stop is {stop}, expected more than start ({first})")
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
    """Open pictures, folders of pictures, patterns and video files as one sequence of frames.

    Animated pictures and stacks (GIF, WebP, PNG, TIFF) are videos.

    Every picture is decoded once here, so that a damaged one is reported before work starts.

    Parameters
    ----------
    inputs : sequence of str
        Paths and patterns, as in ``sources.expand``.
    start, stop, step : int, optional
        Select frames start, start + step, ... before stop, from 0: of the frame numbers of each
        video, and of the list of all pictures.
    at_least : int
        Smallest number of frames.

    Returns
    -------
    FrameSource

    Raises
    ------
    UsageError
        If there are no inputs, or ``start``, ``stop`` and ``step`` are no range.
    DataError
        If a file is missing, empty, damaged or no picture, if the sizes of more than two frames
        differ, or if fewer than ``at_least`` frames are selected.
    """
    chosen = _Range.checked(start, stop, step)
    if not inputs:
        raise UsageError("no pictures given; name picture files, a folder, a glob or a video")
    expanded = [expand(given) for given in inputs]
    paths = [path for found, _ in expanded for path in found]
    notes = [note for _, own in expanded for note in own]
    are_moving = {path: is_moving(path) for path in dict.fromkeys(paths)}
    stills = [path for path in paths if not are_moving[path]]
    wanted = set(range(len(stills))[chosen.start : chosen.stop : chosen.step])
    decoded = _PictureCache()
    frames: list[Frame] = []
    still = 0
    for path in track(paths, "files"):
        if are_moving[path]:
            frames.extend(_open_moving(path, chosen, decoded, notes))
        else:
            if still in wanted:
                frames.append(_open_picture(path, decoded, notes))
            still += 1
    _check_sizes(frames)
    if len(frames) < at_least:
        raise DataError(
            f"{', '.join(inputs)}: {len(frames)} frame{'s' * (len(frames) != 1)} ({chosen}), "
            f"expected at least {at_least}; add pictures or widen the range"
        )
    return FrameSource(frames, decoded, tuple(notes))


def reopen_frames(frames: Sequence[Frame], folder: str | None = None) -> FrameSource:
    """Open the frames that a document refers to.

    Parameters
    ----------
    frames : sequence of Frame
        Their records; the SHA-256 of a file is checked when it is decoded.
    folder : str, optional
        Folder in which relative paths are looked up if they do not exist as given.

    Raises
    ------
    DataError
        If a file is missing.
    """
    found: list[Frame] = []
    for frame in frames:
        path = frame.path
        if not os.path.exists(path) and folder and os.path.exists(os.path.join(folder, path)):
            path = os.path.join(folder, path)
        if not os.path.exists(path):
            raise DataError(
                f"{frame.path}: no such file, but the document refers to it; "
                "run in the folder where the document was made, or copy the pictures there"
            )
        found.append(replace(frame, path=path))
    return FrameSource(found)


def read_once(frames: Sequence[Frame]) -> FrameSource:
    """Frames that are read one after the other: only one decoded picture is kept."""
    return FrameSource(frames, _PictureCache(0))


def frames_in_memory(frames: Sequence[Frame], pixels: Sequence[StoredPicture]) -> FrameSource:
    """A source of decoded pictures, ``pixels`` in grey or BGR order, with their records.

    Raises DataError if their sizes differ.
    """
    _check_sizes(frames)
    decoded = _PictureCache(math.inf)  # what has no file cannot be decoded again
    for frame, picture in zip(frames, pixels, strict=True):
        decoded.keep(frame, picture)
    return FrameSource(frames, decoded)


def _moving(path: str) -> Video | Stack:
    """The reader of a file with several frames: the frames of a video, or a stack of pictures."""
    if not is_video(path):
        return Stack(path)
    from mssegment.imaging.videos import Video  # loads what pictures have no need of

    return Video(path)


def is_video(path: str) -> bool:
    """Whether a file with several frames is a video, rather than a stack of pictures."""
    with Path(path).open("rb") as file:
        head = file.read(512)
    return pictures.is_motion_jpeg(path, head) or not pictures.looks_like_picture(path, head)


def is_moving(path: str) -> bool:
    """Whether a file has several frames: a video, an animation or a stack of pictures.

    Raises DataError for a playlist, which names other files, and for a text file, which FFmpeg
    would decode as a video of characters.
    """
    try:
        with Path(path).open("rb") as file:
            head = file.read(512)
            if pictures.is_motion_jpeg(path, head):
                return True
            is_picture = not head or pictures.looks_like_picture(path, head)
            if is_picture:
                return head.startswith(_MAY_BE_STACKS) and is_stack(pictures.read_bytes(path))
    except OSError:
        return False  # reading it raises the error
    if _is_playlist(head):
        raise DataError(
            f"{path}: a playlist, which names other files or addresses; name the video itself"
        )
    if _is_text(head):
        raise DataError(
            f"{path}: a text file, expected a picture (PNG, JPEG, TIFF, BMP, PGM, WebP) or a video "
            "(MP4, AVI, ...); check the path"
        )
    with quiet():
        return not cv2.haveImageReader(path)


_PLAYLISTS = (
    *(b"#extm3u", b"[playlist]", b"ffconcat", b"file '", b"v=0\r", b"v=0\n", b"<smil", b"<asx"),
    *(b"[reference]", b"rtsptext", b"#!avs"),
)
_MAY_BE_STACKS = (b"\x89PNG", b"GIF8", b"II*\0", b"MM\0*", b"RIFF")


def _is_playlist(head: bytes) -> bool:
    """Whether a file begins as an M3U, PLS, concat, SDP, DASH, SMIL or ASX playlist."""
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    return start.startswith(_PLAYLISTS) or (start.startswith(b"<") and b"<mpd" in start)


def _is_text(head: bytes) -> bool:
    """Whether the first bytes are all printable ASCII or white space."""
    return all(32 <= byte < 127 or byte in b"\t\n\r\f" for byte in head)


def _open_picture(path: str, decoded: _PictureCache, notes: list[str]) -> Frame:
    content = pictures.read_bytes(path)
    picture = pictures.decode(path, content)
    if pictures.is_invisible(picture):
        notes.append(f"{path}: transparent everywhere; its colours are used as if opaque")
    height, width = picture.shape[:2]
    frame = Frame(path, width, height, hashlib.sha256(content).hexdigest())
    decoded.keep(frame, picture)
    return frame


def _open_moving(
    path: str, chosen: _Range, decoded: _PictureCache, notes: list[str]
) -> list[Frame]:
    digest = pictures.sha256(path)
    frames = []
    source = _moving(path)
    selected = source.select(chosen.start, chosen.stop, chosen.step)
    expected = len(range(chosen.start, chosen.stop, chosen.step)) if chosen.stop else None
    for index, seconds, picture in track(selected, "frames", expected):
        height, width = picture.shape[:2]
        # microseconds: what a container does not store exactly must not look exact
        time = None if seconds is None else round(seconds, 6)
        frames.append(Frame(path, width, height, digest, index, time))
        decoded.keep(frames[-1], picture)
    notes.extend(source.notes)
    if not frames:
        raise DataError(f"{path}: no frame in the range ({chosen}); widen the range")
    return frames


def _check_sizes(frames: Sequence[Frame]) -> None:
    """Raises DataError if sizes differ: within a sequence, or between the frames of one video."""
    if len(frames) == 2 and frames[0].path != frames[1].path:
        return  # two views may come from two cameras
    for frame in frames[1:]:
        if (frame.width, frame.height) != (frames[0].width, frames[0].height):
            raise DataError(
                f"frames differ in size: {frames[0].path} has {frames[0].width}x"
                f"{frames[0].height} pixels, {frame.path} has {frame.width}x{frame.height}; "
                "use pictures of one size"
            )
