"""The video of a finished clip: its frames are read again, one by one, and drawn upon."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from mssegment.clips.frames import ClipFrame, frames_of
from mssegment.clips.store import ClipStore
from mssegment.documents.clips import ClipDocument
from mssegment.imaging.pictures import to_rgb, white_level
from mssegment.imaging.streams import Clip, in_background
from mssegment.progress import track
from mssegment.records import Floats
from mssegment.rendering.clip_frames import TRAIL_FRAMES, ShownObject, draw_frame
from mssegment.rendering.report import Picture
from mssegment.rendering.video import write_stream

DEFAULT_RATE = 10
"""Frames a second of a source without times."""


def write_video(clip: Clip, document: ClipDocument, store: ClipStore, path: Path) -> str:
    """Write the annotated video of a clip; what it is, in words."""
    rate = Fraction(document.rate or DEFAULT_RATE).limit_denominator(1001)
    drawn = in_background(draw_clip(clip, document, store))
    codec = write_stream((picture for _, picture in drawn), rate, path)
    return (
        f"{path.name}: {document.frames} frames of {document.width}x{document.height} pixels, "
        f"{float(rate):.4g} a second, {codec}"
    )


def draw_clip(
    clip: Clip, document: ClipDocument, store: ClipStore, only: Collection[int] | None = None
) -> Iterator[tuple[int, Picture]]:
    """The annotated frames with their numbers; all, or ``only`` some, which are drawn alone."""
    before: deque[dict[int, Floats]] = deque(maxlen=TRAIL_FRAMES)
    pairs = zip(clip.frames(), frames_of(store, len(document.windows)), strict=False)
    for (_, stored), seen in track(pairs, "frames of the video", document.frames):
        before.append(dict(zip(seen.tracks.tolist(), seen.points, strict=True)))
        if only is not None and seen.number not in only:
            continue
        picture = np.ascontiguousarray(to_rgb(stored, white_level(stored))[..., ::-1])
        still = seen.points[seen.identities == 0]
        yield seen.number, draw_frame(picture, still, shown_objects(seen, list(before)))


def shown_objects(seen: ClipFrame, before: list[dict[int, Floats]]) -> list[ShownObject]:
    """The objects of a frame, with trails from the positions in the frames ``before``."""
    found = []
    for identity in np.unique(seen.identities[seen.identities > 0]).tolist():
        own = np.flatnonzero(seen.identities == identity)
        resting = identity in seen.resting
        trails = () if resting else tuple(_trail(int(t), before) for t in seen.tracks[own])
        found.append(ShownObject(identity, seen.points[own], trails, resting))
    return found


def _trail(number: int, before: list[dict[int, Floats]]) -> Floats:
    """The positions [k, 2] of a track in the last frames, without a break."""
    places: list[Floats] = []
    for frame in reversed(before):
        if number not in frame:
            break
        places.append(frame[number])
    return np.array(places[::-1])
