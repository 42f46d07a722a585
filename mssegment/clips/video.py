"""The video of a finished clip: its frames are read again, one by one, and drawn upon."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from mssegment.clips.frames import ClipFrame, frames_of
from mssegment.clips.store import ClipStore
from mssegment.clips.track_clip import TrackClip
from mssegment.documents.clips import ClipDocument
from mssegment.imaging.pictures import to_rgb, white_level
from mssegment.imaging.streams import Clip, in_background
from mssegment.progress import track
from mssegment.records import Floats, replace
from mssegment.rendering.clip_frames import TRAIL_FRAMES, ShownObject, draw_frame
from mssegment.rendering.layout import BLANK, MAX_LONG_SIDE
from mssegment.rendering.report import Picture
from mssegment.rendering.video import write_stream

DEFAULT_RATE = 10
"""Frames a second of a source without times."""


def write_video(
    clip: Clip | TrackClip, document: ClipDocument, store: ClipStore, path: Path
) -> str:
    """Write the annotated video of a clip; what it is, in words."""
    rate = Fraction(document.rate or DEFAULT_RATE).limit_denominator(1001)
    drawn = in_background(draw_clip(clip, document, store))
    codec = write_stream((picture for _, picture in drawn), rate, path)
    width, height = (round(scale_of(clip, document) * side) for side in _size(document))
    return (
        f"{path.name}: {document.frames} frames of {width}x{height} pixels, "
        f"{float(rate):.4g} a second, {codec}"
    )


def draw_clip(
    clip: Clip | TrackClip,
    document: ClipDocument,
    store: ClipStore,
    only: Collection[int] | None = None,
) -> Iterator[tuple[int, Picture]]:
    """The annotated frames with their numbers; all, or ``only`` some, which are drawn alone.

    Tracks without pictures are drawn on a plain one.
    """
    before: deque[dict[int, Floats]] = deque(maxlen=TRAIL_FRAMES)
    scale = scale_of(clip, document)
    width, height = (max(2, round(scale * side)) for side in _size(document))
    pairs = zip(clip.pictures(only), frames_of(store, len(document.windows)), strict=False)
    for stored, seen in track(pairs, "frames of the video", document.frames):
        seen = replace(seen, points=scale * seen.points)
        before.append(dict(zip(seen.tracks.tolist(), seen.points, strict=True)))
        if only is not None and seen.number not in only:
            continue
        if stored is None:
            picture = np.full((height, width, 3), BLANK, dtype=np.uint8)
        else:
            picture = np.ascontiguousarray(to_rgb(stored, white_level(stored))[..., ::-1])
        still = seen.points[seen.identities == 0]
        yield seen.number, draw_frame(picture, still, shown_objects(seen, list(before)))


def scale_of(clip: Clip | TrackClip, document: ClipDocument) -> float:
    """By how much positions are scaled where they are drawn: by 1 on pictures."""
    if isinstance(clip, Clip) or clip.on_pictures:
        return 1.0
    return min(1.0, MAX_LONG_SIDE / max(_size(document)))


def _size(document: ClipDocument) -> tuple[int, int]:
    return document.width, document.height


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
