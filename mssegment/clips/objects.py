"""The objects of a clip: from which frame to which each moves or stands still."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from mssegment.documents.clips import ClipObject, WindowDocument, WindowTracks
from mssegment.records import State, field


class _Seen(State):
    moving: list[tuple[int, int]] = field(default_factory=list)
    resting: list[tuple[int, int]] = field(default_factory=list)
    tracks: int = 0
    last_track: int = -1
    largest: int = 0
    origin: int | None = None
    merged_into: int | None = None


def objects_of(windows: Iterable[tuple[WindowDocument, WindowTracks]]) -> list[ClipObject]:
    """Summarize the windows of a clip, in their order; the objects by number."""
    seen: dict[int, _Seen] = {}
    for document, tracks in windows:
        for motion in document.motions:
            if motion.identity < 0:
                continue
            one = seen.setdefault(motion.identity, _Seen())
            _extend(one.moving, motion.first, motion.last)
            one.largest = max(one.largest, motion.tracks)
            one.merged_into = None
        for identity in document.resting:
            one = seen.setdefault(identity, _Seen())
            own = tracks.identity == identity
            if own.any():
                last = int((tracks.first + tracks.length)[own].max()) - 1
                _extend(one.resting, int(tracks.first[own].min()), last)
            one.merged_into = None
        for child, parent in document.origins.items():
            seen[child].origin = parent
        for child, other in document.merged.items():
            seen.setdefault(child, _Seen()).merged_into = other
        _count_tracks(seen, tracks)
    return [
        _object(identity, seen[identity]) for identity in sorted(seen) if _shown(seen[identity])
    ]


def _shown(one: _Seen) -> bool:
    return bool(one.moving or one.resting)


def _object(identity: int, one: _Seen) -> ClipObject:
    periods = [*one.moving, *one.resting]
    return ClipObject(
        identity=identity,
        first=min(first for first, _ in periods),
        last=max(last for _, last in periods),
        moving=one.moving,
        resting=one.resting,
        tracks=one.tracks,
        largest=one.largest,
        origin=one.origin,
        merged_into=one.merged_into,
    )


def _extend(periods: list[tuple[int, int]], first: int, last: int) -> None:
    """Append a period, or lengthen the last one if they touch."""
    if periods and first <= periods[-1][1] + 1:
        periods[-1] = (min(first, periods[-1][0]), max(last, periods[-1][1]))
    else:
        periods.append((first, last))


def _count_tracks(seen: dict[int, _Seen], tracks: WindowTracks) -> None:
    """Count the tracks that no earlier window had; they are numbered in their order."""
    for identity in np.unique(tracks.identity[tracks.identity >= 0]).tolist():
        one = seen.get(identity)
        if one is not None:
            own = np.unique(tracks.track[tracks.identity == identity])
            one.tracks += int((own > one.last_track).sum())
            one.last_track = max(one.last_track, int(own.max()))
