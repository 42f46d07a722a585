"""The modes of several sets of hypotheses, ranked by density."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Integers, Mode, Record


class RankedModes(Record, frozen=True):
    """The modes of all sets, densest first, with the bandwidth and the assignments of each set.

    ``assignments`` are the index of the mode that each hypothesis converges to, -1 for none.
    """

    modes: tuple[Mode, ...]
    bandwidths: tuple[float, ...]
    assignments: tuple[Integers, ...]


def rank_modes(
    modes: Sequence[Mode],
    bandwidths: Sequence[float],
    assigned: Sequence[Integers],
) -> RankedModes:
    """Sort modes by density; ``assigned`` are indices into ``modes``, -1 for none."""
    order = sorted(range(len(modes)), key=lambda i: -modes[i].kde)
    rank = np.full(len(modes) + 1, -1)
    rank[order] = np.arange(len(modes))
    return RankedModes(
        tuple(modes[i] for i in order),
        tuple(bandwidths),
        tuple(rank[index].astype(np.int64) for index in assigned),
    )
