"""All files of a long clip: its windows, the document, the page, the video, trajectories."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mssegment.clips.exports import write_exports
from mssegment.clips.process import process
from mssegment.clips.segmenter import new_segmenter
from mssegment.clips.store import CLIP, ClipStore
from mssegment.clips.track_clip import TrackClip
from mssegment.clips.video import draw_clip, write_video
from mssegment.configuration import Configuration
from mssegment.documents import write_bytes
from mssegment.documents.clips import ClipDocument, WindowDocument
from mssegment.imaging.streams import Clip
from mssegment.records import Record
from mssegment.rendering.clip_page import encode_jpeg, render_clip_page

PAGE, VIDEO = "report.html", "motions.mp4"
STILLS = 6
"""Annotated frames beside and on the page."""


class ClipResults(Record, frozen=True):
    """The document of a clip, the names of its files, and what is to be said of them.

    ``beside_bytes`` is the peak memory of the process that segmented the windows, if there was one.
    """

    document: ClipDocument
    names: list[str]
    said: list[str]
    beside_bytes: int = 0


def write_results(
    clip: Clip | TrackClip,
    configuration: Configuration,
    folder: Path,
    on_window: Callable[[WindowDocument], None] = lambda window: None,
    *,
    own_process: bool = False,
) -> ClipResults:
    """Segment a clip and write all its files into a folder.

    If the folder holds windows of the same clip, that an interrupted process wrote, they are kept.
    With ``own_process``, windows of pictures are segmented in a process of their own.

    Raises DataError if a frame cannot be read, UsageError if a file cannot be written.
    """
    # a file of tracks leaves the other process nothing to be beside of
    segmenter = new_segmenter(own_process=own_process and not isinstance(clip, TrackClip))
    document = process(clip, configuration, folder, on_window, segmenter)
    store, settings = ClipStore(folder), configuration.report
    names = [CLIP, *(name for i in range(len(document.windows)) for name in store.names(i))]
    said = list(segmenter.said)
    if settings.video:
        said.append(write_video(clip, document, store, folder / VIDEO))
        names.append(VIDEO)
    names += write_exports(document, store, settings.export, folder)
    stills: list[tuple[int, bytes]] = []
    if settings.pictures:
        stills = [
            (number, encode_jpeg(picture))
            for number, picture in draw_clip(clip, document, store, stills_of(document))
        ]
        (folder / "stills").mkdir(exist_ok=True)
    for number, content in stills:
        names.append(f"stills/{number:06d}.jpg")
        write_bytes(str(folder / names[-1]), content)
    if settings.html:
        page = render_clip_page(document, stills, VIDEO if settings.video else None)
        write_bytes(str(folder / PAGE), page.encode())
        names.append(PAGE)
    return ClipResults(document, names, said, segmenter.peak_bytes)


def stills_of(document: ClipDocument) -> list[int]:
    """The frames for the page: of each of some equal pieces that with most moving objects."""
    pieces = min(STILLS, document.frames)
    found = []
    for piece in range(pieces):
        frames = range(piece * document.frames // pieces, (piece + 1) * document.frames // pieces)
        middle = (frames.start + frames.stop) / 2
        found.append(max(frames, key=lambda f: (_moving_in(document, f), -abs(f - middle))))
    return found


def _moving_in(document: ClipDocument, frame: int) -> int:
    """How many objects move in a frame."""
    return sum(
        any(first <= frame <= last for first, last in one.moving)
        for one in document.objects
        if one.identity
    )
