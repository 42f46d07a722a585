"""Mean shift for many points: kernel sums over a sample, in bounded memory.

The cost is linear in the number of points. The sample (4000 points) is clustered as usual. Every
other point ascends the density of the sample, in which it counts as one more point, and is assigned
to the first mode that its trajectory comes near to. The large modes are then refined on all points.
A point whose trajectory gathers no weight from the sample gets the label -1.
"""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import PreparedPoints
from mssegment.meanshift.search import ISOLATED, TRAJECTORY_TOLERANCE, ModeSearch, SearchResult
from mssegment.meanshift.trajectories import Ascent, Mask
from mssegment.records import Floats, Integers

SAMPLE_SIZE = 4000
ASSIGN_WITHIN = 0.5
"""A trajectory is assigned to a mode of the sample that is nearer than this many bandwidths."""
LARGE = 0.005
"""The share of the points from which a mode is refined on all of them."""
MAX_CHECKED = 500
"""The largest number of new modes of a chunk that are checked against a wider sample."""
ARRAYS_PER_CHUNK = 12
"""Arrays of the size of the starts that are alive at once while a chunk is processed."""


class _Assignment:
    """The known modes, and to which of them the trajectories of a chunk are assigned: a ``Prune``.

    ``mode`` [n] is the index of the mode, -1 where there is none.
    """

    def __init__(self, search: ModeSearch, modes: Floats, count: int) -> None:
        within = ASSIGN_WITHIN * search.bandwidth
        self.prepared = search.manifold.prepare(modes, within, precise=False, cutoff=1.0)
        self.mode = np.full(count, -1)

    def __call__(self, ascent: Ascent, active: Integers) -> Mask:
        """Assign what is near enough; the mask of the others."""
        for start in range(0, len(active), self.prepared.block_rows):
            block = active[start : start + self.prepared.block_rows]
            z = self.prepared.block(ascent.x[block]).scaled_sq_dist
            nearest = np.argmin(z, axis=1)
            near = z[np.arange(len(block)), nearest] < 1.0
            self.mode[block[near]] = nearest[near]
        return np.asarray(self.mode[active] < 0)


def find_by_sample(
    search: ModeSearch, points: Floats, rng: np.random.Generator, memory_mb: float
) -> SearchResult:
    """The modes of many points by a sample of them.

    Parameters
    ----------
    search
        The settings.
    points
        The data points [n, ...].
    rng
        Draws the sample.
    memory_mb
        A bound on the memory used besides the points and the result, in megabytes.

    Returns
    -------
    SearchResult
        As of ``ModeSearch.find``; its ``ascent`` is that of the sample.
    """
    sample = np.sort(rng.choice(len(points), SAMPLE_SIZE, replace=False))
    found = search.find(points[sample], rng)
    shared = found.densities * SAMPLE_SIZE >= 1.0 + ISOLATED
    modes, densities = found.modes[shared], found.densities[shared]
    wider = np.sort(rng.choice(len(points), min(len(points), 4 * SAMPLE_SIZE), replace=False))
    number = np.where(shared, np.cumsum(shared) - 1, -1)
    labels = np.full(len(points), -1)
    labels[sample] = number[found.labels]
    rest = np.setdiff1d(np.arange(len(points)), sample, assume_unique=True)
    prepared = search.prepare(points[sample]), search.prepare(points[wider])
    chunk = max(1000, int(memory_mb * 1e6 / (ARRAYS_PER_CHUNK * points[0].nbytes)))
    for start in range(0, len(rest), chunk):
        part = rest[start : start + chunk]
        labels[part], new, new_densities = _ascend_sample(search, *prepared, points[part], modes)
        modes, densities = np.concatenate([modes, new]), np.concatenate([densities, new_densities])
    found = SearchResult(modes, densities, labels, found.ascent)
    return _refine_large(search, points, found, memory_mb)


def _ascend_sample(
    search: ModeSearch, sample: PreparedPoints, wider: PreparedPoints, starts: Floats, modes: Floats
) -> tuple[Integers, Floats, Floats]:
    """The mode of each of ``starts``: an index into ``modes`` followed by the new ones.

    The densest new modes ascend further in a ``wider`` sample, since many exist only because the
    sample is sparse. Returns the indices, the new modes and their densities.
    """
    assignment = _Assignment(search, modes, len(starts))
    ascent = search.ascend(
        sample, starts, TRAJECTORY_TOLERANCE, prune=assignment, include_start=True
    )
    labels = assignment.mode
    unassigned = (labels < 0) & (ascent.density * sample.size >= 1.0 + ISOLATED)
    assignment(ascent, np.flatnonzero(unassigned))
    ends = np.flatnonzero(unassigned & (labels < 0))
    new, density, merged = search.merge(ascent.x[ends], ascent.density[ends], search.merge_within)
    in_wider = _Assignment(search, modes, min(len(new), MAX_CHECKED))
    search.ascend(wider, new[:MAX_CHECKED], TRAJECTORY_TOLERANCE, prune=in_wider)
    kept = np.ones(len(new), dtype=bool)
    kept[:MAX_CHECKED] = in_wider.mode < 0
    place = len(modes) + np.cumsum(kept) - 1
    place[~kept] = in_wider.mode[in_wider.mode >= 0]
    labels[ends] = place[merged]
    return labels, new[kept], density[kept]


def _refine_large(
    search: ModeSearch, points: Floats, found: SearchResult, memory_mb: float
) -> SearchResult:
    """Refine the large modes on all points, or on as many as the memory allows."""
    counts = np.bincount(found.labels[found.labels >= 0], minlength=len(found.modes))
    large = counts >= LARGE * len(points)
    limit = int(memory_mb * 1e6 / (8 * search.manifold.floats_per_prepared_point))
    data = points if len(points) <= limit else points[:: -(-len(points) // limit)]
    x, density, merged = search.refine(data, found.modes[large])
    place = np.empty(len(counts), dtype=np.int64)
    place[large] = merged
    place[~large] = len(x) + np.arange(np.sum(~large))
    modes = np.concatenate([x, found.modes[~large]])
    densities = np.concatenate([density, found.densities[~large]])
    labels = np.where(found.labels >= 0, place[found.labels], -1)
    return SearchResult(modes, densities, labels, found.ascent)
