"""Background: tracks that are static before a static camera, and therefore not a motion.

The camera is static if the static tracks are distributed over the image: an object at rest covers
only a small part of it. They need not be the majority, because their number depends on texture.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from mssegment.manifolds import Euclidean
from mssegment.meanshift import ascend, kernel_named, shift
from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.preprocessing.noise import MEDIAN_OF_RAYLEIGH, measured_noise
from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers, Record
from mssegment.special import distinct, median, quantile

BANDWIDTH = 2.0
"""Bandwidth in pixels of the mean shift over displacements."""
MAX_SHAKE = 0.005
"""Largest displacement of the whole image, relative to its diagonal, that counts as shake of a
static camera (4 pixels in 640 x 480; a bridge under traffic sways by 2)."""
MIN_DISPLACEMENT = 2.0
"""A track that stays within so many pixels of its start is background, or within more where the
noise of two views is larger."""
STILL = 5.0
"""The same over the standard deviation of the noise: 4 in a million of normal errors are larger,
and some of heavy tails, which their neighbours tell (``_drifting``)."""
SPREAD_ROUNDS = 3
"""Rounds in which the static tracks and their standard deviation are estimated."""
CONCENTRATED = 0.3
"""Largest median distance of static tracks, over a limit that grew with the noise: 0.24 for normal
noise, 0.5 where displacements are spread evenly along a line, 0.7 over an area."""
STATIC_DISTANCE = 1.5
"""A track is static if its distance from its start, without the shake, is below this, in pixels."""
MIN_STATIC_SHARE = 0.15
"""Smallest share of static tracks before a static camera. It is low, because textured objects have
many tracks and a plain wall has few; the distribution of the static tracks is the better test."""
MIN_STATIC_CELLS = 0.4
"""Smallest share of the occupied cells of the grid that contain a static track."""
MIN_STATIC_FRAMES = 0.9
"""Share of its frames in which a background track must be near its start: over many frames a
tracker slips."""
DRIFT_FACTOR, DRIFT_NEIGHBOURS = 2.0, 8
"""See ``_drifting``."""
LEAST_EARLIER = 8
"""Tracks of an earlier background that decide whether the camera is still static."""
GRID_CELLS = 8
"""Cells of the grid along each side of the image."""
MAX_DISPLACEMENTS = 500
"""Maximum number of displacements for mean shift."""
MAX_STEPS = 100
"""Maximum number of mean shift steps."""
TOLERANCE = 1e-4
"""Mean shift ends with a step shorter than this, in bandwidths."""


class Background(Record, frozen=True):
    """The background among the tracks.

    Attributes
    ----------
    status : ndarray [P] of int
        ``BACKGROUND``, or ``OUTLIER`` for tracks to segment.
    notes : tuple of str
        Notes for the user.
    """

    status: Integers
    notes: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether there is a static background, and thus a static camera."""
        return bool((self.status == BACKGROUND).any())


def find_background(
    points: Floats,
    *,
    frame_size: tuple[int, int],
    remove: bool | Literal["auto"] = "auto",
    min_displacement: float | Literal["auto"] = "auto",
    earlier: Flags | None = None,
) -> Background:
    """Find the tracks that belong to a static background.

    A track is background if it stays within ``min_displacement`` of its start in nearly every
    frame, after the shake of the camera is subtracted. It is larger for noisy matches.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    frame_size : tuple of int
        Width and height in pixels.
    remove : bool or "auto"
        Whether to look for a background; ``auto`` only if the camera is static.
    min_displacement : float or "auto"
        Distance in pixels; ``auto`` is ``MIN_DISPLACEMENT``, or more for noisy matches.
    earlier : ndarray [P] of bool, optional
        Tracks that were background in the frames before. If most of them are where they were, the
        camera is static, even if moving objects now cover most of the picture.

    Returns
    -------
    Background

    Examples
    --------
    >>> import numpy as np
    >>> first = np.random.default_rng(0).uniform(0, 100, (50, 2))
    >>> second = first.copy()
    >>> second[:10] += [8.0, 3.0]
    >>> found = find_background(np.stack([first, second], axis=1), frame_size=(100, 100))
    >>> found.notes
    ('background: 40 of 50 tracks are static',)
    """
    status = np.full(len(points), OUTLIER, dtype=np.int64)
    if remove is False or len(points) == 0:
        return Background(status)
    bandwidth = BANDWIDTH if min_displacement == "auto" else min(BANDWIDTH, min_displacement)
    max_shake = MAX_SHAKE * _extent(points, frame_size)
    path = None if earlier is None else path_of_background(points[earlier], max_shake)
    if path is None:
        path = camera_path(points, max_shake, bandwidth)
    distance = distances(points, path)
    limits = _Limits.of_matches(points, distance) if points.shape[1] == 2 else _Limits()
    if min_displacement == "auto":
        min_displacement = limits.displacement
    if remove == "auto":
        static, reason = is_static(points, distance, frame_size, limits.static)
        static = static or _still_static(points, distance, frame_size, earlier, limits.static)
        if not static:
            return Background(status, (f"the camera moves ({reason}): no background removed",))
    visible = np.isfinite(distance).sum(axis=1)
    near = (distance < min_displacement).sum(axis=1)
    static_tracks = np.asarray((visible > 1) & (near >= np.ceil(MIN_STATIC_FRAMES * visible)))
    static_tracks |= _drifting(points, distance, static_tracks)
    status[static_tracks] = BACKGROUND
    note = f"background: {int(static_tracks.sum())} of {len(points)} tracks are static"
    if static_tracks.all():
        note += (
            f": they move less than {min_displacement:.3g} px (background.min_displacement); "
            "smaller motions are not looked for"
        )
    return Background(status, (note,))


def _still_static(
    points: Floats,
    distance: Floats,
    frame_size: Sequence[int],
    earlier: Flags | None,
    limit: float,
) -> bool:
    """Whether the background of ``earlier`` frames, or of most frames, is static in every frame.

    A moving camera moves all of it. Before a static one, some tracks slip to what covers them.
    """
    if earlier is None:
        return False
    static = np.asarray(distance < limit)
    visible = np.isfinite(distance)
    passed = [not reason for reason in _reasons(points, distance, frame_size, limit)]
    known = earlier
    if 2 * sum(passed) > len(passed):
        rows = np.flatnonzero(np.array([True, *passed]))
        usable = visible[:, rows].sum(axis=1) > 1
        known = known | (usable & (static | ~visible)[:, rows].all(axis=1))
    counts, still = visible[known].sum(axis=0), static[known].sum(axis=0)
    enough = counts >= LEAST_EARLIER
    return bool(enough.any() and (still >= MIN_STATIC_SHARE * counts)[enough].all())


class _Limits(Record, frozen=True):
    """Largest distance in pixels of a static track: in the test for a static camera, in labels."""

    static: float = STATIC_DISTANCE
    displacement: float = MIN_DISPLACEMENT

    @classmethod
    def of_matches(cls, points: Floats, distance: Floats) -> _Limits:
        """The limits for matches [P, 2, 2], given their distances [P, 2] from the background.

        They grow with the noise: the smaller of that which was measured, in which mismatches and
        borders may be, and the spread of the static tracks, in which slow motions may be. But the
        tracks within them must be concentrated as noise is, and not belong to something that moves.
        """
        noise = measured_noise(points[np.isfinite(points).all(axis=(1, 2))])
        static, displacement = STATIC_DISTANCE, MIN_DISPLACEMENT
        for _ in range(SPREAD_ROUNDS if np.isfinite(noise) else 0):
            near = distance[:, 1][distance[:, 1] < displacement]
            spread = median(near) / MEDIAN_OF_RAYLEIGH if len(near) else 0.0
            limit = STILL * min(noise, spread)
            static, displacement = max(STATIC_DISTANCE, limit), max(MIN_DISPLACEMENT, limit)
        near = distance[:, 1][distance[:, 1] < displacement]
        if displacement > MIN_DISPLACEMENT and median(near) > CONCENTRATED * displacement:
            return cls()
        return cls(static, displacement)


def _drifting(points: Floats, distance: Floats, static: Flags) -> Flags:
    """Tracks [P] that move hardly more than the ``static`` ones and are surrounded by them.

    Trackers slip along edges, and nearby objects sway more. Hardly more means less than
    ``DRIFT_FACTOR`` times the distance that nine in ten static tracks stay within; surrounded means
    that most of the ``DRIFT_NEIGHBOURS`` nearest neighbours are static. (The slow parts of a moving
    object are surrounded by moving tracks.)
    """
    found = np.zeros(len(points), dtype=bool)
    tracks = np.flatnonzero(np.isfinite(distance).sum(axis=1) > 1)
    if not static.any() or len(tracks) <= DRIFT_NEIGHBOURS:
        return found
    largest = _quantile(distance[tracks], MIN_STATIC_FRAMES)
    static = static[tracks]
    limit = DRIFT_FACTOR * quantile(largest[static], MIN_STATIC_FRAMES)
    position = np.nanmean(points[tracks], axis=1)
    candidates = np.flatnonzero(~static & (largest < limit))
    _, near = nearest(position, position[candidates], DRIFT_NEIGHBOURS + 1)
    while True:
        surrounded = static[near[:, 1:]].mean(axis=1) > 0.5
        added = candidates[~static[candidates] & surrounded]
        if not added.size:
            found[tracks[static]] = True
            return found
        static[added] = True


def _extent(points: Floats, frame_size: tuple[int, int]) -> float:
    """Diagonal in pixels of the picture, or of the box of all points where that is smaller.

    The size of a picture that is not at hand is that of the largest coordinates.
    """
    visible = points[np.isfinite(points).all(axis=2)]
    box = float(np.hypot(*np.ptp(visible, axis=0))) if len(visible) else np.inf
    return min(float(np.hypot(*frame_size)), box)


def camera_path(points: Floats, max_shake: float, bandwidth: float = BANDWIDTH) -> Floats:
    """Estimate the shake of a static camera.

    In each frame, the mode of the displacements, up to ``max_shake`` pixels, of the visible tracks
    since their first frame.

    Returns
    -------
    ndarray [F, 2]
        Displacement of the static background since the first frame, in pixels.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    first = visible.argmax(axis=1)
    path = np.zeros(points.shape[1:])
    for frame in range(1, len(path)):
        older = np.flatnonzero(visible[:, frame] & (first < frame))
        if not len(older):
            path[frame] = path[frame - 1]
            continue
        index = np.linspace(0, len(older) - 1, min(len(older), MAX_DISPLACEMENTS)).astype(int)
        sample = older[index]
        moved = points[sample, frame] - points[sample, first[sample]] + path[first[sample]]
        small = moved[np.linalg.norm(moved, axis=1) < max_shake]
        path[frame] = densest(small, bandwidth) if len(small) else path[frame - 1]
    return path


def path_of_background(points: Floats, max_shake: float) -> Floats | None:
    """As ``camera_path``, from tracks [P, F, 2] that were the background in the frames before.

    Most of them still are, so that their median displacement is that of the camera. None where it
    exceeds ``max_shake``, or where too few of them are visible.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    first = visible.argmax(axis=1)
    starts = points[np.arange(len(points)), first]
    path = np.zeros(points.shape[1:])
    for frame in range(1, len(path)):
        older = visible[:, frame] & (first < frame)
        if older.sum() < LEAST_EARLIER:
            return None
        moved = points[older, frame] - starts[older] + path[first[older]]
        path[frame] = median(moved[:, 0]), median(moved[:, 1])
        if np.linalg.norm(path[frame]) >= max_shake:
            return None
    return path


def densest(displacements: Floats, bandwidth: float = BANDWIDTH) -> Floats:
    """The mode of the kernel density of ``displacements`` [n, 2] that the densest one ascends to.

    One pass over all pairs finds the start; mean shift of all of them would find all modes.
    """
    prepared, kernel = Euclidean(2).prepare(displacements, bandwidth), kernel_named("gaussian")
    _, density = shift(prepared, kernel, displacements)
    found = ascend(
        prepared,
        kernel,
        displacements[[density.argmax()]],
        tolerance=TOLERANCE,
        max_iterations=MAX_STEPS,
        accelerated=False,
    )
    return np.asarray(found.x[0])


def distances(points: Floats, path: Floats) -> Floats:
    """Distance of each track from its start in each frame, without the shake, in pixels [P, F]."""
    stabilized = points - path
    first = np.isfinite(points).all(axis=2).argmax(axis=1)
    start = stabilized[np.arange(len(points)), first]
    return np.asarray(np.linalg.norm(stabilized - start[:, None], axis=-1))


def is_static(
    points: Floats, distance: Floats, frame_size: Sequence[int], limit: float = STATIC_DISTANCE
) -> tuple[bool, str]:
    """Whether the camera is static in every frame; otherwise the reason why not."""
    reason = next(filter(None, _reasons(points, distance, frame_size, limit)), "")
    return not reason, reason


def _reasons(
    points: Floats, distance: Floats, frame_size: Sequence[int], limit: float
) -> Iterator[str]:
    """Why the camera seems to move between the first and each later frame; empty if it does not."""
    for frame in range(1, points.shape[1]):
        # not the tracks that begin in this frame
        usable = np.isfinite(distance[:, frame]) & np.isfinite(distance[:, :frame]).any(axis=1)
        if not usable.any():
            yield ""
            continue
        static = np.asarray(distance[usable, frame] < limit)
        share = float(static.mean())
        if share < MIN_STATIC_SHARE:
            yield f"{100 * share:.0f} % of the tracks are static over frames 1-{frame + 1}"
            continue
        covered = _cells_covered(points[usable, frame], static, frame_size)
        few = f"the static tracks cover only {100 * covered:.0f} % of the image"
        yield few if covered < MIN_STATIC_CELLS else ""


def _cells_covered(points: Floats, static: Flags, frame_size: Sequence[int]) -> float:
    """Share of the occupied cells of a grid over the image that contain a static track."""
    low = points.min(axis=0)
    low = np.where(low > 0.5 * np.asarray(frame_size), low, 0.0)
    size = np.maximum(frame_size, points.max(axis=0) + 1) - low
    cell = np.clip(((points - low) / size * GRID_CELLS).astype(int), 0, GRID_CELLS - 1) @ [
        1,
        GRID_CELLS,
    ]
    return len(distinct(cell[static])) / len(distinct(cell))


def _quantile(values: Floats, share: float) -> Floats:
    """The quantile of the finite values of each row, which has some: as ``np.nanquantile``.

    That goes from row to row in Python, which takes a hundred times as long.
    """
    complete = np.isfinite(values).all(axis=1)
    found = np.empty(len(values))
    if complete.any():
        found[complete] = quantile(values[complete], share)
    rest = np.sort(values[~complete], axis=1)  # NaN last
    place = (np.isfinite(rest).sum(axis=1) - 1) * share
    low = np.floor(place).astype(np.int64)
    rows = np.arange(len(rest))
    below, above = rest[rows, low], rest[rows, np.minimum(low + 1, rest.shape[1] - 1)]
    above = np.where(np.isfinite(above), above, below)
    part = place - low
    # as NumPy interpolates, to the last digit
    step = above - below
    found[~complete] = np.where(part < 0.5, below + step * part, above - step * (1 - part))
    return found
