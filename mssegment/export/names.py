"""The names of files that belong to frames: those of the frames, as far as these differ."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from mssegment.records import Frame


def frame_names(frames: Sequence[Frame], *, suffix: bool = False) -> list[str]:
    """One name per frame, below a common folder, without the suffix of a picture.

    Parameters
    ----------
    frames : sequence of Frame
        The frames: pictures by their file names, with their folders where these differ; frames of
        a video by their number, as ``00000``.
    suffix : bool
        Keep the suffix of a picture, as COLMAP expects it; frames of a video are taken out as PNG.

    Examples
    --------
    >>> frame_names([Frame("a/1.png", 9, 9), Frame("a/2.png", 9, 9)])
    ['1', '2']
    >>> frame_names([Frame("left/1.png", 9, 9), Frame("right/1.png", 9, 9)])
    ['left/1', 'right/1']
    >>> frame_names([Frame("clip.mp4", 9, 9, index=i) for i in (0, 5)])
    ['00000', '00005']
    >>> frame_names([Frame("clip.mp4", 9, 9, index=i) for i in (0, 5)], suffix=True)
    ['00000.png', '00005.png']
    """
    if len({frame.path for frame in frames}) <= 1 or not all(frame.path for frame in frames):
        places = [i if frame.index is None else frame.index for i, frame in enumerate(frames)]
        unique = places if len(set(places)) == len(frames) else list(range(len(frames)))
        # as `ffmpeg -start_number 0 %05d.png` calls the pictures of a video
        return [f"{place:05d}{'.png' * suffix}" for place in unique]
    paths = [_numbered(frame) for frame in frames]
    folders = [path.parent.parts for path in paths]
    shared = _shared_length(folders)
    inside = [PurePath(*path.parts[shared:]) for path in paths]
    bare = [str(path.with_suffix("").as_posix()) for path in inside]
    if suffix or len(set(bare)) < len(set(inside)):
        return [path.as_posix() for path in inside]
    return bare


def _numbered(frame: Frame) -> PurePath:
    """The path of a frame without its drive, with the number of a frame of a video."""
    path = PurePath(frame.path)
    path = path.relative_to(path.anchor) if path.anchor else path
    parts = [part for part in path.parts if part not in ("..", ".")]
    if frame.index is None:
        return PurePath(*parts)
    return PurePath(*parts[:-1], f"{path.stem}-{frame.index:05d}")


def _shared_length(folders: Sequence[Sequence[str]]) -> int:
    """How many leading folders all paths have in common."""
    length = 0
    for parts in zip(*folders, strict=False):
        if len(set(parts)) > 1:
            break
        length += 1
    return length
