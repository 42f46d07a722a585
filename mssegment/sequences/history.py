"""What tracks have been: the identities of the motions that each belonged to, window by window."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from mssegment.records import Floats, Integers, State

STATIC_WORLD = 0
"""The identity of the static world: the background, or the motion of a moving camera."""


class TrackHistory(State):
    """The identities of tracks over the windows so far.

    Attributes
    ----------
    windows : dict
        For each track, by its number, in how many windows it was of each identity.
    """

    windows: dict[int, dict[int, int]]

    @classmethod
    def empty(cls) -> TrackHistory:
        """No tracks."""
        return cls({})

    def votes(self, tracks: Integers) -> Mapping[int, float]:
        """How many of the ``tracks`` have been of each identity.

        A track that has been of several counts as a fraction for each.
        """
        found: dict[int, float] = {}
        for track in tracks.tolist():
            own = self.windows.get(track)
            if own:
                total = sum(own.values())
                for identity, count in own.items():
                    found[identity] = found.get(identity, 0.0) + count / total
        return found

    def usual(self, tracks: Integers) -> Integers:
        """The identity that each of the ``tracks`` [n] has been most often; -1 for new ones.

        Of those that are equally frequent it is the moving one that was first.
        """
        found = np.full(len(tracks), -1, dtype=np.int64)
        for row, track in enumerate(tracks.tolist()):
            own = self.windows.get(track)
            if own and len(own) == 1:
                (found[row],) = own
            elif own:
                found[row] = max(own, key=lambda i: (own[i], i != STATIC_WORLD, -i))
        return found

    def record(self, tracks: Integers, identities: Integers, paused: Iterable[int] = ()) -> None:
        """Count one more window for each of the ``tracks`` [n]; identities below 0 are none.

        Tracks that are neither among them nor ``paused`` have ended, and are forgotten.
        """
        kept = {track: self.windows[track] for track in paused if track in self.windows}
        for track, identity in zip(tracks.tolist(), identities.tolist(), strict=True):
            own = self.windows.get(track, {})
            if identity >= 0:
                own[identity] = own.get(identity, 0) + 1
            if own:
                kept[track] = own
        self.windows = kept

    def forget(self, tracks: Integers) -> None:
        """What the ``tracks`` have been is not what they are."""
        for track in tracks.tolist():
            self.windows.pop(track, None)


def vote_table(rows: Iterable[Mapping[int, float]], identities: Integers) -> Floats:
    """The votes of each row for each of the ``identities`` [k], as an array [m, k]."""
    wanted = identities.tolist()
    return np.array([[row.get(i, 0.0) for i in wanted] for row in rows]).reshape(-1, len(wanted))
