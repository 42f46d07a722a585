"""Mean shift for many points: kernel sums over a sample, in memory bounded by the user.

The cost is linear in the number of points. The sample (4000 points) is clustered exactly. Every
other point climbs the density of the sample, in which it counts as one more point, and is adopted
by the first mode that it comes near to. The large modes are then polished on all points.
What gathers no weight from the sample belongs nowhere (label -1).
"""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import PreparedPoints
from mssegment.meanshift.ascent import Ascent, Mask
from mssegment.meanshift.search import ISOLATED, WAY_TOLERANCE, Found, Search
from mssegment.records import Floats, Integers

SAMPLE = 4000
ADOPT_WITHIN = 0.5
"""A trajectory this near (in bandwidths) to a mode of the sample ends there."""
LARGE = 0.005
"""The share of the points that makes a mode large enough to be polished on all of them."""
MOST_CHECKED = 500
"""So many new modes of a chunk at most are looked at in the wider sample."""
COPIES = 12
"""Arrays of the size of the starts that live at once while a chunk climbs."""


class _Adoption:
    """The modes found so far, and which of them each trajectory of a chunk came near to."""

    def __init__(self, search: Search, modes: Floats, count: int) -> None:
        within = ADOPT_WITHIN * search.bandwidth
        self.prepare = search.manifold.prepare(modes, within, precise=False, reach=1.0)
        self.by = np.full(count, -1)

    def __call__(self, ascent: Ascent, moving: Integers) -> Mask:
        """Adopt what is near enough; returns what is not."""
        for start in range(0, len(moving), self.prepare.rows):
            block = moving[start : start + self.prepare.rows]
            z = self.prepare.block(ascent.x[block]).scaled_sq_dist
            nearest = np.argmin(z, axis=1)
            near = z[np.arange(len(block)), nearest] < 1.0
            self.by[block[near]] = nearest[near]
        return np.asarray(self.by[moving] < 0)


def find_by_sample(
    search: Search, points: Floats, rng: np.random.Generator, memory_mb: float
) -> Found:
    """The modes of many ``points`` [n, ...] by a sample of them.

    ``memory_mb`` bounds what is allocated besides the points and the result.
    """
    sample = np.sort(rng.choice(len(points), SAMPLE, replace=False))
    found = search.find(points[sample], rng)
    social = found.densities * SAMPLE >= 1.0 + ISOLATED
    modes, densities = found.modes[social], found.densities[social]
    wider = np.sort(rng.choice(len(points), min(len(points), 4 * SAMPLE), replace=False))
    number = np.where(social, np.cumsum(social) - 1, -1)
    labels = np.full(len(points), -1)
    labels[sample] = number[found.labels]
    rest = np.setdiff1d(np.arange(len(points)), sample, assume_unique=True)
    prepared = search.prepare(points[sample]), search.prepare(points[wider])
    chunk = max(1000, int(memory_mb * 1e6 / (COPIES * points[0].nbytes)))
    for start in range(0, len(rest), chunk):
        some = rest[start : start + chunk]
        labels[some], new, of_new = _climb_on_sample(search, *prepared, points[some], modes)
        modes, densities = np.concatenate([modes, new]), np.concatenate([densities, of_new])
    return _polish_large(search, points, Found(modes, densities, labels, found.way), memory_mb)


def _climb_on_sample(
    search: Search, sample: PreparedPoints, wider: PreparedPoints, starts: Floats, modes: Floats
) -> tuple[Integers, Floats, Floats]:
    """The mode of each of ``starts``: an index into ``modes`` and the new ones, which follow.

    The densest new ones climb on in a ``wider`` sample, since many are there only because the
    sample is thin. Returns the indices, the new modes and their densities.
    """
    adoption = _Adoption(search, modes, len(starts))
    way = search.climb(sample, starts, WAY_TOLERANCE, thin=adoption, own=True)
    labels = adoption.by
    own_way = (labels < 0) & (way.density * sample.size >= 1.0 + ISOLATED)
    adoption(way, np.flatnonzero(own_way))
    ends = np.flatnonzero(own_way & (labels < 0))
    new, density, joined = search.merge(way.x[ends], way.density[ends], search.merge_within)
    wider_adoption = _Adoption(search, modes, min(len(new), MOST_CHECKED))
    search.climb(wider, new[:MOST_CHECKED], WAY_TOLERANCE, thin=wider_adoption)
    kept = np.ones(len(new), dtype=bool)
    kept[:MOST_CHECKED] = wider_adoption.by < 0
    place = len(modes) + np.cumsum(kept) - 1
    place[~kept] = wider_adoption.by[wider_adoption.by >= 0]
    labels[ends] = place[joined]
    return labels, new[kept], density[kept]


def _polish_large(search: Search, points: Floats, found: Found, memory_mb: float) -> Found:
    """Climb from the large modes on all points (or as many as the memory has room for)."""
    counts = np.bincount(found.labels[found.labels >= 0], minlength=len(found.modes))
    large = counts >= LARGE * len(points)
    room = int(memory_mb * 1e6 / (8 * search.manifold.numbers_per_prepared_point))
    some = points if len(points) <= room else points[:: -(-len(points) // room)]
    x, density, joined = search.polish(some, found.modes[large])
    place = np.empty(len(counts), dtype=np.int64)
    place[large] = joined
    place[~large] = len(x) + np.arange(np.sum(~large))
    modes = np.concatenate([x, found.modes[~large]])
    densities = np.concatenate([density, found.densities[~large]])
    labels = np.where(found.labels >= 0, place[found.labels], -1)
    return Found(modes, densities, labels, found.way)
